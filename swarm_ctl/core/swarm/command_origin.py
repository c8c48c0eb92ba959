"""Whether a command is new: by its sender's clock, and by its sender's own count of commands.

A command that was recorded and is sent again is old, or its number was used. A sender that repeats
a command until all have answered repeats its id and number, too: `CommandHandler` answers that one
as before. Numbers may come out of order, because one command may wait for an answer while the next
one is sent.
"""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.messages import Command

FRESH_COMMAND_S: Final = 15.0
"""A command is repeated for 10 s at most, and clocks are told apart by seconds. At `--speedup 4` it
is 60 s of mission time: the sender repeats by the wall clock."""
_STATIONS_KEPT: Final = 64
_NUMBERS_KEPT: Final = 64


class CommandOrigins:
    """What one agent knows of the senders of commands."""

    def __init__(self, own_id: int, speedup: float) -> None:
        self._own = own_id
        self._fresh_s = FRESH_COMMAND_S * max(1.0, speedup)
        self._numbers: dict[str, list[int]] = {}
        """By station, the newest ones, sorted."""

    def refusal(self, command: Command, now: float) -> str:
        """Why the command is not new; '' where it is, and then its number is used."""
        old_s = now - command.time_s - dict(command.ahead_s).get(self._own, 0.0)
        if not abs(old_s) <= self._fresh_s:
            when = f"{old_s:.0f} s old" if old_s > 0 else f"from {-old_s:.0f} s ahead"
            return f"it is {when}, by its sender's clock; allowed: {self._fresh_s:g} s"
        used = self._numbers.pop(command.station, [])
        self._numbers[command.station] = used  # the newest station last
        if len(self._numbers) > _STATIONS_KEPT:
            del self._numbers[next(iter(self._numbers))]
        too_low = command.number <= 0 or (len(used) == _NUMBERS_KEPT and command.number < used[0])
        if too_low or command.number in used:
            what = f"number {command.number} of {command.station or 'its sender'}"
            return f"{what} was used by another command"
        used.append(command.number)
        used.sort()
        del used[:-_NUMBERS_KEPT]
        return ""
