"""The sections of a mission file: fields, ranges, defaults. Their docstrings are the descriptions
in the published JSON Schema. What several fields must be together is in `mission/checks/mission_checks.py`.

Lengths with a suffix (`_m`) are in metres; other lengths are in what `lengths` says. Horizontal
vectors are [north, east]. Angles are degrees clockwise from north, seen from above.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from swarm_ctl.core.model.fleet import Signing, VehicleKind, plain_endpoint
from swarm_ctl.core.model.plan import Compensation, Policy
from swarm_ctl.mission.input.section import AgentId, Section
from swarm_ctl.mission.input.simulation_section import SimulationSection

Length = Annotated[float, Field(gt=0, le=1000)]
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000)]
NorthEast = tuple[Coordinate, Coordinate]
Angle = Annotated[float, Field(ge=-360, le=360)]
Timeout = Annotated[float, Field(gt=0, le=3600)]
LossTime = Annotated[float, Field(ge=1, le=60)]
Name = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,39}$", examples=["hexagon", "search-line_2"])
]
Action = Annotated[Policy, Field(strict=False)]


class OriginSection(Section):
    """Origin of the common frame (WGS-84)."""

    lat_deg: float = Field(ge=-90, le=90)
    lon_deg: float = Field(ge=-180, le=180)
    alt_m: float = Field(ge=-500, le=9000)
    """Metres above mean sea level."""


class LawSection(Section):
    """The formation law's parameters."""

    r: Length
    """Interaction range: agents that start within it are neighbours."""
    r_out: Length
    """Outer radius of the avoidance region: closer than this, agents repel each other. Slots must
    lie further apart."""
    r_in: Length
    """Inner radius of the avoidance region: the least distance between two vehicles."""
    compensation: Annotated[Compensation, Field(strict=False)] = Compensation.STOP_POINT
    """The points that the law works on: stop_point (where each vehicle would come to rest; for
    vehicles with dead time and lag), or none (positions, as in the paper)."""
    kappa: float | None = Field(default=None, gt=0, le=1000)
    """Law iterations per second. Default: 1 / tick_s."""
    h: float | None = Field(default=None, gt=0, le=1)
    """Consensus gain per iteration. Default: 4 / kappa with stop points (1 / kappa without
    safety.filter or safety.release), and 0.005, the paper's, without stop points."""
    delta_l: float = Field(default=2.0, ge=2, le=100)
    """Offset of the paper's D (equation 66)."""
    delta_a: float = Field(default=0.1, gt=0, le=100)
    """Offset of the repulsion's gain sigma above its lower bound (equation 67)."""
    own: str | None = None
    """An own law in place of the paper's: the name under which an installed package offers it."""


class SafetySection(Section):
    """What stands between the law and the vehicles. Default of each: on with stop points, off
    without (as in the paper)."""

    filter: bool | None = None
    """Correct each velocity that would bring two vehicles closer than their keep-out distance."""
    guard: bool | None = None
    """Keep neighbour links shorter than r on the way, if the shape keeps them so."""
    release: bool | None = None
    """Resolve dead-locks: blocked agents go round each other."""
    align: bool | None = None
    """Form faster (mean error feedback): each agent also moves to where its slot lies by the mean
    of all agents that it hears, not only by its neighbours."""


class VehicleResponse(Section):
    """How vehicles answer a velocity setpoint; stop points are computed with it."""

    dead_time_s: float = Field(default=0.4, ge=0, le=2)
    """Until the vehicle begins to react."""
    lag_s: float = Field(default=0.5, ge=0.01, le=5)
    """Time constant of the velocity."""
    acceleration_mps2: float = Field(default=2.8, ge=0.1, le=20)
    """The most that the vehicle accelerates or brakes."""
    doubt_s: float = Field(default=0.5, ge=0.05, le=1)
    """Dead time and lag together may differ from the vehicle's own by this. An agent keeps the
    distance and the speed that it asks for until its flight has told better."""


class VehicleLimits(Section):
    """The most that an agent commands."""

    speed_mps: float = Field(default=5.0, ge=0.1, le=20)
    """Horizontal."""
    climb_mps: float = Field(default=1.0, ge=0.1, le=5)
    descent_mps: float = Field(default=1.0, ge=0.1, le=3)


class VehicleSection(Section):
    """What holds for all vehicles of the mission."""

    response: VehicleResponse = VehicleResponse()
    limits: VehicleLimits = VehicleLimits()


class AgentEntry(Section):
    """One agent of the mission."""

    id: AgentId
    start: NorthEast
    """Where its vehicle stands before take-off: [north, east] of the origin."""


class _ShapeSection(Section):
    rotation_deg: Angle = 0.0
    """Turns the whole shape clockwise."""


class _CountedShape(_ShapeSection):
    count: int | None = Field(default=None, ge=1, le=1000)
    """Number of slots. Default: one per agent."""


class RingShape(_CountedShape):
    """Slots evenly on a circle, clockwise from north. Give `side` or `radius`."""

    kind: Literal["ring"]
    side: Length | None = None
    """Distance between adjacent slots."""
    radius: Length | None = None


class LineShape(_CountedShape):
    """Line abreast: slots from west to east."""

    kind: Literal["line"]
    spacing: Length


class ColumnShape(_CountedShape):
    """Line in trail: slots from north to south."""

    kind: Literal["column"]
    spacing: Length


class GridShape(_CountedShape):
    """Rows of slots from west to east, the northern row first."""

    kind: Literal["grid"]
    spacing: Length
    columns: int | None = Field(default=None, ge=1, le=1000)
    """Slots per row. Default: as square as possible."""


class VeeShape(_CountedShape):
    """A leader in the north, the other slots alternately on its left and right arm."""

    kind: Literal["vee"]
    spacing: Length
    """Distance between adjacent slots of an arm."""
    angle_deg: float = Field(default=90.0, ge=20, le=180)
    """Between the arms; from 60 on, slots of different arms are at least `spacing` apart."""


class WedgeShape(_CountedShape):
    """A filled triangle: rows of one, two, three ... slots from north to south, adjacent ones
    `spacing` apart."""

    kind: Literal["wedge"]
    spacing: Length


class CircleShape(_CountedShape):
    """One slot in the middle, the others evenly on a circle around it, clockwise from north."""

    kind: Literal["circle"]
    radius: Length


class LettersShape(_CountedShape):
    """Text in a simple stroke font, slots evenly along the strokes."""

    kind: Literal["letters"]
    text: Annotated[str, Field(pattern=r"^[A-Za-z0-9 ]{1,12}$", examples=["A", "HELLO"])]
    height: Length
    """Of a letter; its width is two thirds of that."""


class CsvShape(_ShapeSection):
    """Slots from a CSV file with two columns, north and east. A first line of names is skipped."""

    kind: Literal["csv"]
    path: Annotated[str, Field(min_length=1, max_length=400)]
    """Path of the CSV file, relative to the mission file."""


class StarShape(_CountedShape):
    """Slots alternately on an outer and an inner circle, clockwise from north, the first one
    outside."""

    kind: Literal["star"]
    radius: Length
    inner_radius: Length


class OffsetsShape(_ShapeSection):
    """Any slots, given one by one."""

    kind: Literal["offsets"]
    offsets: tuple[NorthEast, ...] = Field(min_length=1, max_length=1000)
    """[north, east] of each slot."""


Shape: TypeAlias = Annotated[
    RingShape
    | CircleShape
    | LineShape
    | ColumnShape
    | GridShape
    | VeeShape
    | WedgeShape
    | StarShape
    | LettersShape
    | OffsetsShape
    | CsvShape,
    Field(discriminator="kind"),
]
Link = tuple[AgentId, AgentId]
Links = Annotated[tuple[Link, ...], Field(min_length=1, max_length=31125)]


class _TimedSection(Section):
    on_timeout: Action = Policy.LAND
    """What to do after `timeout_s`: land, return, hold, or continue with the next step."""


class TakeoffSection(_TimedSection):
    """Set the autopilot's mode, arm and climb."""

    height_m: float = Field(ge=1, le=120)
    """Above each vehicle's own take-off point."""
    timeout_s: Timeout | None = None
    """Default: 30 s more than twice the climb at vehicle.limits.climb_mps."""


class FormSection(_TimedSection):
    """Fly into a shape and wait until it stands."""

    shape: Name
    """A name from `shapes`."""
    slots: Literal["nearest", "fixed"] = "nearest"
    """nearest: slots are assigned with the least total squared distance; fixed: the agent with the
    k-th lowest id takes the k-th slot."""
    exchange: bool | None = None
    """Two agents that block each other may exchange their slots. Default: true with nearest slots
    and stop points, else false."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape at which it counts as formed."""
    settle_s: float = Field(default=5.0, ge=0, le=600)
    """How long the deviation must stay below `tolerance_m`."""
    timeout_s: Timeout = 120.0
    neighbours: Literal["keep", "rechoose"] | Links = "keep"
    """The neighbours of each agent from this step on. keep: as before; rechoose: the agents within
    `r` in the shape before this step; or a list of links, [id, id]."""


class _TravelSection(_TimedSection):
    speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Of the fastest agent. Default: half of vehicle.limits.speed_mps."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape, and of the pinned agent from its place, at which the
    formation counts as arrived."""
    settle_s: float = Field(default=2.0, ge=0, le=600)
    """How long the deviations must stay below `tolerance_m`."""
    timeout_s: Timeout | None = None
    """Default: 30 s and settle_s more than twice the time at speed_mps."""


class MoveSection(_TravelSection):
    """Move the formation's centre along a path and keep the shape. Give `to`, `along` or `by`."""

    to: NorthEast | None = None
    """Where the centre goes: [north, east] of the origin."""
    along: Annotated[tuple[NorthEast, ...], Field(min_length=1, max_length=200)] | None = None
    """Waypoints of the centre, each as `to`."""
    by: NorthEast | None = None
    """How far the centre goes: [north, east] of where it is planned to be."""


class RotateSection(_TravelSection):
    """Turn the formation about its centre and keep the shape."""

    angle_deg: float = Field(ge=-3600, le=3600)
    """Clockwise as seen from above."""


class ScaleSection(_TravelSection):
    """Widen or narrow the formation about its centre."""

    factor: float = Field(ge=0.05, le=20)
    """Relative to the shape's present size."""


class ReturnSection(_TimedSection):
    """Return to the starts, one agent at a time, at separated heights; land there and disarm."""

    timeout_s: Timeout | None = None
    """Default: long enough for the number of agents, the height and the ways to the starts."""


class HoldSection(_TimedSection):
    """Keep the formation for a while."""

    duration_s: float = Field(gt=0, le=3600)
    timeout_s: Annotated[float, Field(gt=0, le=7200)] | None = None
    """Default: 30 s more than the duration."""


class LandSection(Section):
    """Stop, land in place and disarm."""

    timeout_s: Timeout | None = None
    """Default: long enough for the height."""


StepBody: TypeAlias = (
    TakeoffSection
    | FormSection
    | HoldSection
    | MoveSection
    | RotateSection
    | ScaleSection
    | ReturnSection
    | LandSection
)


class StepEntry(Section):
    """One step of the mission: exactly one of these fields."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    takeoff: TakeoffSection | None = None
    form: FormSection | None = None
    hold: HoldSection | None = None
    move: MoveSection | None = None
    rotate: RotateSection | None = None
    scale: ScaleSection | None = None
    return_: ReturnSection | None = Field(default=None, alias="return")
    land: LandSection | None = None

    @property
    def kind(self) -> str:
        """The name of its only field, as in the file; '' where it has none or several."""
        given = [name.rstrip("_") for name in self.model_fields_set]
        return given[0] if len(given) == 1 else ""

    @property
    def body(self) -> StepBody | None:
        """The value of its only field."""
        return next((value for _, value in self if value is not None), None)

    @classmethod
    def kinds(cls) -> list[str]:
        """The names of all fields, as in the file."""
        return [name.rstrip("_") for name in cls.model_fields]

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`- land` and `- land:` mean `- land: {}`, and likewise for `return`."""
        if value in ("land", "return"):
            return {value: {}}
        if isinstance(value, dict):
            return {kind: {} if body is None else body for kind, body in value.items()}
        return value


class PolicySection(Section):
    """What an agent does when something that it relies on fails: continue, hold, land or return."""

    agent_lost: Action = Policy.LAND
    """When a peer was not heard for `agent_lost_after_s`."""
    agent_lost_after_s: LossTime = 5.0
    override_pause_s: float = Field(default=120.0, ge=0, le=3600)
    """For so long at most, a command to some agents alone (`hold --agents 2`) holds the mission up
    for the others. Then these agents have left, and `left_by_order` acts."""
    left_by_order: Action = Policy.CONTINUE
    """What the others do when an operator lands, calls back or kills some agents alone (`land
    --agents 3`): go on without them, hold until the operator commands `resume`, land or return."""
    station_lost: Action = Policy.LAND
    """When no station was heard for `station_lost_after_s`."""
    station_lost_after_s: LossTime = 5.0
    hold_before_land_s: float = Field(default=3.0, ge=0, le=60)
    """How long a policy of land holds before it lands."""
    fence: Action = Policy.LAND
    """When the vehicle is outside the geofence, or can't stop inside."""
    battery_low: Action = Policy.LAND
    """When less than `battery_reserve_percent` is left in the air."""
    battery_reserve_percent: float = Field(default=20.0, ge=0, le=90)
    """With less than this no vehicle takes off."""
    too_fast: Action = Policy.LAND
    """When the vehicle flies faster than `max_speed_mps` or tilts more than `max_tilt_deg`."""
    max_speed_mps: float | None = Field(default=None, ge=0.5, le=60)
    """Default: twice vehicle.limits.speed_mps."""
    max_tilt_deg: float = Field(default=60.0, ge=5, le=90)
    wind: Action = Policy.LAND
    """When the vehicle estimates more wind than `wind_limit_mps`. Vehicles that do not estimate the
    wind have the tilt limit instead."""
    wind_limit_mps: float = Field(default=12.0, ge=1, le=30)
    estimate: Action = Policy.HOLD
    """When the vehicle says in the air that its own estimate is faulty, or less accurate than
    `position_accuracy_flight_m`."""
    position_accuracy_m: float = Field(default=1.0, ge=0.05, le=50)
    """With a less accurate position, by its own word, no vehicle takes off."""
    position_accuracy_flight_m: float = Field(default=2.0, ge=0.05, le=50)
    return_separation_m: float = Field(default=3.0, ge=0, le=20)
    """Between the heights of two returning agents."""
    return_speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Default: half of vehicle.limits.speed_mps."""


class FenceSection(Section):
    """The geofence: where vehicles may be."""

    polygon: Annotated[tuple[NorthEast, ...], Field(min_length=3, max_length=200)] | None = None
    """Corners in order, [north, east] of the origin. Default: 100 m around everything planned."""
    height_m: float = Field(default=120.0, ge=2, le=500)
    """Above each vehicle's own take-off point."""


_VehicleEndpoint = Annotated[
    str,
    Field(
        pattern=r"^((udpout|tcp|tcpout):(//)?[^:/\s]+:[0-9]{1,5}"
        r"|(udp|udpin|tcpin):([^:/\s]+|//[^:/\s]*):[0-9]{1,5}"
        r"|serial:(//)?/dev/[^:\s]+(:[0-9]{3,7})?)$",
        examples=["udpout:192.168.1.21:14550", "serial:/dev/ttyACM0:115200", "udpin://:14540"],
    ),
    AfterValidator(plain_endpoint),
]

Endpoint = Annotated[
    str, Field(pattern=r"^(tcp|tls|udp|quic)/\S+:[0-9]{1,5}$", examples=["tcp/192.168.1.11:7447"])
]
"""Of the mesh. `tcp` is one stream; `udp` is QUIC, whose states are datagrams; `tls` and `quic` are
the same with keys, which `trust` makes of either by itself."""


class FleetEntry(Section):
    """How one agent's vehicle is reached."""

    id: AgentId
    sysid: int | None = Field(default=None, ge=1, le=250)
    """The vehicle's MAVLink system id. Default: the agent's id."""
    agent_sysid: int | None = Field(default=None, ge=1, le=254)
    """The MAVLink system id that the agent speaks with: no vehicle's, and no ground station's (255,
    for most of them). An ArduCopter lands when this id falls silent. Default: 250, 249, ... in the
    order of the agents' ids, without the fleet's sysids."""
    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    vehicle: Literal["simulated", "arducopter", "px4"] | None = None
    """What `run` starts for this agent: a simulated vehicle, or the autopilot itself (SITL).
    Default: simulated, where there is no endpoint."""
    response: VehicleResponse | None = None
    """How this vehicle answers a velocity setpoint. Default: the mission's vehicle.response; if it
    gives none, what is typical for the autopilot."""
    simulated_response: VehicleResponse | None = None
    """How a simulated vehicle truly answers, whatever the agent believes (`response`). Default: as
    its autopilot does."""
    endpoint: _VehicleEndpoint | None = None
    """The vehicle's MAVLink endpoint. Several agents may share a serial one, which then is a radio:
    `swarm-ctl link` passes their frames. Default: `run` starts the vehicle."""
    mesh: Endpoint | None = None
    """Where the agent listens on the mesh, in a swarm of up to 16 without routers. Default: where
    `host` stands, `tcp/HOST:7448`, the next agent of that host 7449 and so on; else a loopback
    port."""
    router: Endpoint | None = None
    """Where the router listens whose client the agent is: of its host, in a swarm of more than 16
    or one whose fleet names routers. Default: the fleet's; in a larger swarm, where `host` stands,
    `tcp/HOST:7447`."""
    host: str | None = Field(
        default=None,
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,252}$",
        examples=["drone3.local", "10.0.0.13"],
    )
    """The computer that the agent runs on, by the name that SSH and the mesh reach it by: a name,
    an IPv4 address, or an alias of ~/.ssh/config. All agents of a fleet have one, or none has."""

    @property
    def vehicle_sysid(self) -> int:
        """The vehicle's system id; the agent's id where the file gives none."""
        return self.id if self.sysid is None else self.sysid

    @property
    def kind(self) -> VehicleKind:
        """What `run` starts where there is no endpoint."""
        return VehicleKind(self.vehicle or VehicleKind.SIMULATED)

    @property
    def firmware(self) -> str:
        """The autopilot; the one that `vehicle` names where the file gives none."""
        given = "autopilot" in self.model_fields_set
        return self.autopilot if given else self.kind.autopilot or self.autopilot


class FleetSection(Section):
    """The vehicles, in the mission or in a file of their own."""

    version: Literal[1] = 1
    agents: tuple[FleetEntry, ...] = Field(min_length=1, max_length=250)
    router: Endpoint | None = None
    """Where the router listens whose clients all agents are; an agent of another host names its
    own. `swarm-ctl router` starts it. Default: a swarm of up to 16 has none; of a larger one `run`
    starts one on a loopback port, or the agents' hosts have one each (`host`)."""
    trust: str | None = Field(default=None, min_length=1, examples=["trust/outdoors"])
    """The folder with the swarm's keys, relative to this file; `swarm-ctl trust new` makes it. The
    mesh is then encrypted, and open to its members alone. Default: an open mesh, which may not
    leave the loopback interface."""
    signing: Literal["required", "off"] | None = None
    """Whether agents and vehicles sign their MAVLink frames. Default: required where `trust`
    stands."""

    radio_bytes_per_s: int | None = Field(default=None, ge=200, le=10_000_000)
    """What a radio that several agents share carries, both directions together. An endpoint that
    is no serial port may be shared only with it. Default: a tenth of the baud rate."""

    @property
    def signs(self) -> Signing:
        """Whether frames are signed."""
        return Signing(self.signing or ("required" if self.trust else "off"))


class MissionFile(Section):
    """A swarm_ctl mission."""

    version: Literal[1]
    name: Name
    """A-Z, a-z, 0-9, - and _; no space. Part of the name of the run's folder."""
    origin: OriginSection
    lengths: Literal["units", "metres"] = "units"
    """Unit of all lengths without a suffix: units of `unit_m` metres, or metres."""
    unit_m: float = Field(default=5.0, ge=0.1, le=1000)
    """Metres per unit of the law. Default: 5; with `lengths: metres` law.r_out / 1.5."""
    tick_s: float = Field(default=0.05, ge=0.01, le=1)
    """The control loop's period."""
    prepare_timeout_s: Timeout = 120.0
    """How long agents wait until all vehicles are healthy and all agents are heard."""
    law: LawSection
    vehicle: VehicleSection = VehicleSection()
    safety: SafetySection = SafetySection()
    policies: PolicySection = PolicySection()
    fence: FenceSection = FenceSection()
    neighbours: Literal["starts"] | Links = "starts"
    """starts: agents that start within `r` of each other are neighbours (the paper's rule); or a
    list of links, [id, id]."""
    agents: tuple[AgentEntry, ...] = Field(min_length=1, max_length=250)
    """At most 250, the number of sysids."""
    shapes: dict[Name, Shape] = Field(default={})
    steps: tuple[StepEntry, ...] = Field(min_length=1, max_length=1000)
    fleet: FleetSection | None = None
    """The vehicles, or the path of a fleet file relative to this file. Default: all simulated."""
    simulation: SimulationSection = SimulationSection()


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a mission file, for editors."""
    schema = MissionFile.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    fleet = schema["properties"]["fleet"]
    fleet["anyOf"].append(
        {"type": "string", "description": "path of a fleet file, relative to this file"}
    )
    schema["properties"]["steps"]["items"] = {
        "anyOf": [schema["properties"]["steps"]["items"], {"enum": ["land", "return"]}]
    }
    return schema
