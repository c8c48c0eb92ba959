"""The one table of what goes over the mesh: key, payload, rate and quality of service.

`{swarm}` is the swarm's name: two swarms on one network stay apart. `{id}` is the agent's id (the
station's name for a beacon); an agent publishes only under its own id.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    ClockNews,
    Command,
    Event,
    SigmaReport,
    StationBeacon,
)
from swarm_ctl.errors import InputError

P = TypeVar("P")


@dataclass(frozen=True, slots=True)
class Qos:
    """What the transport owes a payload."""

    reliable: bool
    """The link sends it again until it arrives; nothing ever waits for a full queue (it is
    dropped)."""
    urgent: bool
    """Goes first and is not batched."""
    timed: bool = False
    """The receiver notes when it came, not when it looked for it."""


NEWEST: Final = Qos(reliable=False, urgent=True)
TIMED: Final = Qos(reliable=False, urgent=True, timed=True)
REPORT: Final = Qos(reliable=False, urgent=False)
MUST_ARRIVE: Final = Qos(reliable=True, urgent=True)


@dataclass(frozen=True, slots=True)
class Channel(Generic[P]):
    """One row of the table."""

    name: str
    template: str
    payload: type[P]
    rate: str
    qos: Qos
    who: str
    """Who publishes, who listens."""

    def key(self, swarm: str, publisher: int | str) -> str:
        """The key one publisher uses."""
        return self.template.format(swarm=swarm, id=publisher)

    def everyone(self, swarm: str) -> str:
        """The key expression that matches all publishers."""
        return self.template.format(swarm=swarm, id="*")


STATE: Final = Channel(
    "state",
    "swarm/{swarm}/agent/{id}/state",
    AgentState,
    "every tick (20 Hz)",
    NEWEST,
    "agent -> agents, stations",
)
CLOCK: Final = Channel(
    "clock",
    "swarm/{swarm}/agent/{id}/clock",
    ClockNews,
    "1 Hz, 5 Hz while one is not known",
    TIMED,
    "agent -> agents",
)
STATUS: Final = Channel(
    "status", "swarm/{swarm}/agent/{id}/status", AgentStatus, "2 Hz", REPORT, "agent -> stations"
)
SIGMA: Final = Channel(
    "sigma",
    "swarm/{swarm}/agent/{id}/sigma",
    SigmaReport,
    "5 Hz while a pair is near",
    REPORT,
    "agent -> stations",
)
EVENT: Final = Channel(
    "event",
    "swarm/{swarm}/agent/{id}/event",
    Event,
    "as it happens",
    MUST_ARRIVE,
    "agent -> stations",
)
ACK: Final = Channel(
    "ack", "swarm/{swarm}/agent/{id}/ack", Ack, "per command", MUST_ARRIVE, "agent -> stations"
)
COMMAND: Final = Channel(
    "command",
    "swarm/{swarm}/station/{id}/command",
    Command,
    "as given, again every 0.5 s until acknowledged",
    MUST_ARRIVE,
    "station -> agents",
)
BEACON: Final = Channel(
    "beacon",
    "swarm/{swarm}/station/{id}/beacon",
    StationBeacon,
    "4 Hz",
    REPORT,
    "station -> agents, stations",
)

CHANNELS: Final[tuple[Channel[object], ...]] = (
    STATE,
    CLOCK,
    STATUS,
    SIGMA,
    EVENT,
    ACK,
    COMMAND,
    BEACON,
)  # type: ignore[assignment]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def check_name(name: str) -> str:
    """`name` if it can stand in a key; InputError otherwise (`*`, `/` and the like would change who
    hears it)."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"name {name!r} can't be used on the mesh; allowed: up to 64 letters, digits, '_.-'"
        )
    return name
