"""The commands that a station heard, with the answers to them. Only its sender repeats a command
until all have answered: an answer that any other station misses does not come again, but what the
agent then flies may say the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from swarm_ctl.commands.send import GIVE_UP_WALL_S, REPEAT_WALL_S
from swarm_ctl.core.model.messages import ENDING, Ack, AgentState, Command, CommandKind, Phase
from swarm_ctl.station.picture.view import CommandView

_KEPT: Final = 100
"""So many commands, and answers to so many that have not come: forged ones fill no memory."""
_BACK: Final = (CommandKind.RESUME, CommandKind.NEXT, CommandKind.READMIT)
"""By these an agent flies the mission again."""
_DOWN: Final[Mapping[str, tuple[Phase, ...]]] = {
    CommandKind.LAND: (Phase.LAND, Phase.ENDED),
    CommandKind.RETURN: (Phase.RETURN,),
    CommandKind.KILL: (Phase.ENDED,),
}


@dataclass(slots=True)
class Answered:
    """One command, and what is known of who obeys it."""

    command: Command
    received_s: float
    at_step: int
    """The furthest step of the agents that it is for, when it came."""
    overridden: frozenset[int]
    """The agents that flew another command when it came."""
    acks: dict[int, Ack]
    shown: set[int] = field(default_factory=set)
    """The agents whose states said later that they obey it."""

    def shows(self, state: AgentState) -> bool:
        """Whether an agent of this state obeys the command."""
        given, kind = self.command, self.command.kind
        flown = {state.override, state.gains_tag, state.next_gains_tag} - {0}
        if kind in _BACK:
            meant = kind != CommandKind.READMIT or state.agent in given.about
            return meant and not state.override and state.agent in self.overridden
        if kind in ENDING:
            return state.left == kind or state.phase in _DOWN[kind]
        return not flown.isdisjoint((given.tag, given.commits))


class CommandLog:
    """The last ones, oldest first. `speedup`: mission seconds per second of the wall clock."""

    def __init__(self, speedup: float) -> None:
        self._commands: dict[str, Answered] = {}
        self._early: dict[str, dict[int, Ack]] = {}
        """Answers to commands that have not come yet: each comes by a link of its own."""
        self._open: list[Answered] = []
        """Those that their senders may still repeat."""
        self._look_s = 2 * REPEAT_WALL_S * speedup
        """So long after a command, what an agent flies counts for its answer."""
        self._over_s = GIVE_UP_WALL_S * speedup

    def __iter__(self) -> Iterator[Answered]:
        return iter(self._commands.values())

    def hear(self, command: Command, received_s: float, states: Sequence[AgentState]) -> None:
        """A command came; `states`: the newest ones of the agents that it is for."""
        if command.id in self._commands:
            return
        at_step = max((state.step for state in states), default=0)
        overridden = frozenset(state.agent for state in states if state.override)
        acks = self._early.pop(command.id, {})
        new = Answered(command, received_s, at_step, overridden, acks)
        self._commands[command.id] = new
        self._open.append(new)
        while len(self._commands) > _KEPT:
            del self._commands[next(iter(self._commands))]

    def ack(self, ack: Ack) -> None:
        """An answer came."""
        known = self._commands.get(ack.command)
        acks = known.acks if known is not None else self._early.setdefault(ack.command, {})
        acks[ack.agent] = ack
        while len(self._early) > _KEPT:
            del self._early[next(iter(self._early))]

    def state(self, state: AgentState, received_s: float) -> None:
        """A newer state of an agent came."""
        if not self._open:
            return
        self._open = [each for each in self._open if received_s - each.received_s <= self._over_s]
        for each in self._open:
            late = received_s - each.received_s > self._look_s
            if late and state.agent not in each.acks and each.shows(state):
                each.shown.add(state.agent)

    def views(self, now_s: float) -> tuple[CommandView, ...]:
        """For a view at `now_s`."""
        return tuple(
            CommandView(
                each.command,
                each.received_s,
                dict(each.acks),
                frozenset(each.shown.difference(each.acks)),
                over=now_s - each.received_s > self._over_s,
            )
            for each in self
        )
