"""A process's place in a run: in real time, or at the barrier (lockstep). The one seam: a seat
makes clock, ticker, wire and mesh of its process; what uses them does not know which it is."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.member import KeeperGoneError, LockstepMember, SteppedClock
from swarm_ctl.engine.lockstep.words import TickPhase, TickWord
from swarm_ctl.engine.ticker import Ticker
from swarm_ctl.mavlink.stepped_wire import SteppedWire
from swarm_ctl.mavlink.wires import NameUnknownYetError, Wire, open_wire
from swarm_ctl.mesh.keys import CHANNELS, STATE, Channel
from swarm_ctl.mesh.stepped_transport import MarkedTransport, SteppedTransport
from swarm_ctl.mesh.transport import Transport

_LATE_WALL_S, _LATE_MOST_WALL_S = 2.0, 4.0
"""For a message or a datagram that another process says it has sent: of few members, and of a
crowd. A tick has two such waits, and the keeper takes one that waits for 10 s for stopped."""
_JOIN_WALL_S: Final = 10.0
"""For a process that joins a flight, to hear those that fly."""
_HELLO_WALL_S: Final = 0.05
_HELLO_MOST_WALL_S: Final = 2.0
"""From a member's hello to its next: of few members, and of a hundred; of more, in proportion."""
_AGAIN_WALL_S: Final = 0.25
"""A member that waits so long for a tick says hello again: another one may wait to know that it
hears what it has subscribed to."""
_NAMED_WALL_S, _NAME_AGAIN_WALL_S = 10.0, 0.2
"""For so long, and so often, a resolver is asked for the vehicle's host: six containers start
within 10 s, and each start makes the engine's resolver begin anew."""
_LOOK_WALL_S: Final = 0.0002
_FEW: Final = 8
"""Members that wait for the messages of more look less often: a hundred of them look at a hundred
others, and what they use up is what the last ones need to speak."""
_CROWD: Final = 16
"""Of more members each looks less often, whatever it waits for: 250 that look every 0.2 ms leave
the router no processor to bring what they look for."""
_HEARD_TICKS: Final = 2
"""From a tick to the grant that tells that all others have heard it."""
_WAIT_WALL_S: Final = 1.0
SLOW: Final = 0.1
"""A busy machine must not cut the mesh's links; a process that ends closes its own."""


class Seat:
    """Of a process in real time."""

    repeats = False
    """A flight is the same again: the node's name is, too, and its messages wait for a full queue
    rather than being dropped at once."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.mesh_speedup = clock.speedup
        """Of the mesh's own time-outs."""

    def wire(self, endpoint: str) -> Wire:
        """The wire to the own vehicle. LinkError where it can't be opened; a resolver that can't
        tell a name for now is asked again for some seconds."""
        until = wall.wall_s() + _NAMED_WALL_S
        while True:
            try:
                return open_wire(endpoint)
            except NameUnknownYetError:
                if wall.wall_s() > until:
                    raise
            wall.pause(_NAME_AGAIN_WALL_S)

    def mesh(self, transport: MarkedTransport) -> Transport:
        """What the own node speaks on."""
        return transport

    def join(self, name: str, swarm: str, node: int | str) -> None:
        """All is open: the own node may be heard."""

    def ticker(self, period_s: float, waiting: Callable[[], None]) -> Ticker:  # noqa: ARG002
        """The control loop's; it calls `waiting` now and then while it is kept waiting."""
        return Ticker(self.clock, period_s)

    def begin(self, wall_seconds: float) -> bool:
        """Wait, at most so long; whether it is the own turn now."""
        wall.pause(wall_seconds)
        return True

    def end(self, *, last: bool = False) -> None:
        """The own turn is over; `last`: for good."""

    def leave(self) -> None:
        """The last turn of all: what is still to be heard is given out now."""

    def close(self) -> None:
        """Leave."""


def take_seat(lockstep: str | None, phase: TickPhase, epoch_s: float, speedup: float) -> Seat:
    """In real time, or at the barrier of the keeper at the address `lockstep`."""
    if lockstep is None:
        return Seat(Clock(epoch_s, speedup))
    return BarrierSeat(lockstep, phase, speedup)


class BarrierSeat(Seat):
    """At the barrier. When the keeper is gone, mission time goes on by the wall clock."""

    repeats = True

    def __init__(self, address: str, phase: TickPhase, speedup: float) -> None:
        self._address, self._phase = address, phase
        self._stepped = SteppedClock(speedup)
        super().__init__(self._stepped)
        self.mesh_speedup = SLOW
        self._wire: SteppedWire | None = None
        self._mesh: SteppedTransport | None = None
        self.member: LockstepMember | None = None
        self._hello: Callable[[], None] = lambda: None
        self._hello_wall_s = 0.0
        self._assembled = False
        self._in_turn = False
        self._speaks: tuple[str, int | str] | None = None
        """The swarm and the own name, of an agent."""
        self._published: Sequence[tuple[int, int, int]] = ()
        """Of the tick before."""
        self.agents = 0
        """So many take part, as of the last tick."""

    def wire(self, endpoint: str) -> Wire:
        self._wire = SteppedWire(super().wire(endpoint))
        return self._wire

    def mesh(self, transport: MarkedTransport) -> Transport:
        self._mesh = SteppedTransport(transport)
        return self._mesh

    def join(self, name: str, swarm: str, node: int | str) -> None:
        port = self._wire.port if self._wire else 0
        self.member = member = LockstepMember(self._address, name, self._phase, port)
        channels = [c for c in CHANNELS if c.publisher == _publisher(name)]
        self._hello = lambda: self._say_hello(swarm, node, channels)
        self._speaks = (swarm, node) if _publisher(name) == STATE.publisher else None
        self._joined_wall_s = wall.wall_s()
        if self._mesh is not None:
            self._mesh.know(
                {
                    number: ("agent", other.removeprefix("agent-"))
                    for number, other in member.others.items()
                    if _publisher(other) == "agent"
                }
            )
        self._stepped.set(member.tick * member.tick_s)

    def _say_hello(self, swarm: str, node: int | str, channels: Iterable[Channel[Any]]) -> None:
        mesh, member = self._mesh, self.member
        if member is None or wall.wall_s() < self._hello_wall_s:
            return
        count = len(member.others)
        pause_s = _HELLO_WALL_S * max(1.0, count / _FEW) ** 2  # every hello goes to all
        most_s = _HELLO_MOST_WALL_S * max(1.0, count / 100)
        self._hello_wall_s = wall.wall_s() + min(pause_s, most_s)
        if mesh is not None:
            mesh.begin(member.number, 0)
            mesh.hello(swarm, node, channels)
        if not self._assembled and (mesh is None or self._hears_all(mesh, member)):
            self._assembled = True
            member.ready()

    def _hello_again(self, member: LockstepMember) -> None:
        """On the channel that others may follow."""
        if self._mesh is not None and self._speaks is not None:
            self._mesh.begin(member.number, 0)
            self._mesh.hello(*self._speaks, [STATE])
            self._mesh.begin(member.number, member.tick + 1)

    def _hears_all(self, mesh: SteppedTransport, member: LockstepMember) -> bool:
        """Whether every other member's hello has come, on each channel; those that fly already say
        none, so any message of theirs counts."""
        members: dict[str, list[int]] = {"agent": [], "station": []}
        for number, name in member.others.items():
            members.setdefault(_publisher(name), []).append(number)
        if member.late:
            late = wall.wall_s() > self._joined_wall_s + _JOIN_WALL_S
            return late or not mesh.unheard(members, any_channel=True)
        return not mesh.unheard(members)

    def ticker(self, period_s: float, waiting: Callable[[], None]) -> Ticker:
        return BarrierTicker(self, period_s, waiting)

    def begin(self, wall_seconds: float) -> bool:
        member = self.member
        if member is None:
            wall.pause(wall_seconds)
            if self._mesh is not None:
                self._mesh.give(None, self.clock.now())
            return True
        try:
            tick = self._next(member, wall_seconds)
            if tick is not None:
                self._take(member, tick)
        except KeeperGoneError as error:
            self._let_run(str(error))
            return True
        return tick is not None

    def _next(self, member: LockstepMember, wall_seconds: float) -> TickWord | None:
        if self._assembled and member.tick:
            tick = member.wait(min(wall_seconds, _AGAIN_WALL_S))
            if tick is None:
                self._hello_again(member)
            return tick
        self._hello()
        return member.wait(min(wall_seconds, _HELLO_WALL_S))

    def _take(self, member: LockstepMember, tick: TickWord) -> None:
        self._stepped.set(tick.number * member.tick_s)
        self.agents, self._published = tick.agents, tick.published
        mesh, wire, now = self._mesh, self._wire, self.clock.now()
        if tick.anew and wire is not None:
            wire.restart(now)
        elif wire is not None:
            wire.expect(tick.datagrams.get(wire.port, 0))
        if not tick.anew:
            self._gather(member, tick)
        if mesh is not None:
            mesh.give(tick.heard, tick.heard * member.tick_s)
            mesh.begin(member.number, tick.number)
        self._in_turn = True

    def _gather(self, member: LockstepMember, tick: TickWord) -> None:
        """Wait for what belongs to the tick; what is later is noted, and comes when it comes."""
        until, mesh, wire = wall.wall_s() + _late_wall_s(member), self._mesh, self._wire
        while True:
            lacking = mesh.lacking(tick.heard, tick.published, member.number) if mesh else []
            lacks = wire is not None and wire.lacks(self.clock.now())
            if not lacking and not lacks:
                return
            if wall.wall_s() > until:
                break
            _pause(member, len(lacking))
        if mesh is not None and lacking:
            mesh.give_up(lacking)
            names = sorted({f"{m} {CHANNELS[c].name}" for m, c in lacking})
            member.note(f"tick {tick.number}: late on the mesh, from member {', '.join(names)}")
        if wire is not None and lacks:
            wire.give_up()
            member.note(f"tick {tick.number}: a datagram of the simulator is lost or late")

    def end(self, *, last: bool = False) -> None:
        member, wire, mesh = self.member, self._wire, self._mesh
        if member is None or not self._in_turn:
            return
        self._in_turn = False
        if mesh is not None:
            self._prove(member, mesh)
        published = mesh.published() if mesh else {}
        datagrams = {wire.port: wire.written()} if wire else {}
        try:
            member.done(published, datagrams, last=last)
        except KeeperGoneError as error:
            self._let_run(str(error))
        if mesh is not None:  # what is said between two ticks belongs to the next one
            mesh.begin(member.number, member.tick + 1)

    def _prove(self, member: LockstepMember, mesh: SteppedTransport) -> None:
        """Before all go on, be sure that what was subscribed to comes: its way through the mesh
        takes a time that no tick knows."""
        until = wall.wall_s() + _late_wall_s(member)
        while mesh.unproven(self._published) and wall.wall_s() < until:
            _pause(member)

    def _let_run(self, why: str) -> None:
        if self.member is not None:
            self.member.close()
            self.member = None
        self._stepped.let_run()
        if self._wire is not None:
            self._wire.let_run()
        if self._mesh is not None:
            self._mesh.give(None, self.clock.now())
        sys.stderr.write(
            f"the run's clock at {self.clock.now():.2f} s: {why}; on by the wall clock\n"
        )

    def leave(self) -> None:
        self.end(last=True)
        if self._mesh is not None:
            self._mesh.give(None, self.clock.now())

    def drop(self, name: str) -> None:
        """Do not wait for this member; of a test, in its turn."""
        if self.member is not None:
            self.member.drop(name)

    def take(self, name: str) -> None:
        """Wait for this member again; of a test, in its turn."""
        if self.member is not None:
            self.member.take(name)

    @property
    def free(self) -> bool:
        """The keeper is gone."""
        return self.member is None

    def close(self) -> None:
        if self.member is not None:
            self.member.close()


def _crowd(member: LockstepMember) -> float:
    """By how many times the members are more than `_CROWD`; 1: they are not."""
    return max(1.0, len(member.others) / _CROWD)


def _late_wall_s(member: LockstepMember) -> float:
    return min(_LATE_MOST_WALL_S, _LATE_WALL_S * _crowd(member))


def _pause(member: LockstepMember, lacking: int = 0) -> None:
    """Until the next look at what has come."""
    wall.pause(_LOOK_WALL_S * max(lacking / _FEW, _crowd(member) ** 2))


def die(seat: Seat) -> None:
    """Kill this process in its turn: this tick is its last one that others hear of. It lives on
    until they have, as its messages may still be on their way out of it."""
    for _ in range(_HEARD_TICKS):
        seat.end()
        while not seat.begin(_WAIT_WALL_S):
            pass
    seat.end(last=True)
    os.kill(os.getpid(), signal.SIGKILL)


SIMULATOR: Final = "simulator"
STATION: Final = "station"
TEST: Final = "test"


def _publisher(name: str) -> str:
    """What a member publishes as (`Channel.publisher`)."""
    return "" if name == SIMULATOR else "agent" if name.startswith("agent-") else "station"


class BarrierTicker(Ticker):
    """Ticks when the keeper says so; never late, and no tick is missed."""

    def __init__(self, seat: BarrierSeat, period_s: float, waiting: Callable[[], None]) -> None:
        super().__init__(seat.clock, period_s)
        self._seat = seat
        self._waiting = waiting
        self._began_wall_s: float | None = None

    def wait(self) -> float:
        seat = self._seat
        if seat.free:
            return self._by_the_wall()
        if self._began_wall_s is not None:
            self._work.add((wall.wall_s() - self._began_wall_s) * 1000.0)
        seat.end()
        while not seat.begin(_WAIT_WALL_S):
            self._waiting()
        if seat.free:
            return self._by_the_wall()
        self._began_wall_s = wall.wall_s()
        self._late.add(0.0)
        return self.clock.now()

    def _by_the_wall(self) -> float:
        if self._began_wall_s is not None:
            self._began_wall_s = None
            self._due = self.clock.now()
        now = super().wait()
        self._seat.begin(0.0)
        return now
