"""What a member takes from the mesh: a payload belongs to the key that it came under, sizes and
rates are bounded by owner, and what is refused is told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import (
    AgentState,
    AgentStatus,
    Answers,
    ClockEcho,
    ClockNews,
    Command,
    Gains,
    Glimpse,
    LinkReport,
    Phase,
    Refusal,
    RefusalReason,
    Tuning,
)
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.gate import RECENT_S, Gate, MeshSource, Refusals, Stations
from swarm_ctl.mesh.keys import CHANNELS, Bounds, Channel
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.payloads import VERSION, encode
from tests.unit.mesh.test_payloads import OTHERS

STATE = AgentState(3, 1, 1.0, 1, Phase.FLY, 1, False, True, (1, 2, 3), (0, 0, 0), (1, 2), (0, 0))
PAYLOADS: dict[type, Any] = {type(payload): payload for payload in [STATE, *OTHERS]}
PLAN = range(1, 7)


class Mesh:
    """A listener, agent 1, and strangers that publish whatever they like."""

    def __init__(self) -> None:
        self.now = 100.0
        self.hub = hub = MemoryHub(lambda: self.now)
        self.node = Node(MemoryTransport(hub), "test", 1)
        self.node.listen(*CHANNELS, agents=PLAN)
        self._stranger = MemoryTransport(hub)

    def put(self, key: str, data: bytes) -> None:
        self._stranger.publish(key, data, keys.NEWEST)

    def say(self, channel: Channel[Any], owner: int | str, payload: Any) -> None:
        self.put(channel.key("test", owner), encode(payload))

    def taken(self, channel: Channel[Any]) -> list[Any]:
        return [payload for payload, _ in self.node.take(channel)]

    def refused(self) -> dict[tuple[str, RefusalReason], Refusal]:
        return {(r.owner, r.reason): r for r in self.node.refused(self.now)}


def of(channel: Channel[Any], owner: int | str) -> Any:
    """A payload of the channel that speaks for `owner`."""
    return replace(PAYLOADS[channel.payload], **{channel.publisher: owner})


def name(channel: Channel[Any], number: int) -> int | str:
    return number if channel.publisher == "agent" else f"desk-{number}"


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c.name)
def test_a_payload_belongs_to_its_key(channel: Channel[Any]) -> None:
    """On every channel: what speaks for another than the key's owner is refused and told of; the
    same words under the right key are taken."""
    mesh, honest, liar = Mesh(), name(channel, 3), name(channel, 7)
    mesh.say(channel, liar, of(channel, honest))
    mesh.say(channel, honest, of(channel, honest))
    assert mesh.taken(channel) == [of(channel, honest)]
    refusal = mesh.refused()[f"{channel.publisher} {liar}", RefusalReason.OTHER_OWNER]
    assert refusal.words == (
        f"a {channel.name} under {channel.publisher} {liar}'s key says {channel.publisher} {honest}"
    )
    assert (refusal.count, mesh.node.bad_payloads) == (1, 1)


@given(
    st.sampled_from(CHANNELS),
    st.lists(
        st.tuples(
            st.sampled_from(["1", "3", "7", "desk", "a b", "\x1b[2J", "9" * 5000, "x" * 200]),
            st.binary(max_size=200)
            | st.binary(max_size=200).map(lambda data: bytes([VERSION]) + data)
            | st.sampled_from([encode(payload) for payload in PAYLOADS.values()]),
        ),
        max_size=20,
    ),
)
def test_no_bytes_under_any_key_change_what_another_owner_says(
    channel: Channel[Any], hostile: list[tuple[str, bytes]]
) -> None:
    """Whatever comes under other keys: nothing raises, what is taken speaks for its key, and the
    honest owner's message is taken once."""
    mesh, honest = Mesh(), name(channel, 2)
    for owner, data in hostile:
        mesh.put(channel.key("test", owner), data)
    mesh.say(channel, honest, of(channel, honest))
    taken = [getattr(payload, channel.publisher) for payload in mesh.taken(channel)]
    assert taken.count(honest) == 1
    assert {str(speaker) for speaker in taken} <= {str(honest), *(key for key, _ in hostile)}
    for refusal in mesh.node.refused(mesh.now):
        assert refusal.words.isprintable()
        assert len(refusal.owner) <= len("station ") + 40


class Unread(bytes):
    """Bytes that must not be copied."""

    def __bytes__(self) -> bytes:
        raise AssertionError("copied")


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c.name)
def test_what_is_too_large_is_not_even_copied(channel: Channel[Any]) -> None:
    mesh, owner = Mesh(), name(channel, 2)
    mesh.put(channel.key("test", owner), Unread(channel.bounds.size + 1))
    assert mesh.taken(channel) == []
    told = mesh.refused()[f"{channel.publisher} {owner}", RefusalReason.TOO_LARGE].words
    most = channel.bounds.size
    assert told.endswith(f"'s key has {most + 1} bytes; allowed: at most {most}")
    mesh.put(channel.key("test", name(channel, 3)), bytes(most))
    assert mesh.taken(channel) == []
    reasons = [refusal.reason for refusal in mesh.node.refused(mesh.now)]
    assert reasons == [RefusalReason.TOO_LARGE, RefusalReason.UNREADABLE]


@pytest.mark.parametrize("owner", [7, 3], ids=["a stranger", "an agent of the plan"])
def test_a_flood_of_one_takes_nothing_from_the_others(owner: int) -> None:
    """Of 4,000 states under one key, its allowance is read, the newest ones; all five others are
    heard, and the next second of the flood gets no more than the rate."""
    mesh, bounds = Mesh(), keys.STATE.bounds
    others = [i for i in PLAN if i not in (1, owner)]
    for i in others:
        mesh.say(keys.STATE, i, of(keys.STATE, i))
    for k in range(4000):
        mesh.say(keys.STATE, owner, replace(of(keys.STATE, owner), seq=k))
    taken = mesh.taken(keys.STATE)
    assert [state.agent for state in taken if state.agent != owner] == others
    flood = [state.seq for state in taken if state.agent == owner]
    assert flood == list(range(4000 - bounds.burst, 4000))
    refusal = mesh.refused()[f"agent {owner}", RefusalReason.TOO_MANY]
    assert refusal.count == 4000 - bounds.burst
    mesh.now += 1.0
    for k in range(4000):
        mesh.say(keys.STATE, owner, replace(of(keys.STATE, owner), seq=k))
    assert len(mesh.taken(keys.STATE)) == bounds.per_s


def test_in_a_flood_under_an_agents_own_key_what_may_follow_is_read() -> None:
    """As many again, the newest of a thousand that a tick looks at; nothing is asked of a
    stranger's key, or of who speaks for another."""
    channel, refusals, asked = replace(keys.STATE, bounds=Bounds(165, 1.0, 4)), Refusals(), set()
    key = {agent: channel.key("test", agent) for agent in (3, 4, 7)}
    gate = Gate(channel, [key[3], key[4]], refusals, Stations())

    def likely(word: Glimpse, received_s: float) -> bool:
        asked.add((word.agent, received_s))
        return word.time_s == 5.0

    def flood(under: int, count: int, **says: Any) -> list[Any]:
        data = encode(replace(of(keys.STATE, under), **says))
        return [(mesh_s, key[under], data)] * count

    def read(*floods: list[Any]) -> Counter[tuple[str, bool]]:
        taken = gate.admit([message for each in floods for message in each], likely)
        return Counter((source.owner, data in honest) for _, source, data in taken)

    mesh_s, honest = 100.0, {encode(replace(of(keys.STATE, k), time_s=5.0)) for k in (3, 7)}
    forged, others = flood(7, 9, time_s=5.0), flood(4, 9, agent=5)
    assert read(flood(3, 9, time_s=5.0), flood(3, 1018), flood(3, 4), forged, others) == {
        ("agent 3", False): 4,
        ("agent 3", True): 1,  # the others were not looked at
        ("agent 7", True): 4,
        ("agent 4", False): 4,
    }
    assert asked == {(3, 100.0)}
    assert refusals.recent(100.0)[0].count == 5
    mesh_s = 101.0
    late = flood(3, 9, time_s=5.0)
    assert read(late, flood(3, 500)) == {("agent 3", False): 1, ("agent 3", True): 4}
    assert read(late) == {}  # its second allowance is used up, too
    mesh_s = 103.0
    assert read(flood(3, 9, time_s=5.0)) == {("agent 3", True): 4}


STATIONS = [
    ("just not for two seconds", (0.0, 1.9), False),
    ("for two seconds", (0.0, 2.0), True),
    ("rarely", (0.0, 60.0), True),
    ("too rarely", (0.0, 60.1), False),
    ("again after a silence", (0.0, 60.1, 62.1), True),
    ("two beacons at once", (0.0, 2.0, 2.0), True),
    ("its clock was set back", (10.0, 12.0, 5.0), False),
    ("and it goes on", (10.0, 12.0, 5.0, 7.0), True),
]


@pytest.mark.parametrize(
    ("what", "beacons", "familiar"), STATIONS, ids=[row[0] for row in STATIONS]
)
def test_which_stations_are_familiar(what: str, beacons: Any, familiar: bool) -> None:
    """Those whose beacons have come for two seconds, in one piece."""
    stations = Stations()
    for at_s in beacons:
        stations.hear("desk", at_s)
        stations.hear("x" * 256, at_s)
        stations.hear("x" * 257, at_s)
    assert stations.familiar("desk") is stations.familiar("x" * 256) is familiar
    assert not stations.familiar("x" * 257)
    assert not stations.familiar("another")


def test_names_that_come_once_take_no_place_for_long() -> None:
    """A thousand are remembered; after a second of silence they make room, a familiar one after a
    minute. They are looked through once in two seconds at most."""
    stations = Stations()
    for at_s in (0.0, 2.0):
        stations.hear("desk", at_s)

    def flood(at_s: float) -> None:
        for k in range(2000):
            stations.hear(f"evil-{k}", at_s)

    flood(2.5)
    for at_s in (2.6, 3.5, 4.5, 6.5, 8.4):
        stations.hear("next", at_s)
    assert not stations.familiar("next")  # it found its place at 6.5 s
    stations.hear("next", 8.5)
    assert stations.familiar("next")
    for at_s, stays in ((30.0, True), (59.9, True), (62.0, False)):
        flood(at_s)
        assert stations.familiar("desk") is stays
    assert stations.familiar("next")


@pytest.mark.parametrize(("at_s", "gone"), [(0.75, False), (1.25, True)])
def test_a_name_that_came_once_is_remembered_for_a_second(at_s: float, gone: bool) -> None:
    stations = Stations()
    for k in range(1024):
        stations.hear(f"evil-{k}", 0.0)
    for each in (at_s, at_s + 2.0):
        stations.hear("desk", each)
    assert stations.familiar("desk") is gone


def reader(
    channel: Channel[Any], stations: Stations | None = None
) -> Callable[[float, list[str]], dict[str, int]]:
    """Of names that each send twice what they may at once, in turn: how many are read."""
    gate = Gate(channel, [], Refusals(), stations or Stations())

    def read(at_s: float, names: list[str]) -> dict[str, int]:
        keyed = [(at_s, channel.key("test", name), b"") for name in names]
        return Counter(
            source.owner.split()[1] for _, source, _ in gate.admit(keyed * 2 * channel.bounds.burst)
        )

    return read


@pytest.mark.parametrize(
    ("channel", "per_s"), [(keys.COMMAND, 400.0), (keys.STATE, keys.STATE.bounds.per_s)]
)
def test_33_strangers_at_a_time_have_more_than_one_allowance(
    channel: Channel[Any], per_s: float
) -> None:
    """One each, and all others one together, which fills fast on the channel of commands. A name
    gives its place to a new one after a minute."""
    read, burst = reader(channel), channel.bounds.burst
    crowd = [str(k) for k in range(40)]
    assert sorted(read(0.0, crowd).values()) == [burst // 8] * 8 + [burst] * 32
    assert sum(read(0.25, ["new", "newer"]).values()) == int(per_s * 0.25)
    assert read(60.5, ["new", "newer"]) == {"new": burst, "newer": burst}


def test_each_familiar_station_has_one_allowance() -> None:
    """However their commands come in turn, and after a minute of silence as well."""
    stations, (per_s, burst) = Stations(), keys.COMMAND.bounds[1:]
    desks = ["red", "blue"]
    for at_s in (0.0, 2.0):
        for desk in desks:
            stations.hear(desk, at_s)
    read = reader(keys.COMMAND, stations)
    assert read(2.0, [str(k) for k in range(99)])["98"] == burst
    for at_s, count in ((2.0, burst), (3.0, per_s), (90.0, burst), (91.0, per_s)):
        assert read(at_s, desks) == dict.fromkeys(desks, count)


def test_an_allowance_fills_with_time() -> None:
    """Up to its burst; where the clock is set back by more than a second, from there."""
    source = MeshSource("agent 3", 3, Bounds(100, 10.0, 2))

    def read(now: float) -> int:
        return sum(source.admit(now) for _ in range(9))

    assert [read(at) for at in (5.0, 5.0, 5.125, 5.25, 4.25, 4.375, 9.0)] == [2, 0, 1, 1, 0, 0, 2]
    assert [read(at) for at in (3.0, 3.125)] == [0, 1]
    assert [source.idle(at) for at in (63.125, 63.2)] == [False, True]


def test_owners_without_number_share_one_allowance() -> None:
    """A stranger that takes a new name for each message gets no more work done than 33 others, and
    fills no table; agents of the plan are heard all the same."""
    mesh, bounds = Mesh(), keys.STATE.bounds
    mesh.say(keys.STATE, 3, STATE)
    for k in range(4000):
        mesh.say(keys.STATE, 100 + k, of(keys.STATE, 100 + k))
    taken = mesh.taken(keys.STATE)
    assert taken[0] == STATE
    assert len(taken) == 1 + 32 + bounds.burst
    (refusal,) = mesh.node.refused(mesh.now)
    assert (refusal.owner, refusal.count) == ("others", 4000 - 32 - bounds.burst)


def test_a_station_that_is_familiar_is_heard_among_ever_new_names() -> None:
    """Its beacons have come for two seconds before strangers take all other places, on both
    channels; a name that beacons once is not familiar, and 4,000 of them keep no station from
    becoming it."""
    mesh = Mesh()

    def flood(round_: int) -> None:
        for k in range(4000):
            mesh.say(keys.BEACON, f"evil-{round_}-{k}", of(keys.BEACON, f"evil-{round_}-{k}"))
            mesh.say(keys.COMMAND, f"evil-{round_}-{k}", Command(f"{k}", "hold", (99,), 1.0))

    def heard(desk: str) -> bool:
        mesh.say(keys.BEACON, desk, of(keys.BEACON, desk))
        mesh.taken(keys.BEACON)
        mesh.say(keys.COMMAND, desk, Command("honest", "land", (), 1.0))
        flood(10_000 + round(mesh.now))
        return "honest" in [command.id for command in mesh.taken(keys.COMMAND)]

    for _ in range(9):
        mesh.say(keys.BEACON, "desk", of(keys.BEACON, "desk"))
        mesh.taken(keys.BEACON)
        mesh.now += 0.25
    for k in range(3):
        flood(k)
        mesh.taken(keys.COMMAND)
        assert heard("desk")
        mesh.now += 1.0
    assert not heard("newcomer")
    told_s = mesh.now
    while not heard("newcomer"):
        mesh.now += 1.0
        assert mesh.now < told_s + 10.0


def test_refusals_are_told_for_ten_seconds() -> None:
    mesh = Mesh()
    mesh.say(keys.STATE, 7, STATE)
    mesh.taken(keys.STATE)
    mesh.now += RECENT_S
    assert len(mesh.node.refused(mesh.now)) == 1
    mesh.now += 0.1
    assert mesh.node.refused(mesh.now) == ()
    assert mesh.node.bad_payloads == 1


def test_the_largest_swarm_fits() -> None:
    """Commands, statuses and clock words of 250 agents, as long as their numbers may be."""
    long = -1234.123456789012
    slots = tuple((long, long) for _ in range(250))
    form = FormStep("x" * 100, slots, long, long, long)
    ahead = tuple((250, long) for _ in range(250))
    tuning = Tuning(Gains(long, long, long, long), long, ahead)
    command = Command("t", "tune", tuple(range(250)), long, form, 2**64, 9, tuning)
    assert len(encode(command)) <= keys.COMMAND.bounds.size
    status = PAYLOADS[AgentStatus]
    link = LinkReport(long, long, long, 10**6, 10**6, long, long)
    links = {100 + k: link for k in range(250)}
    assert len(encode(replace(status, links=links))) <= keys.STATUS.bounds.size
    echoes = tuple(ClockEcho(k, long, long) for k in range(250))
    assert len(encode(ClockNews(1, long, Answers.SOON, echoes))) == keys.CLOCK.bounds.size


def test_a_node_hears_those_that_it_follows() -> None:
    """And no other on that channel; one that is followed again has the allowance that it had."""
    mesh, bounds = Mesh(), keys.STATE.bounds
    node = Node(MemoryTransport(mesh.hub), "test", 2)
    node.listen(keys.FAR, agents=PLAN)
    node.follow(keys.STATE, [3, 5])
    for i in (3, 4, 5):
        mesh.say(keys.STATE, i, of(keys.STATE, i))
        mesh.say(keys.FAR, i, of(keys.FAR, i))
    assert [state.agent for state, _ in node.take(keys.STATE)] == [3, 5]
    assert [state.agent for state, _ in node.take(keys.FAR)] == [3, 4, 5]
    node.follow(keys.STATE, [4, 5])
    for i in (3, 4, 5):
        mesh.say(keys.STATE, i, of(keys.STATE, i))
    assert sorted(state.agent for state, _ in node.take(keys.STATE)) == [4, 5]
    for _ in range(2):
        node.follow(keys.STATE, [5])
        node.follow(keys.STATE, [4])
        for k in range(bounds.burst):
            mesh.say(keys.STATE, 4, replace(of(keys.STATE, 4), seq=k))
        heard = node.take(keys.STATE)
    assert len(heard) < 2


def test_a_clock_that_is_set_back_keeps_no_owner_away() -> None:
    """A station's clock, which is the swarm's only after the first message."""
    mesh, bounds = Mesh(), keys.STATE.bounds
    for _ in range(bounds.burst):
        mesh.say(keys.STATE, 3, STATE)
    assert len(mesh.taken(keys.STATE)) == bounds.burst
    mesh.now = 2.0
    mesh.say(keys.STATE, 3, STATE)
    assert mesh.taken(keys.STATE) == []
    mesh.now += 0.05
    mesh.say(keys.STATE, 3, STATE)
    assert mesh.taken(keys.STATE) == [STATE]


def test_refusals_are_counted_by_owner_and_told_newest_first() -> None:
    """Sixty-four owners are told apart, all others together, until old ones make room."""
    refusals, reason = Refusals(), RefusalReason.UNREADABLE
    for k in range(100):
        refusals.add(f"agent {k}", reason, "words", k / 100, 2)

    def told(now: float) -> list[tuple[str, int]]:
        return [(refusal.owner, refusal.count) for refusal in refusals.recent(now)]

    assert told(1.0) == [("others", 72), *((f"agent {k}", 2) for k in range(63, 56, -1))]
    for k, now, first in ((3, 1.0, ("agent 3", 3)), (99, 10.0, ("others", 73))):
        refusals.add(f"agent {k}", reason, "words", now)
        assert told(now)[0] == first
    refusals.add("agent 99", reason, "words", 10.25)
    assert told(10.25)[0] == ("agent 99", 1)
    assert refusals.unread == 203
