"""The fleet: how each agent, its vehicle and its host are reached."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from swarm_ctl.core.model.fleet import SigningPolicy, VehicleKind, plain_endpoint
from swarm_ctl.core.model.plan import Limits, Response
from swarm_ctl.mission.sections.section import AgentId, Section, Written

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
    def signs(self) -> SigningPolicy:
        """Whether frames are signed."""
        return SigningPolicy(self.signing or ("required" if self.trust else "off"))


class VehicleResponse(Written[Response]):
    """How vehicles answer a velocity setpoint; stop points are computed with it."""


class VehicleLimits(Written[Limits]):
    """The most that an agent commands."""


class VehicleSection(Section):
    """What holds for all vehicles of the mission."""

    response: VehicleResponse = VehicleResponse.model_construct()
    limits: VehicleLimits = VehicleLimits.model_construct()
