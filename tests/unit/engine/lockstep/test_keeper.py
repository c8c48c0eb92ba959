"""The keeper of mission time, with members in this process."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest

from swarm_ctl.engine.lockstep.keeper import Keeper, Rules
from swarm_ctl.engine.lockstep.member import KeeperGoneError, LockstepMember
from swarm_ctl.engine.lockstep.words import TickPhase, TickWord
from swarm_ctl.errors import StartError

pytestmark = pytest.mark.timeout(20)

WORLD, FIRST, SECOND = "simulator", "agent-1", "agent-2"
PORTS = {FIRST: 1001, SECOND: 1002}


class Barrier:
    """A keeper on a thread of its own, and its members by name."""

    def __init__(self, rules: Rules) -> None:
        self.notes: list[str] = []
        self.address = f"test-{uuid.uuid4()}"
        self.keeper = Keeper(rules, self.address, self.notes.append)
        self.members: dict[str, LockstepMember] = {}
        for name in rules.expected:
            self.join(name)
        self._thread = threading.Thread(target=self.keeper.serve)
        self._thread.start()

    def join(self, name: str, *, late: bool = False) -> LockstepMember:
        """Its constructor waits for an answer, which comes from the thread."""
        phase = (
            TickPhase.WORLD
            if name == WORLD
            else TickPhase.AFTER
            if name == "test"
            else TickPhase.SWARM
        )
        made: list[LockstepMember] = []
        port = PORTS.get(name, 0)
        thread = threading.Thread(
            target=lambda: made.append(LockstepMember(self.address, name, phase, port))
        )
        thread.start()
        if not late:
            while thread.is_alive():
                self.keeper.turn()
        thread.join()
        self.members[name] = made[0]
        return made[0]

    def answer(self, *names: str) -> None:
        """To the roll call."""
        for name in names:
            assert self.tick(name).tick == 0
            self.done(name)

    def tick(self, name: str, wall_seconds: float = 5.0) -> TickWord:
        until = time.monotonic() + wall_seconds
        while time.monotonic() < until:
            tick = self.members[name].wait(0.05)
            if tick is not None:
                return tick
        raise AssertionError(f"{name} gets no tick")

    def done(self, name: str, count: int = 0) -> None:
        """It has said so many states, and sent so many datagrams."""
        port = {str(PORTS[name]): count} if name in PORTS else {}
        self.members[name].done({f"{name}/state": count} if count else {}, port)

    def close(self) -> None:
        self.keeper.over = True
        for member in self.members.values():
            member.close()
        self._thread.join()
        self.keeper.close()


def wait_long(member: LockstepMember) -> None:
    for _ in range(100):
        member.wait(0.05)


@contextmanager
def barrier(*names: str, factor: float | None = None, patience: float = 10.0) -> Iterator[Barrier]:
    """After its roll call."""
    with closing(Barrier(Rules(0.05, names, factor, patience))) as made:
        made.answer(*(name for name in names if name not in (WORLD, "test")))
        made.answer(*(name for name in names if name == "test"))
        yield made


def test_a_tick_says_what_belongs_to_it() -> None:
    """An agent is told what the agents said in the tick before, in the order of the run's members
    whoever was first, the simulator how many datagrams each has sent."""
    with barrier(WORLD, FIRST, SECOND) as b:
        b.tick(WORLD)
        b.members[WORLD].done({}, {"1001": 4, "9999": 1})
        assert b.tick(FIRST).sent["1001"] == 4
        b.tick(SECOND)
        b.done(SECOND, 3)
        b.done(FIRST, 2)
        assert b.tick(WORLD).sent == {"1001": 2, "1002": 3}
        b.done(WORLD)
        tick = b.tick(SECOND)
        assert tick.heard == 1
        assert list(tick.said.items()) == [("agent-1/state", 2), ("agent-2/state", 3)]


def test_a_member_that_dies_is_not_waited_for() -> None:
    """Its end of file is enough: the others go on within the same second, and it is no agent any
    more."""
    with barrier(WORLD, FIRST, SECOND, patience=60.0) as b:
        b.tick(WORLD)
        b.done(WORLD)
        b.tick(FIRST)
        b.members[SECOND].close()
        b.done(FIRST)
        tick = b.tick(WORLD, 1.0)
        assert tick.agents == 1


def test_a_last_tick_counts_and_is_the_last() -> None:
    """What an agent said in its last tick is waited for; no tick is granted to it again, and
    the next world has one agent less, whenever its process ends."""
    with barrier(WORLD, FIRST, SECOND) as b:
        b.tick(WORLD)
        b.done(WORLD)
        b.tick(FIRST)
        b.tick(SECOND)
        b.members[SECOND].done({"agent-2/event": 5}, {"1002": 1}, last=True)
        b.done(FIRST)
        tick = b.tick(WORLD)
        assert (tick.agents, tick.sent["1002"]) == (1, 1)
        b.done(WORLD)
        assert b.tick(FIRST).said["agent-2/event"] == 5
        assert b.members[SECOND].wait(0.05) is None


def test_a_stopped_member_is_left_behind_and_comes_back() -> None:
    """After the bound mission time goes on without it, which is noted; it takes part again from a
    later tick, told that its counts are void."""
    with barrier(WORLD, FIRST, SECOND, patience=1.0) as b:
        for _ in range(2):
            b.tick(WORLD)
            b.done(WORLD)
            b.tick(FIRST)
            b.done(FIRST)
            b.tick(SECOND)
            if b.members[SECOND].tick == 1:
                b.done(SECOND)
        assert b.tick(WORLD).tick == 3
        assert "agent-2 has not done its tick for 1 s" in b.notes[0]
        b.done(SECOND)
        b.done(WORLD)
        b.tick(FIRST)
        b.done(FIRST)
        b.tick(WORLD)
        b.done(WORLD)
        assert not b.tick(FIRST).anew
        assert b.tick(SECOND).anew
        assert "agent-2 is back" in b.notes[1]


def test_a_station_does_not_hold_up_the_world() -> None:
    """The simulator goes on while a station still works on the tick, the agents do not."""
    with barrier(WORLD, FIRST, "station") as b:
        b.tick(WORLD)
        b.done(WORLD)
        b.tick("station")
        b.tick(FIRST)
        b.done(FIRST)
        assert b.tick(WORLD).tick == 2
        b.done(WORLD)
        assert b.members[FIRST].wait(0.05) is None
        b.done("station", 1)
        assert b.tick(FIRST).said["station/state"] == 1


def test_a_pace_slows_down_and_never_hurries() -> None:
    """Paced ticks come no faster than asked for, and what a pause cost is not made up for. The test
    sees the first tick late where it does not run when that comes: so its bound leaves 0.25 s of
    2 s."""
    with barrier(WORLD, factor=1.0) as b:

        def fly(ticks: int) -> float:
            began = time.monotonic()
            for _ in range(ticks):
                b.done(WORLD)
                b.tick(WORLD)
            return time.monotonic() - began

        b.tick(WORLD)
        assert fly(40) > 39 * 0.05 - 0.25
        time.sleep(0.5)
        assert fly(4) > 2 * 0.05 - 0.005  # one comes at once, and one that was due meanwhile


def test_what_was_not_heard_is_said_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """By who has said it; of many that ask at once, for the first."""
    monkeypatch.setattr("swarm_ctl.engine.lockstep.keeper._AGAIN_WALL_S", 2.0)
    with barrier(WORLD, FIRST, SECOND) as b:
        asked: list[tuple[int, list[str]]] = []
        b.members[SECOND]._say_again = lambda tick, keys: asked.append((tick, list(keys)))
        b.tick(WORLD)
        b.done(WORLD)
        for name in (FIRST, SECOND):
            b.tick(name)
            b.done(name, 1)
        b.tick(WORLD)
        b.done(WORLD)
        b.tick(FIRST)
        for _ in range(2):
            b.members[FIRST].ask(1, ["agent-2/state"])
        until = time.monotonic() + 5.0
        while not asked and time.monotonic() < until:
            b.members[SECOND].wait(0.05)
        b.members[SECOND].wait(0.05)
        assert asked == [(1, ["agent-2/state"])]


def test_nobody_is_taken_for_stopped_before_the_first_tick_is_done() -> None:
    """The mesh's links may take longer to open than a process may stand still."""
    with barrier(WORLD, FIRST, patience=0.1) as b:
        b.tick(WORLD)
        b.done(WORLD)
        b.tick(FIRST)
        time.sleep(2.5)
        assert b.notes == []
        b.done(FIRST)
        assert not b.tick(WORLD).anew
        b.done(WORLD)
        b.tick(FIRST)
        assert b.tick(WORLD).tick == 3
        assert "agent-1 has not done its tick" in b.notes[0]


@pytest.mark.parametrize(
    "nonsense", [b"\x05\x00", b"7", b"{}", b'{"done": 1}', b'{"join": "x", "port": "y"}']
)
def test_a_stranger_does_not_stop_the_clock(nonsense: bytes) -> None:
    """What is no word of a member ends that connection alone."""
    with barrier(WORLD) as b:
        stranger = LockstepMember(b.address, "stranger", TickPhase.SWARM)
        stranger._socket.send(nonsense)
        with pytest.raises(KeeperGoneError):
            wait_long(stranger)
        stranger.close()
        b.tick(WORLD)


def test_no_keeper() -> None:
    """A process that is to join a clock that is not there says so."""
    with pytest.raises(StartError, match="clock does not answer"):
        LockstepMember("swarm-ctl-nowhere", FIRST, TickPhase.SWARM)


def test_the_keeper_is_not_given_up_while_others_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred processes may need longer to start than a keeper may be silent; a process that was
    stopped for so long does not take the keeper for silent, either."""
    monkeypatch.setattr("swarm_ctl.engine.lockstep.keeper._TELL_WALL_S", 0.05)
    monkeypatch.setattr("swarm_ctl.engine.lockstep.member._SILENT_WALL_S", 0.5)
    with closing(Keeper(Rules(0.05, (WORLD, FIRST)), "test-slow", lambda _: None)) as keeper:
        serving = True

        def serve() -> None:
            while serving:
                keeper.turn()

        thread = threading.Thread(target=serve)
        thread.start()
        with closing(LockstepMember("test-slow", FIRST, TickPhase.SWARM)) as waits:
            until = time.monotonic() + 1.0
            while time.monotonic() < until:  # the world has not joined
                assert waits.wait(0.01) is None
            serving = False
            thread.join()
            time.sleep(0.6)
            assert waits.wait(0.0) is None
            with pytest.raises(KeeperGoneError, match="silent"):
                wait_long(waits)
