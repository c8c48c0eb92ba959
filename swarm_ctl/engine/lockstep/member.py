"""A process's line to the keeper of mission time."""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeAlias

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.words import LONGEST, TickPhase, TickWord, packed, packets, read
from swarm_ctl.errors import StartError

_JOIN_WALL_S: Final = 10.0
_SILENT_WALL_S: Final = 20.0
"""The keeper speaks every second to those that wait for it; after so long a wait it is given up, by
all members at once."""
_OWN_WALL_S: Final = 1.0
"""What a process does between two waits; of a longer time, it was stopped itself."""
_LEAST_WALL_S: Final = 1e-6
"""A socket takes a wait of zero for a wait without end."""
SayAgain: TypeAlias = Callable[[int, Sequence[str]], None]
"""Say again what was said in a tick under these keys."""


class KeeperGoneError(Exception):
    """The keeper has ended, or hangs."""


class SteppedClock(Clock):
    """Mission time [s] that stands still between ticks. Without a keeper it goes on by the wall
    clock, `speedup` times as fast."""

    stepped = True

    def __init__(self, speedup: float) -> None:
        super().__init__(0.0, speedup)
        self._now: float | None = 0.0

    def now(self) -> float:
        return super().now() if self._now is None else self._now

    def set(self, mission_s: float) -> None:
        """It is so late now."""
        self._now = mission_s

    def let_run(self) -> None:
        """From now on by the wall clock."""
        if self._now is not None:
            self.epoch_s = wall.wall_s() - self._now / self.speedup
            self._now = None


class LockstepMember:
    """Joins the keeper at `address` as `name`; StartError where there is none.

    `port`: the UDP port that an agent speaks to its vehicle from. `say_again`: what it does when
    another member has not heard all of it.
    """

    def __init__(
        self,
        address: str,
        name: str,
        phase: TickPhase,
        port: int = 0,
        say_again: SayAgain = lambda _tick, _keys: None,
    ) -> None:
        self._socket = packets()
        self._say_again = say_again
        self._waits_s = 0.0
        self._silent_s, self._looked_wall_s = 0.0, wall.wall_s()
        try:
            self._socket.connect("\0" + address)
            self._send(join=name, phase=phase, port=port)
            about = self._welcome()
        except (OSError, KeeperGoneError) as error:
            self._socket.close()
            raise StartError(f"the run's clock does not answer: {error}") from None
        self.tick_s: Final[float] = about["tick_s"]
        self.tick: int = about["now"]

    def _welcome(self) -> dict[str, Any]:
        until = wall.wall_s() + _JOIN_WALL_S
        while wall.wall_s() < until:
            word = self._receive(1.0)
            if "tick_s" in word:
                return word
        raise KeeperGoneError("no welcome")

    def wait(self, wall_seconds: float) -> TickWord | None:
        """The next tick to run; None: not yet. KeeperGoneError at its end, or when it is silent."""
        word = self._receive(wall_seconds)
        if "tick" in word:
            self.tick = word["tick"]
            return TickWord(**word)
        if "again" in word:
            self._say_again(word["again"], word["keys"])
        return None

    def done(self, said: Mapping[str, int], sent: Mapping[str, int], *, last: bool = False) -> None:
        """The tick is done: so many messages by key, so many datagrams by port."""
        self._send(done=self.tick, said=said, sent=sent, last=last)

    def ask(self, tick: int, keys: Sequence[str]) -> None:
        """Have said again what was said in a tick under these keys."""
        self._send(ask=tick, keys=keys)

    def note(self, text: str) -> None:
        """A line for the operator."""
        with contextlib.suppress(KeeperGoneError):
            self._send(note=text)

    def drop(self, name: str) -> None:
        """Do not wait for this member. Of a test, in its turn."""
        self._send(drop=name)

    def take(self, name: str) -> None:
        """Wait for this member again. Of a test, in its turn."""
        self._send(take=name)

    def close(self) -> None:
        """Leave."""
        self._socket.close()

    def _receive(self, wall_seconds: float) -> dict[str, Any]:
        """The next word; empty when none comes in time."""
        try:
            data = self._socket.recv(LONGEST, self._waits(wall_seconds))
        except BlockingIOError:
            now, most_s = wall.wall_s(), wall_seconds + _OWN_WALL_S
            if wall_seconds > 0.0:  # else it does not wait for the keeper, but for others
                self._silent_s += min(now - self._looked_wall_s, most_s)
            self._looked_wall_s = now
            if self._silent_s >= _SILENT_WALL_S:
                raise KeeperGoneError("it is silent") from None
            return {}
        except OSError:
            data = b""
        if not data:
            raise KeeperGoneError("it has ended")
        self._silent_s, self._looked_wall_s = 0.0, wall.wall_s()
        return read(data)

    def _waits(self, wall_seconds: float) -> int:
        """The kernel bounds the wait: one call for each packet."""
        if wall_seconds <= 0.0:
            return socket.MSG_DONTWAIT
        if wall_seconds != self._waits_s:
            self._waits_s = wall_seconds
            us = round(max(wall_seconds, _LEAST_WALL_S) * 1e6)
            pair = struct.pack("@ll", us // 1_000_000, us % 1_000_000)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, pair)
        return 0

    def _send(self, **word: Any) -> None:
        try:
            self._socket.send(packed(**word))
        except OSError as error:
            raise KeeperGoneError(str(error)) from None
