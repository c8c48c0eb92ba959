"""What a scenario does to the processes of a run in lockstep. Each process has its own part, and
does to itself what is due, at the end of a tick: the next one is without it, on any machine.

Times are seconds of mission time. What is due at a time is done at the end of the first tick that
is not before it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Final, NamedTuple

from swarm_ctl.core.model.messages import AgentState, Command, CommandKind, Phase
from swarm_ctl.core.model.plan import Point
from swarm_ctl.mesh.impaired import ImpairedTransport, Impairment
from swarm_ctl.mesh.transport import Transport

_ROUNDING_S: Final = 1e-9
HELD_S: Final = 20.0
"""A shorter hold may end by itself."""


class Deed(StrEnum):
    """What is done to an agent."""

    KILL = "kill"
    STOP = "stop"
    GO_ON = "go on"
    PART = "part"
    JOIN = "join"
    CLOCK = "clock"
    SAY = "say"


@dataclass(frozen=True, slots=True)
class Untruth:
    """What an agent tells of itself that is not so."""

    moved_m: Point = (0.0, 0.0)
    """Its position and stop point are told so far north and east of where they are."""
    wrong: tuple[tuple[str, int], ...] = ()
    """Fields of its state that are told wrong."""

    def of(self, state: AgentState) -> AgentState:
        """The state as it is told."""
        north, east = self.moved_m
        (n, e, d), (stop_n, stop_e) = state.position_ned_m, state.stop_point_m
        moved = replace(
            state,
            position_ned_m=(n + north, e + east, d),
            stop_point_m=(stop_n + north, stop_e + east),
        )
        wrong: Any = dict(self.wrong)
        return replace(moved, **wrong)


@dataclass(frozen=True, slots=True)
class Due:
    """Something that is done at a time."""

    at_s: float
    deed: Deed
    names: tuple[str, ...] = ()
    """Of whom the agent hears nothing (PART), or hears again (JOIN)."""
    ahead_s: float = 0.0
    """By how much its clock jumps (CLOCK)."""
    untruth: Untruth | None = None
    """What it tells from now on (SAY); None: what is so."""


@dataclass(frozen=True, slots=True)
class AgentScript:
    """What befalls one agent."""

    due: tuple[Due, ...] = ()
    """In the order of their times."""
    mesh: Impairment | None = None
    """What happens to each message that it hears; None: nothing does."""
    publishers: tuple[int | str, ...] = ()
    """All whom it hears."""
    seed: int = 0
    clock: tuple[float, float] | None = None
    """An own clock: seconds ahead, and seconds that it gains in a second; None: the swarm's."""


NO_SCRIPT: Final = AgentScript()


class ScriptedOrder(NamedTuple):
    """An order of the scenario."""

    at_s: float
    line: str
    may_be_refused: bool = False
    """Else a refusal fails the run."""
    expelled: frozenset[int] = frozenset()
    """The agents that were when it was given: an order to all is not for them."""


@dataclass(frozen=True, slots=True)
class StationScript:
    """What the operator does, and when the station is killed."""

    orders: tuple[ScriptedOrder, ...] = ()
    ends_s: float = 0.0
    """From here on he lands whoever holds."""
    killed_s: float | None = None


@dataclass(frozen=True, slots=True)
class RunScript:
    """Of all processes."""

    agents: dict[int, AgentScript]
    station: StationScript
    text: str
    """The scenario's file."""


class ScriptedAgent:
    """What befalls an agent, in its own process. `now`: the swarm's mission time [s]."""

    def __init__(self, script: AgentScript, now: Callable[[], float]) -> None:
        self._due = list(script.due)
        self._script, self._now = script, now
        self._clock = script.clock or (0.0, 0.0)
        self._silent: Counter[str] = Counter()
        self._transport: ImpairedTransport | None = None
        self._untruth: Untruth | None = None
        self.stopped = False
        """It stands still: it does nothing, and takes nothing in."""
        self.killed = False
        """It is to end now."""

    def wrap(self, transport: Transport) -> Transport:
        """What the agent hears by."""
        script = self._script
        if script.mesh is None:
            return transport
        self._transport = ImpairedTransport(
            transport, script.publishers, script.mesh, self._now, script.seed
        )
        return self._transport

    def own_time(self, swarm_s: float) -> float:
        """What the agent's clock shows."""
        if self._script.clock is None:
            return swarm_s
        ahead_s, drift = self._clock
        return swarm_s * (1.0 + drift) + ahead_s

    def told(self, state: AgentState) -> AgentState:
        """The agent's state as it tells it."""
        return state if self._untruth is None else self._untruth.of(state)

    def turn(self, now: float) -> None:
        """At the end of a tick."""
        while self._due and self._due[0].at_s <= now + _ROUNDING_S:
            self._do(self._due.pop(0))

    def _do(self, due: Due) -> None:
        match due.deed:
            case Deed.KILL:
                self.killed = True
            case Deed.STOP | Deed.GO_ON:
                self.stopped = due.deed is Deed.STOP
            case Deed.PART | Deed.JOIN:
                by = 1 if due.deed is Deed.PART else -1
                for name in due.names:
                    self._silent[name] += by
                if self._transport is not None:
                    self._transport.silent = {name for name, times in self._silent.items() if times}
            case Deed.CLOCK:
                ahead_s, drift = self._clock
                self._clock = (ahead_s + due.ahead_s, drift)
            case Deed.SAY:
                self._untruth = due.untruth


@dataclass(slots=True)
class Holding:
    """Since when the swarm holds, for an operator who lands it in the end: it would hold until its
    batteries are low."""

    ends_s: float
    _since_s: float | None = None

    def lands(self, holds: bool, now: float) -> bool:
        """Once a tick: whether `land` is to be ordered now."""
        if not holds:
            self._since_s = None
            return False
        self._since_s = now if self._since_s is None else self._since_s
        if now < max(self.ends_s, self._since_s + HELD_S):
            return False
        self._since_s = now
        return True


@dataclass(slots=True)
class Excused:
    """The agents that need not accept a scenario's order: all, once each has ended by what was last
    heard of it; and of an order to all, those that the scenario has expelled."""

    _phases: dict[int, Phase] = field(default_factory=dict)
    _expelled: set[int] = field(default_factory=set)

    def hear(self, states: Iterable[AgentState]) -> None:
        """Once a tick."""
        self._phases |= {state.agent: state.phase for state in states}

    def gave(self, command: Command) -> None:
        """An order was given."""
        if command.kind == CommandKind.EXPEL:
            self._expelled.update(command.about)
        elif command.kind == CommandKind.READMIT:
            self._expelled.difference_update(command.about)

    def of(self, order: ScriptedOrder) -> ScriptedOrder:
        """The order, with who is excused now."""
        over = set(self._phases.values()) == {Phase.ENDED}
        may_be = order.may_be_refused or over
        return order._replace(may_be_refused=may_be, expelled=frozenset(self._expelled))


def holds(states: Iterable[AgentState]) -> bool:
    """An order, or a policy, keeps one of these from going on."""
    return any(state.override or state.phase is Phase.HOLD for state in states)
