"""The mesh in lockstep, between members whose messages are carried by hand."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import pytest

from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.stepped_transport import Marked, MarkedSource, SteppedTransport
from swarm_ctl.mesh.transport import QUEUE

STATES = [keys.STATE.key("test", agent) for agent in range(4)]


class Wire:
    """A transport of which the test delivers each message itself."""

    def __init__(self) -> None:
        self.sent: deque[Marked] = deque()
        self.come: deque[Marked] = deque()
        self.subscribed: list[str] = []

    def publish(self, key: str, data: bytes, qos: Qos, mark: bytes = b"") -> None:
        self.sent.append((key, data, mark))

    def subscribe_marked(self, key_expression: str) -> MarkedSource:
        self.subscribed.append(key_expression)
        return MarkedSource(
            lambda: self.come.popleft() if self.come else None,
            lambda: self.subscribed.remove(key_expression),
        )

    def subscribe(self, key_expression: str, *, timed: bool = False) -> None:  # type: ignore[override]
        raise AssertionError("not in lockstep")

    def close(self) -> None:
        return


def said(agent: int, tick: int, *texts: bytes) -> list[Marked]:
    wire = Wire()
    transport = SteppedTransport(wire)
    transport.begin(tick)
    for text in texts:
        transport.publish(STATES[agent], text, keys.STATE.qos)
    assert transport.end() == {STATES[agent]: len(texts)}
    return list(wire.sent)


class Listener:
    """Subscribed to the states of all; `tick` is what it hears first."""

    def __init__(self, tick: int = 5) -> None:
        self.wire = Wire()
        self.transport = SteppedTransport(self.wire)
        inlet = self.transport.subscribe(keys.STATE.key_expression("test"))
        self.drain: Callable[[], list[bytes]] = lambda: [
            bytes(data) for _, _, data in inlet.drain()
        ]
        self.transport.give(tick - 1, 0.0)

    def lacks(self, heard: int, **counts: int) -> list[str]:
        """Whom it lacks of those that have said so many states (`_1=2`)."""
        counted = {STATES[int(name[1:])]: count for name, count in counts.items()}
        return [key.split("/")[3] for key in self.transport.lacking(heard, counted)]

    def give(self, heard: int, *order: int) -> list[bytes]:
        self.transport.give(heard, 0.05 * heard, [STATES[agent] for agent in order])
        return self.drain()


def test_a_tick_hears_the_tick_before_in_a_fixed_order() -> None:
    """However they come, messages stand in the order that the keeper gives, and those of a later
    tick wait for theirs."""
    hears = Listener()
    hears.wire.come.extend(said(2, 5, b"c", b"d"))
    hears.wire.come.extend(said(1, 6, b"later"))
    hears.wire.come.extend(reversed(said(1, 5, b"a", b"b")))
    assert hears.lacks(5, _1=2, _2=2) == []
    assert hears.give(5, 1, 2) == [b"a", b"b", b"c", b"d"]
    assert hears.lacks(6, _1=1) == []
    assert hears.give(6, 1) == [b"later"]


def test_what_is_said_again_is_heard_once() -> None:
    """By a member that lacks it, and by no other, before and after it has heard that tick."""
    wire = Wire()
    speaks = SteppedTransport(wire)
    speaks.begin(5)
    for text in (b"a", b"b"):
        speaks.publish(STATES[1], text, keys.STATE.qos)
    speaks.publish(keys.EVENT.key("test", 1), b"event", keys.EVENT.qos)
    speaks.end()
    speaks.publish(STATES[1], b"next", keys.STATE.qos)
    speaks.end()  # it has done its tick 6 when another one asks for tick 5
    first = list(wire.sent)
    wire.sent.clear()
    speaks.say_again(5, [STATES[1]])
    assert list(wire.sent) == first[:2]
    hears = Listener()
    hears.wire.come.append(first[1])
    assert hears.lacks(5, _1=2) == ["1"]
    hears.wire.come.extend(wire.sent)
    assert hears.lacks(5, _1=2) == []
    assert hears.give(5, 1) == [b"a", b"b"]
    hears.wire.come.extend([*wire.sent, first[3]])
    assert hears.lacks(6, _1=1) == []
    assert hears.give(6, 1) == [b"next"]


def test_what_has_not_come_is_lacking_until_it_is_given_up() -> None:
    """Who was missed is waited for again once a message comes in time; the late one is not lost."""
    hears = Listener()
    late = said(1, 5, b"late")
    assert hears.lacks(5, _1=1) == ["1"]
    hears.transport.give_up([STATES[1]])
    assert hears.give(5, 1) == []
    assert hears.lacks(6, _1=1) == []
    assert hears.give(6, 1) == []
    hears.wire.come.extend(late + said(1, 7, b"now"))
    assert hears.lacks(7, _1=1) == []
    assert hears.give(7, 1) == [b"late", b"now"]
    assert hears.lacks(8, _1=1) == ["1"]


def test_the_own_messages_and_other_channels_are_not_waited_for() -> None:
    """A member waits for what it subscribes to."""
    hears = Listener()
    hears.transport.publish(STATES[3], b"own", keys.STATE.qos)
    event = keys.EVENT.key("test", 1)
    assert hears.transport.lacking(5, {STATES[3]: 1, event: 2}) == {}


def test_the_roll_call_is_heard_and_is_no_message() -> None:
    """It proves the way of each channel."""
    hears = Listener(tick=0)
    assert hears.lacks(0, _1=1) == ["1"]
    wire = Wire()
    SteppedTransport(wire).answer("test", 1, [keys.STATE])
    hears.wire.come.extend(wire.sent)
    assert hears.lacks(0, _1=1) == []
    assert hears.give(0, 1) == []
    hears.wire.come.extend(wire.sent)
    assert hears.lacks(1) == []
    assert hears.give(1) == []


def test_an_outsider_can_not_speak_as_a_member() -> None:
    """Under another key a mark counts for nothing: the member is still waited for."""
    hears = Listener()
    ((_, data, mark),) = said(1, 5, b"forged")
    hears.wire.come.append((keys.STATE.key("test", 9), data, mark))
    assert hears.lacks(5, _1=1) == ["1"]
    hears.wire.come.extend(said(1, 5, b"true"))
    assert hears.lacks(5, _1=1) == []
    assert hears.give(5, 1) == [b"forged", b"true"]


def test_marks_of_the_future_fill_no_memory() -> None:
    """Messages that say they belong to the next tick wait, but never more than a queue of them, and
    the loudest key loses its own; those of a tick that no member can have come to are heard when
    they come."""
    hears = Listener()
    hears.wire.come.extend(said(1, 6, b"honest"))
    for _ in range(3):
        hears.wire.come.extend(said(2, 6, *[b"flood"] * QUEUE))
        hears.lacks(5)
    hears.give(5)
    assert hears.lacks(6, _1=1) == []
    heard = hears.give(6, 1)
    assert b"honest" in heard
    assert len(heard) <= QUEUE
    hears.wire.come.extend(said(2, 2**32 - 1, b"never"))
    hears.lacks(7)
    assert hears.give(7) == [b"never"]


def test_a_subscription_in_flight_counts_from_a_fixed_tick_on() -> None:
    """However early its first message comes, the tick from which on it is heard, and waited for, is
    the same. If it works too late for that, what it lacks is asked for."""
    wire = Wire()
    transport = SteppedTransport(wire)
    transport.begin(10)
    inlet = transport.subscribe(STATES[1])
    first = 10 + FOLLOW_TICKS
    transport.give(first - 2, 0.5)
    wire.come.extend(said(1, first - 1, b"early"))
    both = {STATES[1]: 1, STATES[2]: 1}
    assert transport.lacking(first - 1, both) == {}
    transport.give(first - 1, 0.5)
    assert inlet.drain() == []
    assert transport.lacking(first, both) == {STATES[1]: 1}
    wire.come.extend(said(1, first, b"counts"))
    assert transport.lacking(first, both) == {}
    transport.give(first, 0.6, both)
    assert [bytes(data) for _, _, data in inlet.drain()] == [b"counts"]
    inlet.end()
    assert wire.subscribed == []
    assert transport.lacking(first + 1, both) == {}


def test_what_is_said_between_two_ticks_belongs_to_the_next_one() -> None:
    """Also to one that was not waited for, and comes back many ticks later."""
    wire = Wire()
    speaks = SteppedTransport(wire)
    speaks.begin(5)
    speaks.end()
    speaks.publish(STATES[1], b"between", keys.STATE.qos)
    speaks.begin(40)
    assert speaks.end() == {STATES[1]: 1}
    hears = Listener(tick=40)
    hears.wire.come.append(wire.sent[-1])
    assert hears.lacks(40, _1=1) == []


@pytest.mark.parametrize("ticks", [0, 70_000])
def test_without_a_keeper_all_is_heard_when_it_comes(ticks: int) -> None:
    """The marks end with the clock that they belong to, however long the flight goes on."""
    wire = Wire()
    speaks = SteppedTransport(wire)
    speaks.begin(5)
    speaks.let_run()
    for _ in range(ticks):
        speaks.publish(STATES[1], b"on", keys.STATE.qos)
    speaks.publish(STATES[1], b"last", keys.STATE.qos)
    hears = Listener()
    hears.wire.come.append(wire.sent[-1])
    # a loop that is stopped while it reads hears nothing from the future
    hears.transport.give_all(lambda: float(not hears.wire.come))
    (inlet,) = hears.transport._inlets.values()
    assert [(at, bytes(data)) for at, _, data in inlet.drain()] == [(1.0, b"last")]
