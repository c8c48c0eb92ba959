"""The one table of what goes over the mesh: key, payload, rate and quality of service.

The keys of two swarms on one network differ by the swarm's name. An agent publishes only under its
own id, a station only under its own name.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Generic, NamedTuple, TypeVar

from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    ClockNews,
    Command,
    Event,
    LawNews,
    SigmaReport,
    StationBeacon,
    TargetWord,
)
from swarm_ctl.mesh.payloads import STATE_BYTES

P = TypeVar("P")


@dataclass(frozen=True, slots=True)
class Qos:
    """What the transport owes a payload."""

    reliable: bool
    """The link repeats it until it arrives; a full queue drops it, no sender ever waits."""
    urgent: bool
    """Sent first, and not batched."""
    timed: bool = False
    """The receiver stores when it came, not when the control loop read it."""


NEWEST: Final = Qos(reliable=False, urgent=True)
TIMED: Final = Qos(reliable=False, urgent=True, timed=True)
REPORT: Final = Qos(reliable=False, urgent=False)
MUST_ARRIVE: Final = Qos(reliable=True, urgent=True)


QUEUE: Final = 4096
"""Unread messages that a subscription keeps at most; it drops the oldest first (a gap in `seq`)."""
_QUEUED_BYTES: Final = 6 << 20
_AGENTS: Final = 250
"""As many as a mission may have."""


class Bounds(NamedTuple):
    """What a receiver takes of one publisher on one channel; of more, the newest."""

    size: int
    """Bytes of a payload; a larger one is never read."""
    per_s: float
    """Messages per second of mission time: twice what is sent at most."""
    burst: int
    """Messages at once, after a stop of the link or of the receiver."""

    @property
    def queue(self) -> int:
        """Unread messages that a subscription keeps: what fits into 6 MB, at most `QUEUE`, and
        always two of each agent: in lockstep all agents speak before a listener reads."""
        return max(2 * _AGENTS, min(QUEUE, _QUEUED_BYTES // self.size))


@dataclass(frozen=True, slots=True)
class Channel(Generic[P]):
    """One row of the table."""

    name: str
    payload: type[P]
    publisher: str
    """`agent` or `station`."""
    listeners: str
    rate: str
    qos: Qos
    bounds: Bounds

    @property
    def template(self) -> str:
        """The key; `{id}` is the agent's id or the station's name."""
        return f"swarm/{{swarm}}/{self.publisher}/{{id}}/{self.name}"

    @property
    def route(self) -> str:
        """Publisher -> listeners."""
        return f"{self.publisher} -> {self.listeners}"

    def key(self, swarm: str, publisher: int | str) -> str:
        """The key of one publisher."""
        return self.template.format(swarm=swarm, id=publisher)

    def key_expression(self, swarm: str) -> str:
        """Matches the keys of all publishers."""
        return self.key(swarm, "*")


def alive_key(swarm: str, kind: str, name: int | str) -> str:
    """The key of a liveliness token; `kind`: agent, station or router. Other tools see by it who is
    on the mesh. No agent decides anything by it: zenoh's threads keep a token while the control
    loop behind it hangs, and lose it with a link. A state's age says both."""
    return f"swarm/{swarm}/{kind}/{name}/alive"


def plan_key(swarm: str, station: str) -> str:
    """The key under which a station answers agents that ask for their plan."""
    return f"swarm/{swarm}/station/{station}/plan"


@lru_cache(1024)
def owner_of(key: str) -> tuple[str, str]:
    """What owns a key: `("agent", "3")`, `("station", "station-77-a1b2c3")`."""
    kind, _, name = key.rpartition("/")[0].rpartition("/")
    return kind.rpartition("/")[2], name


_EVERY_TICK: Final = "every tick (20 Hz)"
_CLOCK_RATE: Final = "1 Hz, 5 Hz while one is not known"
_SIGMA_RATE: Final = "5 Hz while a pair is near"
_COMMAND_RATE: Final = "as given, again every 0.5 s until acknowledged"

_KB: Final = 1024
_AS_IT_COMES: Final = 20.0, 200
"""A command is sent again after half a second, and acknowledged again."""

STATE: Final = Channel(
    name="state",
    payload=AgentState,
    publisher="agent",
    listeners="agents, stations",
    rate=_EVERY_TICK,
    qos=NEWEST,
    bounds=Bounds(STATE_BYTES, 200.0, 1000),
)
FAR: Final = Channel(
    name="far",
    payload=AgentState,
    publisher="agent",
    listeners="agents",
    rate="2 Hz, of more than 16 agents",
    qos=REPORT,
    bounds=Bounds(STATE_BYTES, 4.0, 100),
)
CLOCK: Final = Channel(
    name="clock",
    payload=ClockNews,
    publisher="agent",
    listeners="agents",
    rate=_CLOCK_RATE,
    qos=TIMED,
    bounds=Bounds(12 + 18 * _AGENTS, 10.0, 100),
)
LAW: Final = Channel(
    name="law",
    payload=LawNews,
    publisher="agent",
    listeners="agents",
    rate="1 Hz while a peer flies another law, or has other zones",
    qos=MUST_ARRIVE,
    bounds=Bounds(24 * _KB, 4.0, 50),
)
_TARGET_RATE: Final = "5 Hz, of a target that it hears"
TARGET: Final = Channel(
    name="target",
    payload=TargetWord,
    publisher="agent",
    listeners="agents, stations",
    rate=_TARGET_RATE,
    qos=REPORT,
    bounds=Bounds(_KB, 50.0, 100),
)
SIGHTING: Final = Channel(
    name="sighting",
    payload=TargetWord,
    publisher="station",
    listeners="agents, stations",
    rate=_TARGET_RATE,
    qos=REPORT,
    bounds=Bounds(_KB, 50.0, 100),
)
STATUS: Final = Channel(
    name="status",
    payload=AgentStatus,
    publisher="agent",
    listeners="stations",
    rate="2 Hz",
    qos=REPORT,
    bounds=Bounds(64 * _KB, 4.0, 100),
)
SIGMA: Final = Channel(
    name="sigma",
    payload=SigmaReport,
    publisher="agent",
    listeners="stations",
    rate=_SIGMA_RATE,
    qos=REPORT,
    bounds=Bounds(64 * _KB, 10.0, 200),
)
EVENT: Final = Channel(
    name="event",
    payload=Event,
    publisher="agent",
    listeners="stations",
    rate="as it happens",
    qos=MUST_ARRIVE,
    bounds=Bounds(8 * _KB, 20.0, 500),
)
ACK: Final = Channel(
    name="ack",
    payload=Ack,
    publisher="agent",
    listeners="stations",
    rate="per command",
    qos=MUST_ARRIVE,
    bounds=Bounds(4 * _KB, *_AS_IT_COMES),
)
COMMAND: Final = Channel(
    name="command",
    payload=Command,
    publisher="station",
    listeners="agents",
    rate=_COMMAND_RATE,
    qos=MUST_ARRIVE,
    bounds=Bounds(24 * _KB, *_AS_IT_COMES),
)
BEACON: Final = Channel(
    name="beacon",
    payload=StationBeacon,
    publisher="station",
    listeners="agents, stations",
    rate="4 Hz",
    qos=REPORT,
    bounds=Bounds(_KB, 8.0, 100),
)

_ALL = (STATE, FAR, CLOCK, LAW, TARGET, SIGHTING, STATUS, SIGMA, EVENT, ACK, COMMAND, BEACON)
CHANNELS: Final[tuple[Channel[object], ...]] = _ALL  # type: ignore[assignment]  # P is invariant
