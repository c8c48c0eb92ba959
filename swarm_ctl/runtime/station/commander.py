"""Sends an operator's commands until everybody has answered; a `tune` in its two phases
(`core/swarm/gain_update.py`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from swarm_ctl.core.model.messages import Ack, Command
from swarm_ctl.core.swarm.gain_update import GainUpdateRound

_REPEAT_S: Final = 0.5
_AT_MOST_S: Final = 10.0


class Commander:
    """One sender's open commands. Times are the sender's mission clock; `repeat_s` is between two
    tries."""

    def __init__(
        self, send: Callable[[Command], None], agents: list[int], repeat_s: float = _REPEAT_S
    ) -> None:
        self._send = send
        self._agents = agents
        self._repeat_s = repeat_s
        self._open: dict[str, tuple[Command, set[int], float]] = {}
        self._rounds: list[GainUpdateRound] = []
        self._due = 0.0

    def give(self, command: Command, now: float) -> None:
        """Send a command to the agents it is meant for, from the next `turn` on."""
        self._open[command.id] = (command, set(command.agents or self._agents), now)
        self._due = now
        if command.kind == "tune":
            self._rounds.append(GainUpdateRound(command))

    def answered(self, ack: Ack) -> None:
        """An acknowledgement came."""
        if ack.command in self._open:
            self._open[ack.command][1].discard(ack.agent)
        for change in self._rounds:
            change.hear(ack)

    def turn(self, now: float) -> tuple[list[Command], list[str]]:
        """Send what is due. What was given by itself (the second phase of a change), and what is to
        be said."""
        followed, said = [], []
        for change in self._rounds:
            follows = change.decide(now)
            if follows is not None:
                self.give(follows, now)
                followed.append(follows)
            if change.failed:
                self._open.pop(change.ask.id, None)
                said.append(f"tune: nothing changes; {change.failed}")
        self._rounds = [change for change in self._rounds if not change.over]
        self._repeat(now)
        return followed, said

    def _repeat(self, now: float) -> None:
        """Send what is not answered yet again; give up after 10 s."""
        if now < self._due:
            return
        self._due = now + self._repeat_s
        for key, (command, missing, since) in list(self._open.items()):
            if not missing or now - since > _AT_MOST_S:
                del self._open[key]
            else:
                self._send(command)
