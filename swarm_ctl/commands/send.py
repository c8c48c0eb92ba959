"""Sends a command again and again until every agent that is meant has answered; a `tune` in its two
phases (`core/swarm/gain_update.py`).

The commands are idempotent: an agent answers a repeated one as before, and does nothing more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from swarm_ctl.core.model.messages import Ack, Command
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.swarm.gain_update import ASKS, GainUpdateRound

REPEAT_WALL_S: Final = 0.5
GIVE_UP_WALL_S: Final = 10.0
"""Twenty tries: with half of all messages lost, each agent misses all of them once in a million."""


@dataclass(slots=True, repr=False)
class SentCommand:
    """A command on its way, and what the agents have answered."""

    command: Command
    """The newest one: a `tune` becomes an `apply` once all agents have prepared the change."""
    meant: tuple[int, ...]
    acks: dict[int, Ack] = field(default_factory=dict)
    """By agent."""
    failed: str = ""
    """Why a `tune` changes nothing although some agents accepted it."""
    over: bool = False
    """It is not sent any more."""
    asked: str = ""
    """The kind of the first one, as it was ordered: `tune`, not `apply`."""

    def __repr__(self) -> str:
        """`<hold: accepted by agents 1-3; refused by agent 4: why>`."""
        taken = [agent for agent, ack in self.acks.items() if ack.accepted]
        told = [f"accepted by {agents_named(taken)}"] if taken else []
        told += [f"refused by {agents_named(ids)}: {why}" for why, ids in self.refusals.items()]
        told += [f"no answer from {agents_named(self.silent)}"] if self.silent else []
        return f"<{self.asked or self.command.kind}: {self.failed or '; '.join(told)}>"

    @property
    def silent(self) -> tuple[int, ...]:
        """The agents that were meant and did not answer."""
        return tuple(agent for agent in self.meant if agent not in self.acks)

    @property
    def reasons(self) -> dict[int, str]:
        """Why, by agent that refused."""
        return {agent: ack.reason for agent, ack in self.acks.items() if not ack.accepted}

    @property
    def refusals(self) -> dict[str, list[int]]:
        """The agents that refused, by their reason, which names none of them."""
        found: dict[str, list[int]] = {}
        for agent, reason in sorted(self.reasons.items()):
            words = reason.removeprefix(f"agent {agent} ").removeprefix("is ")
            found.setdefault(words, []).append(agent)
        return found

    @property
    def accepted(self) -> bool:
        """Every agent that was meant has accepted it."""
        return not (self.failed or self.silent or self.reasons)


@dataclass(slots=True)
class _Open:
    """A command that is still sent. Times are the sender's mission clock [s]."""

    sent: SentCommand
    since_s: float
    due_s: float
    round: GainUpdateRound | None
    """The first phase of a `tune`: ends by a decision, not by a time-out."""


class CommandSender:
    """One sender's open commands: `publish` puts one on the mesh, to be answered by `agents`."""

    def __init__(
        self, publish: Callable[[Command], None], agents: Sequence[int], speedup: float = 1.0
    ) -> None:
        self._publish = publish
        self._agents = tuple(agents)
        self._repeat_s = REPEAT_WALL_S * speedup
        self._give_up_s = GIVE_UP_WALL_S * speedup
        self._open: list[_Open] = []
        self._number = 0

    def send(self, command: Command, now: float, meant: Sequence[int] = ()) -> SentCommand:
        """Send a command now, and again at each `turn` that it is due. `meant` must answer; if not
        given, the agents that it names, or all."""
        command = self._numbered(command)
        to = tuple(meant) or command.agents or self._agents
        sent = SentCommand(command, to, asked=command.kind)
        first_phase = GainUpdateRound(command) if command.kind in ASKS else None
        self._open.append(_Open(sent, now, now, first_phase))
        self._repeat(self._open[-1], now)
        return sent

    def hear(self, ack: Ack) -> None:
        """Take an answer to any command."""
        for entry in self._open:
            if ack.command == entry.sent.command.id and ack.agent in entry.sent.meant:
                entry.sent.acks[ack.agent] = ack
                if entry.round is not None:
                    entry.round.hear(ack)

    def turn(self, now: float) -> list[SentCommand]:
        """Send what is due, at most one, since a link takes no two at once (`zenoh_config.py`); the
        commands that have ended since the last turn."""
        for entry in self._open:
            self._advance(entry, now)
        due = [each for each in self._open if not each.sent.over and now >= each.due_s]
        if due:
            self._repeat(min(due, key=lambda each: each.due_s), now)
        ended = [entry.sent for entry in self._open if entry.sent.over]
        self._open = [entry for entry in self._open if not entry.sent.over]
        return ended

    def _advance(self, entry: _Open, now: float) -> None:
        sent = entry.sent
        if entry.round is None:
            sent.over = not sent.silent or now - entry.since_s > self._give_up_s
        elif (apply := entry.round.decide(now)) is not None:
            sent.command, sent.acks = self._numbered(apply), {}
            entry.since_s, entry.due_s, entry.round = now, now, None
        else:
            sent.failed = entry.round.failed
            sent.over = bool(sent.failed)

    def _numbered(self, command: Command) -> Command:
        """By its number, agents tell a new command from one that was recorded and sent again."""
        self._number += 1
        return replace(command, number=self._number)

    def _repeat(self, entry: _Open, now: float) -> None:
        entry.due_s = now + self._repeat_s
        self._publish(entry.sent.command)
