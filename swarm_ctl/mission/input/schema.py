"""The mission file's form: sections, fields, ranges, defaults. What one field alone can't tell is
in `checks.py`.

Lengths: a name with a suffix (`_m`) is in metres; radii, starts, spacings and offsets without one
are in units of `unit_m` metres. Horizontal vectors are [north, east]. Angles are degrees clockwise
from north, seen from above.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, model_validator

from swarm_ctl.core.model.plan import Compensation, Policy
from swarm_ctl.mission.input.section import AgentId, Section
from swarm_ctl.mission.input.simulation_section import Simulation

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


class Origin(Section):
    """Zero of the common frame on the WGS-84 ellipsoid."""

    lat_deg: float = Field(ge=-90, le=90)
    lon_deg: float = Field(ge=-180, le=180)
    alt_m: float = Field(ge=-500, le=9000)
    """Metres above mean sea level."""


class Law(Section):
    """The formation law's parameters. Lengths in units."""

    r: Length
    """Interaction range: neighbours are the agents that start within it."""
    r_out: Length
    """Outer radius of the avoidance region; slots lie further apart."""
    r_in: Length
    """Inner radius: no two vehicles may ever come this close."""
    compensation: Annotated[Compensation, Field(strict=False)] = Compensation.STOP_POINT
    """Which points the law sees: stop_point (vehicles with dead time and lag), or none (positions,
    as in the paper)."""
    kappa: float | None = Field(default=None, gt=0, le=1000)
    """Law iterations per second; 1 / tick_s where not given."""
    h: float | None = Field(default=None, gt=0, le=1)
    """Consensus gain per iteration; where not given 4 / kappa with stop points (1 / kappa without
    filter or release), and 0.005, the paper's, without stop points."""
    delta_l: float = Field(default=2.0, ge=2, le=100)
    delta_a: float = Field(default=0.1, gt=0, le=100)


class SafetySection(Section):
    """What stands between the law and the vehicles; all on with stop points, all off without (as in
    the paper)."""

    filter: bool | None = None
    """No velocity that would bring two closer than their keep-out distance."""
    guard: bool | None = None
    """Links whose slots fit in r are not stretched past r on the way."""
    release: bool | None = None
    """Out of dead-locks by going round each other."""
    align: bool | None = None
    """Out of slow modes: everybody also moves to where all who are heard say, on the average, that
    his slot is."""


class VehicleResponse(Section):
    """How the vehicles answer a velocity setpoint; the stop point is predicted with it."""

    dead_time_s: float = Field(default=0.4, ge=0, le=2)
    lag_s: float = Field(default=0.5, ge=0.01, le=5)
    acceleration_mps2: float = Field(default=2.8, ge=0.1, le=20)


class VehicleLimits(Section):
    """What an agent never commands more of."""

    speed_mps: float = Field(default=5.0, ge=0.1, le=20)
    climb_mps: float = Field(default=1.0, ge=0.1, le=5)
    descent_mps: float = Field(default=1.0, ge=0.1, le=3)


class Vehicle(Section):
    """What all vehicles of the mission have in common."""

    response: VehicleResponse = VehicleResponse()
    limits: VehicleLimits = VehicleLimits()


class Agent(Section):
    """One agent of the mission."""

    id: AgentId
    start: NorthEast
    """Where its vehicle stands before take-off: [north, east] of the origin, in units."""


class _Shape(Section):
    rotation_deg: Angle = 0.0
    """Turns the whole shape clockwise."""


class _Counted(_Shape):
    count: int | None = Field(default=None, ge=1, le=1000)
    """How many slots; one per agent where not given."""


class Ring(_Counted):
    """Slots evenly on a circle, the first one north, clockwise. Give `side` or `radius`."""

    kind: Literal["ring"]
    side: Length | None = None
    """Distance between adjacent slots, in units."""
    radius: Length | None = None


class Line(_Counted):
    """Abreast: slots from west to east."""

    kind: Literal["line"]
    spacing: Length


class Column(_Counted):
    """In trail: slots from north to south."""

    kind: Literal["column"]
    spacing: Length


class Grid(_Counted):
    """Rows from west to east, the northern one first."""

    kind: Literal["grid"]
    spacing: Length
    columns: int | None = Field(default=None, ge=1, le=1000)
    """Slots per row; as square as possible where not given."""


class Vee(_Counted):
    """A leader in the north, the others alternately on its left and right arm."""

    kind: Literal["vee"]
    spacing: Length
    """Distance between adjacent slots of an arm, in units."""
    angle_deg: float = Field(default=90.0, ge=20, le=180)
    """Between the arms; 60 and more keeps the two arms' slots `spacing` apart."""


class Wedge(_Counted):
    """A filled triangle: rows of one, two, three ... slots from north to south, all `spacing`
    apart."""

    kind: Literal["wedge"]
    spacing: Length


class Circle(_Counted):
    """A slot in the middle, the others evenly on a circle around it, the first of them north,
    clockwise."""

    kind: Literal["circle"]
    radius: Length


class Letters(_Shape):
    """Words in a simple stroke font, as many slots as the agents have, evenly along the strokes."""

    kind: Literal["letters"]
    text: Annotated[str, Field(pattern=r"^[A-Za-z0-9 ]{1,12}$", examples=["A", "HELLO"])]
    height: Length
    """Of a letter, in units; it is as wide as two thirds of that."""
    count: int | None = Field(default=None, ge=1, le=1000)
    """How many slots; one per agent where not given."""


class Imported(_Shape):
    """Slots from a CSV file: two columns, north and east, in units; a first line of names is left
    out."""

    kind: Literal["csv"]
    path: Annotated[str, Field(min_length=1, max_length=400)]
    """Relative to the mission file."""


class Star(_Counted):
    """Slots alternately on an outer and an inner circle, the first one outside and north,
    clockwise."""

    kind: Literal["star"]
    radius: Length
    inner_radius: Length


class Offsets(_Shape):
    """Any slots, one by one."""

    kind: Literal["offsets"]
    offsets: tuple[NorthEast, ...] = Field(min_length=1, max_length=1000)
    """[north, east] of each slot, in units."""


Shape: TypeAlias = Annotated[
    Ring | Circle | Line | Column | Grid | Vee | Wedge | Star | Letters | Offsets | Imported,
    Field(discriminator="kind"),
]
Link = tuple[AgentId, AgentId]
Links = Annotated[tuple[Link, ...], Field(min_length=1, max_length=31125)]


class _Timed(Section):
    on_timeout: Action = Policy.LAND
    """When the step takes too long: land, return, hold, or continue with the next step."""


class Takeoff(_Timed):
    """Set the mode, arm and climb."""

    height_m: float = Field(ge=1, le=120)
    """Above each vehicle's own take-off point."""
    timeout_s: Timeout | None = None
    """Where not given, generous for the height and the climb rate."""


class Form(_Timed):
    """Fly into a shape and wait until it stands."""

    shape: Name
    """A name from `shapes`."""
    slots: Literal["nearest", "fixed"] = "nearest"
    """nearest: least total squared distance; fixed: the k-th slot to the agent with the k-th lowest
    id."""
    exchange: bool | None = None
    """Agents that are in each other's way take each other's slots; by default with nearest slots
    and stop points."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape that counts as formed."""
    settle_s: float = Field(default=5.0, ge=0, le=600)
    """How long the deviation has to stay under it."""
    timeout_s: Timeout = 120.0
    neighbours: Literal["keep", "rechoose"] | Links = "keep"
    """keep: as before; rechoose: who is within `r` in the shape before this one; or a list of
    links, [id, id]."""


class _Travel(_Timed):
    speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Of the fastest agent; half of vehicle.limits.speed_mps where not given."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape, and of the pinned agent from its place, that counts as
    arrived."""
    settle_s: float = Field(default=2.0, ge=0, le=600)
    timeout_s: Timeout | None = None
    """Where not given, 30 s more than twice the time at full speed."""


class Move(_Travel):
    """Take the formation's centre along a path, keeping shape. Give `to`, `along` or `by`."""

    to: NorthEast | None = None
    """[north, east] of the origin, in units."""
    along: Annotated[tuple[NorthEast, ...], Field(min_length=1, max_length=200)] | None = None
    """Waypoints, each as `to`."""
    by: NorthEast | None = None
    """[north, east] of where the formation is planned to be, in units."""


class Rotate(_Travel):
    """Turn the formation about its centre."""

    angle_deg: float = Field(ge=-3600, le=3600)
    """Clockwise from above."""


class Scale(_Travel):
    """Widen or narrow the formation about its centre."""

    factor: float = Field(ge=0.05, le=20)
    """Of the shape as it is."""


class Return(_Timed):
    """One at a time, at separated heights, back to the own start; land there, disarm."""

    timeout_s: Timeout | None = None
    """Where not given, generous for the number of agents."""


class Hold(_Timed):
    """Keep the formation."""

    duration_s: float = Field(gt=0, le=3600)
    timeout_s: Annotated[float, Field(gt=0, le=7200)] | None = None
    """Where not given, 30 s more than the duration."""


class Land(Section):
    """Stop, land in place, disarm."""

    timeout_s: Timeout | None = None
    """Where not given, generous for the height."""


StepBody: TypeAlias = Takeoff | Form | Hold | Move | Rotate | Scale | Return | Land


class Step(Section):
    """One step of the mission: exactly one of these."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    takeoff: Takeoff | None = None
    form: Form | None = None
    hold: Hold | None = None
    move: Move | None = None
    rotate: Rotate | None = None
    scale: Scale | None = None
    return_: Return | None = Field(default=None, alias="return")
    land: Land | None = None

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
        """`- land` and `- land:` mean `- land: {}`; so does `- return`."""
        if value in ("land", "return"):
            return {value: {}}
        if isinstance(value, dict):
            return {kind: {} if body is None else body for kind, body in value.items()}
        return value


class PolicySection(Section):
    """What an agent does when it loses something, and after which time it counts as lost."""

    agent_lost: Action = Policy.LAND
    agent_lost_after_s: LossTime = 5.0
    station_lost: Action = Policy.LAND
    station_lost_after_s: LossTime = 5.0
    hold_before_land_s: float = Field(default=3.0, ge=0, le=60)
    fence: Action = Policy.LAND
    """Outside the geofence, or unable to stop inside."""
    battery_low: Action = Policy.LAND
    battery_reserve_percent: float = Field(default=20.0, ge=0, le=90)
    """With less than this left nobody takes off, and `battery_low` is done in the air."""
    too_fast: Action = Policy.LAND
    """Faster than `max_speed_mps`, or leaning more than `max_tilt_deg`."""
    max_speed_mps: float | None = Field(default=None, ge=0.5, le=60)
    """Twice vehicle.limits.speed_mps where not given."""
    max_tilt_deg: float = Field(default=45.0, ge=5, le=90)
    wind: Action = Policy.LAND
    """More wind than `wind_limit_mps`, as the vehicle estimates it; where it does not, the tilt
    limit stands in."""
    wind_limit_mps: float = Field(default=12.0, ge=1, le=30)
    return_separation_m: float = Field(default=3.0, ge=0, le=20)
    """Between the heights of two agents on their way back."""
    return_speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Half of vehicle.limits.speed_mps where not given."""


class FenceSection(Section):
    """Where the vehicles may be. Where it is not given: 100 m around everything planned, up to 120
    m."""

    polygon: Annotated[tuple[NorthEast, ...], Field(min_length=3, max_length=200)] | None = None
    """Corners in order, [north, east] of the origin, in units; 100 m around everything planned
    where not given."""
    height_m: float = Field(default=120.0, ge=2, le=500)
    """Above each vehicle's own take-off point."""


class FleetEntry(Section):
    """How one agent's vehicle is reached."""

    id: AgentId
    sysid: int | None = Field(default=None, ge=1, le=250)
    """The vehicle's MAVLink system id; the agent's id where not given."""
    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    response: VehicleResponse | None = None
    """How this vehicle answers a velocity setpoint; the mission's `vehicle.response` or, without
    one, what is typical for the autopilot where not given."""
    endpoint: str | None = Field(
        default=None,
        pattern=r"^((udp|udpin|udpout|tcp|tcpin):[^:\s]+:[0-9]{1,5}|serial:/dev/[^:\s]+(:[0-9]{3,7})?)$",
        examples=["udpout:192.168.1.21:14550", "serial:/dev/ttyACM0:115200"],
    )
    """The vehicle's link; simulated where not given."""
    mesh: str | None = Field(
        default=None,
        pattern=r"^(tcp|tls|udp|quic)/\S+:[0-9]{1,5}$",
        examples=["tcp/192.168.1.11:7447"],
    )
    """Where the agent listens on the mesh; a loopback port where not given."""

    @property
    def vehicle_sysid(self) -> int:
        """The vehicle's system id; the agent's id where the file gives none."""
        return self.id if self.sysid is None else self.sysid


class FleetSection(Section):
    """The vehicles, in the mission or in a file of their own."""

    version: Literal[1] = 1
    agents: tuple[FleetEntry, ...] = Field(min_length=1, max_length=250)


class MissionFile(Section):
    """A swarm_ctl mission."""

    version: Literal[1]
    name: Name
    """Letters, digits, - and _; names the run's folder."""
    origin: Origin
    lengths: Literal["units", "metres"] = "units"
    """What lengths without a suffix are in: units of `unit_m` metres, or plain metres."""
    unit_m: float = Field(default=5.0, ge=0.1, le=1000)
    """Metres per unit of the law; where not given 5, or with `lengths: metres` law.r_out / 1.5."""
    tick_s: float = Field(default=0.05, ge=0.01, le=1)
    """The control loop's period."""
    prepare_timeout_s: Timeout = 120.0
    """How long to wait for all vehicles to be healthy and all agents to be there."""
    law: Law
    vehicle: Vehicle = Vehicle()
    safety: SafetySection = SafetySection()
    policies: PolicySection = PolicySection()
    fence: FenceSection = FenceSection()
    neighbours: Literal["starts"] | Links = "starts"
    """starts: who starts within `r` of each other (the paper's rule); or a list of links, [id,
    id]."""
    agents: tuple[Agent, ...] = Field(min_length=1, max_length=250)
    """At most as many as there are sysids."""
    shapes: dict[Name, Shape] = Field(default={})
    steps: tuple[Step, ...] = Field(min_length=1, max_length=1000)
    fleet: FleetSection | None = None
    """The vehicles, or the path of a fleet file beside this one; all simulated where not given."""
    simulation: Simulation = Simulation()


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a mission file as it is written (editors complete and check with it)."""
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
