"""The mesh in lockstep, between two members whose messages are carried by hand."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.stepped_transport import INDEX, Marked, MarkedSource, SteppedTransport
from swarm_ctl.mesh.transport import QUEUE

STATE = INDEX["state"]


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


def published(member: int, tick: int, *texts: bytes) -> list[Marked]:
    wire = Wire()
    transport = SteppedTransport(wire)
    transport.begin(member, tick)
    for text in texts:
        transport.publish(keys.STATE.key("test", member), text, keys.STATE.qos)
    assert transport.published() == {STATE: len(texts)}
    return list(wire.sent)


def listener() -> tuple[Wire, SteppedTransport, Callable[[], list[bytes]]]:
    wire = Wire()
    transport = SteppedTransport(wire)
    inlet = transport.subscribe(keys.STATE.key_expression("test"))
    return wire, transport, lambda: [bytes(data) for _, _, data in inlet.drain()]


def test_a_tick_gets_the_tick_before_in_a_fixed_order() -> None:
    """However they come, messages stand by member, and those of a later tick wait for theirs."""
    wire, transport, drain = listener()
    wire.come.extend(published(2, 5, b"c", b"d"))
    wire.come.extend(published(1, 6, b"later"))
    wire.come.extend(published(1, 5, b"a", b"b"))
    assert transport.lacking(5, [(1, STATE, 2), (2, STATE, 2)], own=3) == []
    transport.give(5, 0.25)
    assert drain() == [b"a", b"b", b"c", b"d"]
    transport.give(6, 0.3)
    assert drain() == [b"later"]


def test_what_has_not_come_is_lacking_until_it_is_given_up() -> None:
    """A member whose message was missed is waited for again once one comes in time; the late one
    is not lost."""
    wire, transport, drain = listener()
    late = published(1, 5, b"late")
    assert transport.lacking(5, [(1, STATE, 1)], own=3) == [(1, STATE)]
    transport.give_up([(1, STATE)])
    assert transport.lacking(6, [(1, STATE, 1)], own=3) == []
    wire.come.extend(late + published(1, 7, b"now"))
    assert transport.lacking(7, [(1, STATE, 1)], own=3) == []
    transport.give(7, 0.35)
    assert drain() == [b"late", b"now"]
    assert transport.lacking(8, [(1, STATE, 1)], own=3) == [(1, STATE)]


def test_the_own_messages_and_other_channels_are_not_waited_for() -> None:
    """A member waits for what it subscribes to."""
    _, transport, _ = listener()
    assert transport.lacking(5, [(3, STATE, 1), (1, INDEX["event"], 2)], own=3) == []


def test_a_hello_is_heard_and_is_no_message() -> None:
    """It proves the way of one channel."""
    wire, transport, drain = listener()
    assert transport.unheard({"agent": [1], "station": [9]}) == {1}
    speaker = Wire()
    greeting = SteppedTransport(speaker)
    greeting.begin(1, 0)
    greeting.hello("test", 1, [keys.STATE])
    wire.come.extend(speaker.sent)
    assert transport.unheard({"agent": [1], "station": [9]}) == set()
    transport.give(None, 0.0)
    assert drain() == []


def test_an_outsider_is_heard_when_it_comes() -> None:
    """A message without a mark, of a process that is no member."""
    wire, transport, drain = listener()
    wire.come.append((keys.STATE.key("test", 9), b"from outside", b""))
    transport.lacking(5, [], own=3)
    transport.give(5, 0.25)
    assert drain() == [b"from outside"]


def test_an_outsider_can_not_speak_as_a_member() -> None:
    """A number belongs to the owner of the key that it was first heard under: under another key the
    mark counts for nothing, so the member is still waited for."""
    wire, transport, drain = listener()
    transport.know({1: ("agent", "1")})
    ((_, data, mark),) = published(1, 5, b"forged")
    wire.come.append((keys.STATE.key("test", 9), data, mark))
    assert transport.lacking(5, [(1, STATE, 1)], own=3) == [(1, STATE)]
    wire.come.extend(published(1, 5, b"true"))
    assert transport.lacking(5, [(1, STATE, 1)], own=3) == []
    wire.come.extend(published(2, 6, b"first heard"))
    ((_, data, mark),) = published(2, 6, b"forged, too")
    wire.come.append((keys.STATE.key("test", 9), data, mark))
    transport.lacking(5, [], own=3)
    transport.give(5, 0.25)
    assert drain() == [b"forged", b"forged, too", b"true"]


def test_marks_of_the_future_fill_no_memory() -> None:
    """Messages that say they belong to later ticks wait, but never more than a queue of them, and
    the loudest key loses its own."""
    wire, transport, drain = listener()
    wire.come.extend(published(1, 6, b"honest"))
    for _ in range(3):
        wire.come.extend(published(2, 7, *[b"flood"] * QUEUE))
        transport.lacking(5, [], own=3)
    transport.give(6, 0.3)
    assert drain() == [b"honest"]
    transport.give(7, 0.35)
    assert len(drain()) < QUEUE
    wire.come.extend(published(2, 2**32 - 1, b"never"))
    transport.lacking(8, [], own=3)
    transport.give(8, 0.4)
    assert drain()[0] == b"never"


def test_a_subscription_in_flight_counts_from_a_fixed_tick_on() -> None:
    """However early its first message comes, the tick from which on it is heard, and waited for, is
    the same; before that tick the member asks for a proof that it works, of those that speak."""
    wire = Wire()
    transport = SteppedTransport(wire)
    transport.know({1: ("agent", "1"), 2: ("agent", "2")})
    transport.begin(3, 10)
    inlet = transport.subscribe(keys.STATE.key("test", 1))
    first = 10 + FOLLOW_TICKS
    wire.come.extend(published(1, first - 1, b"early"))
    assert transport.lacking(first - 1, [(1, STATE, 1), (2, STATE, 1)], own=3) == []
    transport.give(first - 1, 0.5)
    assert inlet.drain() == []
    assert transport.lacking(first, [(1, STATE, 1), (2, STATE, 1)], own=3) == [(1, STATE)]
    wire.come.extend(published(1, first, b"counts"))
    assert transport.lacking(first, [(1, STATE, 1)], own=3) == []
    transport.give(first, 0.6)
    assert [bytes(data) for _, _, data in inlet.drain()] == [b"counts"]
    inlet.end()
    assert wire.subscribed == []
    assert transport.lacking(first + 1, [(1, STATE, 1)], own=3) == []


def test_a_subscription_is_proven_before_it_counts() -> None:
    """By any message of its publisher, a hello too; one that does not speak is not waited for."""
    wire = Wire()
    transport = SteppedTransport(wire)
    transport.know({1: ("agent", "1"), 2: ("agent", "2")})
    transport.begin(3, 10)
    transport.subscribe(keys.STATE.key("test", 1))
    assert not transport.unproven([(1, STATE, 1)])
    transport.begin(3, 10 + FOLLOW_TICKS - 1)
    assert transport.unproven([(1, STATE, 1)])
    assert not transport.unproven([(2, STATE, 1), (1, INDEX["far"], 1)])
    speaker = Wire()
    greeting = SteppedTransport(speaker)
    greeting.begin(1, 0)
    greeting.hello("test", 1, [keys.STATE])
    wire.come.extend(speaker.sent)
    assert not transport.unproven([(1, STATE, 1)])
