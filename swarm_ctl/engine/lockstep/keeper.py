"""The keeper of mission time: grants tick after tick, each when all members have done the one
before. It knows no mission and no message; it passes on who said how many."""

from __future__ import annotations

import os
import select
import selectors
import socket
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.lockstep.words import LONGEST, TickPhase, packed, packets, read

_TELL_WALL_S: Final = 1.0
"""Between two signs of life to those that wait."""
_WORDS_WALL_S: Final = 0.05
"""While it waits for one member, it looks so often for the words of the others."""
_AGAIN_WALL_S, _AGAIN_MOST_WALL_S, _FEW = 0.05, 2.0, 8
"""Between two requests to say the same again. What one says all get: with more than a few members,
the pause grows by the square of their number, as the messages do."""
_STATIONS_FACTOR: Final = 10.0
"""Mission seconds per second when only stations are left, which wait for silent agents."""
_PEER: Final = struct.Struct("3i")
"""A Unix peer's process, user, group."""
_ROLL_CALL_TICKS: Final = 1
"""Up to this tick the mesh's links may still open, and nobody is taken for stopped."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What a run asks of its clock."""

    tick_s: float
    expected: tuple[str, ...]
    """The members without which the clock does not start, in the order in which they are heard."""
    factor: float | None = None
    """Mission seconds per second of the wall clock at most; None: as fast as it goes."""
    patience_wall_s: float = 10.0
    """The clock does not wait longer for a member."""


class KeeperState(IntEnum):
    """What a member does."""

    JOINING = 0
    IDLE = 1
    """It waits for a tick."""
    RUNNING = 2
    STALLED = 3
    """It has not done its tick for so long that the clock goes on without it."""
    LEFT = 4
    """It has done its last tick."""


@dataclass(slots=True, eq=False)
class KeptMember:
    """One process at the barrier."""

    socket: socket.socket
    number: int = -1
    """The order in which the members are heard."""
    name: str = ""
    phase: TickPhase = TickPhase.SWARM
    port: int = 0
    """Its end of the vehicle's link; 0: it has none, so it is no agent."""
    state: KeeperState = KeeperState.JOINING
    anew: bool = True
    since_wall_s: float = 0.0
    again_wall_s: float = 0.0

    @property
    def live(self) -> bool:
        """It takes part."""
        return self.state in (KeeperState.IDLE, KeeperState.RUNNING)


class _Stage(IntEnum):
    """What the keeper waits for."""

    START = 0
    WORLD = 1
    SWARM = 2
    AFTER = 3
    NEXT = 4


class Keeper:
    """Serves members at `name` (of the abstract name space) until all have left and `over` was set.

    `note` gets lines for the operator.
    """

    def __init__(self, rules: Rules, name: str, note: Callable[[str], None]) -> None:
        self._rules = rules
        self._note = note
        self._listener = packets()
        self._listener.bind("\0" + name)
        self._listener.listen(128)
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)
        self._members: list[KeptMember] = []
        self._missing = list(rules.expected)
        self._numbers = len(rules.expected)
        self._stage = _Stage.START
        self._tick = 0
        self._dones: dict[int, dict[str, Any]] = {}
        """What each member did in its newest tick, also if it has left in that; by number."""
        self._speakers: dict[str, KeptMember] = {}
        """Who speaks under each key."""
        self._due_wall_s = self._tell_wall_s = 0.0
        self.over = False
        """No member will come any more."""

    def watch(self, descriptor: Any, ready: Callable[[], None]) -> None:
        """Call `ready` when there is something to read."""
        self._selector.register(descriptor, selectors.EVENT_READ, lambda _: ready())

    def unwatch(self, descriptor: Any) -> None:
        """Do not any more."""
        self._selector.unregister(descriptor)

    def serve(self) -> None:
        """Until it is over."""
        while self._members or not self.over:
            self.turn()

    def turn(self) -> None:
        """Wait for words, at most until something is due, and do what follows from them."""
        wait_s = self._timeout_s()
        if waited_for := self._waited_for():
            # The one that was granted last ends last, most often: one wait instead of one for each.
            select.select([waited_for[-1].socket], [], [], min(wait_s, _WORDS_WALL_S))
            wait_s = 0.0
        for key, _ in self._selector.select(wait_s):
            key.data(key.fileobj)
        self._look_after()
        while self._advance():
            pass

    def close(self) -> None:
        """Leave all members to themselves."""
        for member in self._members:
            member.socket.close()
        self._listener.close()
        self._selector.close()

    # --- members come, speak, and go ---

    def _accept(self, listener: socket.socket) -> None:
        connected, _ = listener.accept()
        peer = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        if _PEER.unpack(peer)[1] != os.getuid():  # this name space knows no permissions
            connected.close()
            return
        connected.setblocking(False)
        member = KeptMember(connected)
        self._members.append(member)
        self._selector.register(connected, selectors.EVENT_READ, lambda _: self._hear(member))

    def _hear(self, member: KeptMember) -> None:
        try:
            data = member.socket.recv(LONGEST)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        try:
            if data:
                self._take(member, read(data))
                return
        except (ValueError, KeyError, TypeError, AttributeError):  # no member of ours
            pass
        self._leave(member)

    def _take(self, member: KeptMember, word: dict[str, Any]) -> None:
        if "done" in word:
            self._done(member, word)
        elif "ask" in word:
            self._ask(word["ask"], word["keys"])
        elif "join" in word:
            self._join(member, word)
        elif "note" in word:
            self._note(f"{member.name}: {word['note']}")
        elif "drop" in word:
            self._put(word["drop"], KeeperState.STALLED)
        else:
            self._put(word["take"], KeeperState.IDLE)

    def _join(self, member: KeptMember, word: dict[str, Any]) -> None:
        member.name, member.port = str(word["join"]), int(word["port"])
        member.phase = TickPhase(word["phase"])
        if member.name in self._missing:
            self._missing.remove(member.name)
            member.number = self._rules.expected.index(member.name)
        else:
            member.number, self._numbers = self._numbers, self._numbers + 1
        member.state = KeeperState.IDLE
        self._send(member, packed(tick_s=self._rules.tick_s, now=self._tick))

    def _leave(self, member: KeptMember) -> None:
        self._selector.unregister(member.socket)
        member.socket.close()
        self._members.remove(member)
        if member.name in self._missing:
            self._missing.remove(member.name)

    def _done(self, member: KeptMember, word: dict[str, Any]) -> None:
        if member.state is KeeperState.STALLED:
            member.anew = True
            self._note(f"{member.name} is back; it takes part again from {self._time()}")
        self._dones[member.number] = word
        self._speakers |= dict.fromkeys(word["said"], member)
        member.state = KeeperState.LEFT if word.get("last") else KeeperState.IDLE

    def _ask(self, tick: int, keys: Sequence[str]) -> None:
        """What a member has not heard is said again, to all."""
        now, count = wall.wall_s(), len(self._members)
        pause_s = min(_AGAIN_MOST_WALL_S, _AGAIN_WALL_S * max(1.0, count / _FEW) ** 2)
        wanted: dict[KeptMember, list[str]] = {}
        for key in keys:
            wanted.setdefault(self._speakers[key], []).append(key)
        for member, lacking in wanted.items():
            if now >= member.again_wall_s:
                member.again_wall_s = now + pause_s
                self._send(member, packed(again=tick, keys=lacking))

    def _put(self, name: str, state: KeeperState) -> None:
        """A test holds the clock, so the member waits for its next tick."""
        for member in self._members:
            if member.name == name and member.state in (KeeperState.IDLE, KeeperState.STALLED):
                member.state, member.anew = state, True

    def _look_after(self) -> None:
        """Go on without members that are stalled; tell the others that the keeper lives."""
        now = wall.wall_s()
        if now < self._tell_wall_s:
            return
        self._tell_wall_s = now + _TELL_WALL_S
        patience = self._rules.patience_wall_s
        for member in self._members:
            if member.state is KeeperState.IDLE:
                self._send(member, packed())
            if member.state is not KeeperState.RUNNING or member.phase is TickPhase.AFTER:
                continue
            if self._tick > _ROLL_CALL_TICKS and now - member.since_wall_s > patience:
                member.state = KeeperState.STALLED
                self._note(
                    f"{member.name} has not done its tick for {patience:g} s of the wall clock:"
                    f" mission time goes on without it from {self._time()}"
                )

    def _time(self) -> str:
        return f"{self._tick * self._rules.tick_s:.2f} s"

    # --- time ---

    def _timeout_s(self) -> float:
        left = self._tell_wall_s - wall.wall_s()
        if self._stage is _Stage.NEXT and self._any_live():
            left = min(left, self._due_wall_s - wall.wall_s())
        return max(0.0, left)

    def _any_live(self) -> bool:
        return any(m.live for m in self._members)

    def _waited_for(self) -> list[KeptMember]:
        """The members that hold up the stage. The world does not wait for stations, unless a test
        is to come between."""
        running = [m for m in self._members if m.state is KeeperState.RUNNING]
        match self._stage:
            case _Stage.WORLD:
                return running
            case _Stage.SWARM:
                agents = [m for m in running if m.port]
                tested = any(m.live and m.phase is TickPhase.AFTER for m in self._members)
                return running if tested and not agents else agents
            case _Stage.AFTER:
                return [m for m in running if m.phase is TickPhase.AFTER]
        return []

    def _advance(self) -> bool:
        """To the next stage, if its members have come so far."""
        if self._stage is _Stage.START:
            if self._missing:
                return False
            self._stage = _Stage.WORLD  # of tick 0, which has none
        if self._waited_for():
            return False
        match self._stage:
            case _Stage.WORLD:
                self._grant(TickPhase.SWARM, self._tick - 1)
            case _Stage.SWARM:
                self._grant(TickPhase.AFTER, self._tick)
            case _Stage.NEXT:
                return self._next()
        self._stage = _Stage(self._stage + 1)
        return True

    def _next(self) -> bool:
        """Begin the next tick, if it is time."""
        if not self._any_live():
            return False
        alone = not any(m.port or m.phase is TickPhase.WORLD for m in self._members)
        factor = _STATIONS_FACTOR if alone else self._rules.factor
        now = wall.wall_s()
        if factor is not None:
            period = self._rules.tick_s / factor
            if self._due_wall_s > now + period:  # it was not due at all
                self._due_wall_s = now
            if now < self._due_wall_s:
                return False
            self._due_wall_s = max(self._due_wall_s, now - period) + period
        self._tick += 1
        self._stage = _Stage.WORLD
        self._grant(TickPhase.WORLD, self._tick - 1)
        return True

    def _grant(self, phase: TickPhase, heard: int) -> None:
        ready = [m for m in self._members if m.state is KeeperState.IDLE and m.phase is phase]
        if not ready:
            return
        is_world = phase is TickPhase.WORLD
        worlds = {m.number for m in self._members if m.phase is TickPhase.WORLD}
        said: dict[str, int] = {}
        sent: dict[str, int] = {}
        for number, done in sorted(self._dones.items()):
            if done["done"] == heard and not is_world:
                said |= done["said"]
            if done["done"] == self._tick - is_world and (number in worlds) is not is_world:
                sent |= done["sent"]
        agents = sum(m.live and m.port > 0 for m in self._members)
        word = {"tick": self._tick, "heard": heard, "agents": agents, "said": said, "sent": sent}
        packets = {anew: packed(anew=anew, **word) for anew in {m.anew for m in ready}}
        now = wall.wall_s()
        for member in ready:
            member.state, member.since_wall_s = KeeperState.RUNNING, now
            self._send(member, packets[member.anew])
            member.anew = False

    @staticmethod
    def _send(member: KeptMember, data: bytes) -> None:
        try:
            member.socket.send(data)
        except OSError:  # it is gone, or does not read: its end of file or its silence tells
            return
