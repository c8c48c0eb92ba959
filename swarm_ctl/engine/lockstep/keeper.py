"""The keeper of mission time: grants tick after tick, each when all members have done the one
before. It knows no mission and no message; it counts."""

from __future__ import annotations

import math
import os
import selectors
import socket
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.lockstep.words import (
    LONGEST,
    Done,
    TickPhase,
    TickWord,
    Word,
    pack_json,
    pack_tick,
    packets,
    read_done,
    read_json,
)

_TELL_WALL_S: Final = 1.0
"""Between two signs of life to those that wait."""
_STATIONS_FACTOR: Final = 10.0
"""Mission seconds per second when only stations are left, which wait for silent agents."""
_PEER: Final = struct.Struct("3i")
"""A Unix peer's process, user, group."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What a run asks of its clock."""

    tick_s: float
    expected: tuple[str, ...]
    """The members without which the clock does not start, in the order of their numbers."""
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
    name: str = ""
    phase: TickPhase = TickPhase.SWARM
    port: int = 0
    """Its end of the vehicle's link; 0: it has none, so it is no agent."""
    state: KeeperState = KeeperState.JOINING
    anew: bool = True
    since_wall_s: float = 0.0

    @property
    def live(self) -> bool:
        """It takes part."""
        return self.state in (KeeperState.IDLE, KeeperState.RUNNING)


class _Stage(IntEnum):
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
        self._dones: dict[int, Done] = {}
        """What each member did in its newest tick, also if it has left in that; by number."""
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
        for key, _ in self._selector.select(self._timeout_s()):
            key.data(key.fileobj)
        self._look_after()
        self._advance()

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
        if not data:
            self._leave(member)
            return
        try:
            self._take(member, data)
        except (ValueError, KeyError, struct.error):  # no member of ours
            self._leave(member)

    def _take(self, member: KeptMember, data: bytes) -> None:
        match data[0]:
            case Word.DONE:
                self._done(member, read_done(data))
            case Word.JOIN:
                self._join(member, read_json(data))
            case Word.READY:
                member.state = KeeperState.IDLE
            case Word.NOTE:
                self._note(f"{member.name}: {data[1:].decode()}")
            case Word.DROP:
                self._put(data[1:].decode(), KeeperState.STALLED)
            case Word.TAKE:
                self._put(data[1:].decode(), KeeperState.IDLE)

    def _join(self, member: KeptMember, fields: dict[str, Any]) -> None:
        member.name, member.port = fields["name"], fields["port"]
        member.phase = TickPhase(fields["phase"])
        if member.name in self._missing:
            self._missing.remove(member.name)
            member.number = self._rules.expected.index(member.name)
        else:
            member.number, self._numbers = self._numbers, self._numbers + 1
        started = self._stage is not _Stage.START
        live = [(m.number, m.name) for m in self._members if m.live]
        others = live if started else list(enumerate(self._rules.expected))
        about = {"tick_s": self._rules.tick_s, "tick": self._tick, "late": started}
        self._send(member, pack_json(Word.WELCOME, number=member.number, others=others, **about))

    def _leave(self, member: KeptMember) -> None:
        self._selector.unregister(member.socket)
        member.socket.close()
        self._members.remove(member)
        if member.name in self._missing:
            self._missing.remove(member.name)

    def _done(self, member: KeptMember, done: Done) -> None:
        if member.state is KeeperState.STALLED:
            member.anew = True
            self._note(f"{member.name} is back; it takes part again from {self._time()}")
        self._dones[member.number] = done
        member.state = KeeperState.LEFT if done.last else KeeperState.IDLE

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
            joined = (
                member.state is KeeperState.JOINING and member.number >= 0
            )  # its welcome is sent
            if joined or member.state is KeeperState.IDLE:
                self._send(member, bytes([Word.WAIT]))
            if member.state is not KeeperState.RUNNING or member.phase is TickPhase.AFTER:
                continue
            if now - member.since_wall_s > patience:
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
        if self._stage is _Stage.NEXT:
            left = min(left, self._due_wall_s - wall.wall_s())
        return max(0.0, left)

    def _advance(self) -> None:
        """As far as members have come."""
        while True:
            match self._stage:
                case _Stage.START:
                    joining = any(m.state is KeeperState.JOINING for m in self._members)
                    if self._missing or joining or not self._members:
                        return
                    self._stage = _Stage.NEXT
                case _Stage.WORLD:
                    if self._running(TickPhase.WORLD, TickPhase.SWARM):
                        return
                    self._grant(TickPhase.SWARM, self._tick - 1)
                    self._stage = _Stage.SWARM
                case _Stage.SWARM:
                    running = self._running(TickPhase.SWARM)
                    if any(m.port for m in running):
                        return
                    if running and any(
                        m.live and m.phase is TickPhase.AFTER for m in self._members
                    ):
                        return
                    self._grant(TickPhase.AFTER, self._tick)
                    self._stage = _Stage.AFTER
                case _Stage.AFTER:
                    if self._running(TickPhase.AFTER):
                        return
                    self._stage = _Stage.NEXT
                case _Stage.NEXT:
                    if not self._next():
                        return

    def _next(self) -> bool:
        """Begin the next tick, if it is time."""
        if not any(m.live for m in self._members):
            self._due_wall_s = math.inf
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
        self._dones = {i: d for i, d in self._dones.items() if d.number == self._tick}
        self._tick += 1
        self._stage = _Stage.WORLD
        self._grant(TickPhase.WORLD, self._tick - 1)
        return True

    def _running(self, *phases: TickPhase) -> Iterable[KeptMember]:
        return [m for m in self._members if m.state is KeeperState.RUNNING and m.phase in phases]

    def _grant(self, phase: TickPhase, heard: int) -> None:
        ready = [m for m in self._members if m.state is KeeperState.IDLE and m.phase is phase]
        if not ready:
            return
        agents = sum(m.live and m.port > 0 for m in self._members)
        dones = {i: done for i, done in self._dones.items() if done.number == heard}
        published = [(i, *item) for i, done in dones.items() for item in done.published.items()]
        counts = {port: n for done in self._datagrams(phase) for port, n in done.datagrams.items()}
        packed = {
            anew: pack_tick(TickWord(self._tick, heard, anew, agents, published, counts))
            for anew in {m.anew for m in ready}
        }
        now = wall.wall_s()
        for member in ready:
            member.state, member.since_wall_s = KeeperState.RUNNING, now
            self._send(member, packed[member.anew])
            member.anew = False

    def _datagrams(self, phase: TickPhase) -> Iterable[Done]:
        """Of the vehicles' links, what the other side has sent in its newest turn."""
        world = {m.number for m in self._members if m.phase is TickPhase.WORLD}
        newest = self._tick - (phase is TickPhase.WORLD)
        return [
            done
            for i, done in self._dones.items()
            if done.number == newest and (i in world) is not (phase is TickPhase.WORLD)
        ]

    @staticmethod
    def _send(member: KeptMember, data: bytes) -> None:
        try:
            member.socket.send(data)
        except OSError:  # it is gone, or does not read: its end of file or its silence tells
            return
