"""A process's line to the keeper of mission time."""

from __future__ import annotations

import contextlib
import select
from collections.abc import Mapping
from typing import Any, Final

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.words import (
    LONGEST,
    Done,
    TickPhase,
    TickWord,
    Word,
    pack_done,
    pack_json,
    packets,
    read_json,
    read_tick,
)
from swarm_ctl.errors import StartError

_JOIN_WALL_S: Final = 10.0
_SILENT_WALL_S: Final = 20.0
"""The keeper speaks every second; after so long it is given up, by all members at once."""


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

    `port`: the UDP port that an agent speaks to its vehicle from.
    """

    def __init__(self, address: str, name: str, phase: TickPhase, port: int = 0) -> None:
        self._socket = packets()
        self._wall_s = wall.wall_s()
        try:
            self._socket.connect("\0" + address)
            self._send(pack_json(Word.JOIN, name=name, phase=phase, port=port))
            about = self._welcome()
        except (OSError, KeeperGoneError) as error:
            self._socket.close()
            raise StartError(f"the run's clock does not answer: {error}") from None
        self.number: Final[int] = about["number"]
        self.others: Final[dict[int, str]] = dict(about["others"])
        """The other members' names, by their numbers."""
        self.others.pop(self.number, None)
        self.tick_s: Final[float] = about["tick_s"]
        self.late: Final[bool] = about["late"]
        """It joins a flight that has begun."""
        self.tick: int = about["tick"]

    def _welcome(self) -> dict[str, Any]:
        until = wall.wall_s() + _JOIN_WALL_S
        while wall.wall_s() < until:
            data = self._receive(1.0)
            if data and data[0] == Word.WELCOME:
                return read_json(data)
        raise KeeperGoneError("no welcome")

    def ready(self) -> None:
        """Every member that has to be heard is."""
        self._send(bytes([Word.READY]))

    def wait(self, wall_seconds: float) -> TickWord | None:
        """The next tick to run; None: not yet. KeeperGoneError at its end, or when it is silent."""
        data = self._receive(wall_seconds)
        if data and data[0] == Word.TICK:
            tick = read_tick(data)
            self.tick = tick.number
            return tick
        return None

    def done(
        self, published: Mapping[int, int], datagrams: Mapping[int, int], *, last: bool = False
    ) -> None:
        """The tick is done: so many messages by channel, so many datagrams by port."""
        self._send(pack_done(Done(self.tick, last, published, datagrams)))

    def note(self, text: str) -> None:
        """A line for the operator."""
        with contextlib.suppress(KeeperGoneError):
            self._send(bytes([Word.NOTE]) + text.encode())

    def drop(self, name: str) -> None:
        """Do not wait for this member. Of a test, in its turn."""
        self._send(bytes([Word.DROP]) + name.encode())

    def take(self, name: str) -> None:
        """Wait for this member again. Of a test, in its turn."""
        self._send(bytes([Word.TAKE]) + name.encode())

    def close(self) -> None:
        """Leave."""
        self._socket.close()

    def fileno(self) -> int:
        """To wait for."""
        return self._socket.fileno()

    def _receive(self, wall_seconds: float) -> bytes:
        """The next packet; b"" when none comes in time."""
        if not select.select([self._socket], [], [], wall_seconds)[0]:
            if wall.wall_s() - self._wall_s >= _SILENT_WALL_S:
                raise KeeperGoneError("it is silent")
            return b""
        try:
            data = self._socket.recv(LONGEST)
        except OSError:
            data = b""
        if not data:
            raise KeeperGoneError("it has ended")
        self._wall_s = wall.wall_s()
        return data

    def _send(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except OSError as error:
            raise KeeperGoneError(str(error)) from None
