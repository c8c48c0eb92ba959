"""A process's place in a run: in real time, or at the barrier (lockstep). The one seam: a seat
makes clock, ticker, wire and mesh of its process; what uses them does not know which it is."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Final

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.member import KeeperGoneError, LockstepMember, SteppedClock
from swarm_ctl.engine.lockstep.words import TickPhase, TickWord
from swarm_ctl.engine.ticker import Ticker
from swarm_ctl.mavlink.stepped_wire import SteppedWire
from swarm_ctl.mavlink.wires import NameUnknownYetError, Wire, open_wire
from swarm_ctl.mesh.keys import CHANNELS
from swarm_ctl.mesh.stepped_transport import MarkedTransport, SteppedTransport
from swarm_ctl.mesh.transport import Transport

_LATE_WALL_S, _LATE_MOST_WALL_S = 2.0, 4.0
"""For a message or a datagram that another process says it has sent: of few members, and of a
crowd. The keeper takes one that waits for 10 s for stopped."""
_ROLL_CALL_WALL_S: Final = 120.0
"""The same before the first tick: the mesh's links have to open."""
_ASK_WALL_S, _ASK_MOST_WALL_S = 0.05, 2.0
"""What has not come after so long is asked for; then it is twice as long to the next time."""
_ASKED: Final = 500
"""Keys in one question, which has to fit into a packet."""
_NAMED_WALL_S, _NAME_AGAIN_WALL_S = 10.0, 0.2
"""For so long, and so often, a resolver is asked for the vehicle's host: six containers start
within 10 s, and each start makes the engine's resolver begin anew."""
_LOOK_WALL_S: Final = 0.0002
_CROWD: Final = 16
"""Where more agents fly, each looks less often for what it waits for: 250 that look every 0.2 ms
leave the router no processor to bring it."""
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
        self._speaks: tuple[str, int | str] = ("", "")
        """The swarm and the own name on the mesh."""
        self._publisher = ""
        self._granted: TickWord | None = None
        """The tick that is to be run as soon as all that belongs to it has come."""
        self._granted_wall_s = self._ask_wall_s = self._pause_wall_s = 0.0
        self._in_turn = False
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
        self._speaks, self._publisher = (swarm, node), _publisher(name)
        self.member = member = LockstepMember(
            self._address, name, self._phase, port, self._say_again
        )
        self._stepped.set(member.tick * member.tick_s)

    def _say_again(self, tick: int, keys: Sequence[str]) -> None:
        if self._mesh is not None:
            self._mesh.say_again(tick, keys)

    def ticker(self, period_s: float, waiting: Callable[[], None]) -> Ticker:
        return BarrierTicker(self, period_s, waiting)

    def begin(self, wall_seconds: float) -> bool:
        member = self.member
        if member is None:
            wall.pause(wall_seconds)
            if self._mesh is not None:
                self._mesh.give_all(self.clock.now)
            return True
        try:
            return self._turn_comes(member, wall_seconds)
        except KeeperGoneError as error:
            self._let_run(str(error))
            return True

    def _turn_comes(self, member: LockstepMember, wall_seconds: float) -> bool:
        """Wait, at most so long, for a tick and all that belongs to it."""
        tick, until = self._granted or member.wait(wall_seconds), wall.wall_s() + wall_seconds
        if tick is None:
            return False
        if self._granted is None:
            self._receive(tick)
        while not self._complete(member, tick):
            if wall.wall_s() > until:
                return False
            wall.pause(_LOOK_WALL_S * max(1.0, tick.agents / _CROWD) ** 2)
            member.wait(0.0)  # another one may ask this one, too
        self._granted = None
        return self._enter(member, tick)

    def _receive(self, tick: TickWord) -> None:
        """A tick is granted; what belongs to it may be under way."""
        self._granted, self._granted_wall_s = tick, wall.wall_s()
        self._pause_wall_s = _ASK_WALL_S
        self._ask_wall_s = self._granted_wall_s + _ASK_WALL_S
        if (wire := self._wire) is not None:
            if tick.anew:
                wire.restart(self.clock.now())
            else:
                wire.expect(tick.sent.get(str(wire.port), 0))

    def _complete(self, member: LockstepMember, tick: TickWord) -> bool:
        """Whether all has come that belongs to the tick. What has not is asked for now and then;
        what is later than all patience is noted, and comes when it comes."""
        mesh, wire = self._mesh, self._wire
        lacking = mesh.lacking(tick.heard, tick.said) if mesh else {}
        lacks = wire is not None and wire.lacks(self.clock.now())
        if not lacking and not lacks:
            return True
        now, patience_s = wall.wall_s(), _patience_wall_s(tick)
        if now <= self._granted_wall_s + patience_s:
            if lacking and now > self._ask_wall_s:
                member.ask(tick.heard, list(lacking)[:_ASKED])
                self._pause_wall_s = min(2.0 * self._pause_wall_s, _ASK_MOST_WALL_S)
                self._ask_wall_s = now + self._pause_wall_s
            return False
        if mesh is not None and lacking:
            mesh.give_up(lacking)
        if wire is not None and lacks:
            wire.give_up()
        if not tick.anew:
            late = ", ".join(sorted(lacking)) or "a datagram of the simulator"
            member.note(f"tick {tick.tick}: not come after {patience_s:g} s: {late}")
        return True

    def _enter(self, member: LockstepMember, tick: TickWord) -> bool:
        """Hear what belongs to the tick; whether the turn is the caller's: the roll call is not."""
        mesh = self._mesh
        self.agents, self._in_turn = tick.agents, True
        self._stepped.set(tick.tick * member.tick_s)
        if mesh is not None:
            mesh.give(tick.heard, tick.heard * member.tick_s, tick.said)
            mesh.begin(tick.tick)
        if tick.tick > 0:
            return True
        if mesh is not None:
            mesh.answer(*self._speaks, [c for c in CHANNELS if c.publisher == self._publisher])
        self.end()
        return False

    def end(self, *, last: bool = False) -> None:
        member, wire, mesh = self.member, self._wire, self._mesh
        if member is None or not self._in_turn:
            return
        self._in_turn = False
        said = mesh.end() if mesh else {}
        try:
            member.done(said, {str(wire.port): wire.written()} if wire else {}, last=last)
        except KeeperGoneError as error:
            self._let_run(str(error))

    def _let_run(self, why: str) -> None:
        if self.member is not None:
            self.member.close()
            self.member = None
        self._stepped.let_run()
        if self._wire is not None:
            self._wire.let_run()
        if self._mesh is not None:
            self._mesh.let_run()
            self._mesh.give_all(self.clock.now)
        sys.stderr.write(
            f"the run's clock at {self.clock.now():.2f} s: {why}; on by the wall clock\n"
        )

    def leave(self) -> None:
        self.end(last=True)
        if self._mesh is not None:
            self._mesh.give_all(self.clock.now)

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


def _patience_wall_s(tick: TickWord) -> float:
    """For what belongs to a tick. One that was not waited for before waits for nothing."""
    if tick.anew and tick.tick:
        return 0.0
    if tick.heard <= 0:
        return _ROLL_CALL_WALL_S
    return min(_LATE_MOST_WALL_S, _LATE_WALL_S * max(1.0, tick.agents / _CROWD))


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
