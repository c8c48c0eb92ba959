"""What a member takes from the mesh: a payload belongs to the key that it came under, sizes and
rates are bounded by owner, and what is refused is told."""

from __future__ import annotations

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
    LinkReport,
    Phase,
    Refusal,
    RefusalReason,
    Tuning,
)
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.gate import RECENT_S
from swarm_ctl.mesh.keys import CHANNELS, Channel, owner_of
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


@pytest.mark.parametrize("key", ["007", "+7", "７", "7 ", "seven", "-7"])
def test_an_agent_has_one_key(key: str) -> None:
    """No other spelling of its id is its key."""
    mesh = Mesh()
    mesh.put(f"swarm/test/agent/{key}/state", encode(of(keys.STATE, 7)))
    assert mesh.taken(keys.STATE) == []


def test_a_command_has_the_name_of_its_sender() -> None:
    mesh = Mesh()
    mesh.say(keys.COMMAND, "desk", Command("a", "hold", (), 1.0))
    (taken,) = mesh.taken(keys.COMMAND)
    assert taken.station == "desk"


@given(
    st.sampled_from(CHANNELS),
    st.lists(
        st.tuples(
            st.sampled_from(["1", "3", "7", "desk", "a b", "\x1b[2J", "9" * 5000, "x" * 300]),
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
    assert all(refusal.words.isprintable() for refusal in mesh.node.refused(mesh.now))


class Unread(bytes):
    """Bytes that must not be copied."""

    def __bytes__(self) -> bytes:
        raise AssertionError("copied")


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c.name)
def test_what_is_too_large_is_not_even_copied(channel: Channel[Any]) -> None:
    mesh, owner = Mesh(), name(channel, 2)
    mesh.put(channel.key("test", owner), Unread(channel.bounds.size + 1))
    assert mesh.taken(channel) == []
    assert (f"{channel.publisher} {owner}", RefusalReason.TOO_LARGE) in mesh.refused()


def test_a_subscription_keeps_a_round_of_messages_of_the_largest_swarm() -> None:
    """In lockstep all 250 agents send their status before the station reads the first."""
    for channel in keys.CHANNELS:
        assert 500 <= channel.bounds.queue <= keys.QUEUE


def test_bounds_fit_what_is_sent() -> None:
    """The fixed layouts are as large as the table says; of JSON there is room for 250 agents."""
    led = Frame((0.0, 0.0), velocity_mps=(1.0, 0.0))
    longest = replace(STATE, goal_height_m=20.0, frame=led)
    assert len(encode(longest)) == keys.STATE.bounds.size == keys.FAR.bounds.size
    for channel in CHANNELS:
        assert len(encode(PAYLOADS[channel.payload])) <= channel.bounds.size


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


def test_a_flood_of_commands_does_not_hide_another_stations() -> None:
    mesh = Mesh()
    mesh.say(keys.COMMAND, "desk", Command("land", "land", (), 1.0))
    for k in range(4000):
        mesh.say(keys.COMMAND, "stranger", Command(f"{k}", "hold", (99,), 1.0))
    taken = mesh.taken(keys.COMMAND)
    assert taken[0].id == "land"
    assert len(taken) == 1 + keys.COMMAND.bounds.burst


def test_owners_without_number_share_one_allowance() -> None:
    """A stranger that takes a new name for each message gets no more work done than 33 others, and
    fills no table; agents of the plan are heard all the same."""
    mesh, bounds = Mesh(), keys.STATE.bounds
    for k in range(4000):
        mesh.say(keys.STATE, 100 + k, of(keys.STATE, 100 + k))
    mesh.say(keys.STATE, 3, STATE)
    taken = mesh.taken(keys.STATE)
    assert taken[-1] == STATE
    assert len(taken) <= 1 + 32 + bounds.burst
    assert len(mesh.node.refused(mesh.now)) <= 8


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


def test_the_owner_of_a_key() -> None:
    assert owner_of("swarm/S/agent/3/state") == ("agent", "3")
    assert owner_of("swarm/S/station/station-77-a1/command") == ("station", "station-77-a1")
    assert owner_of("") == ("", "")


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


def test_old_refusals_make_room() -> None:
    """A hundred owners are told of in turn; of a hundred at once, some share a name."""
    mesh = Mesh()
    for k in range(100):
        mesh.say(keys.STATE, 100 + k, STATE)
    mesh.taken(keys.STATE)
    mesh.say(keys.STATE, 300, STATE)
    mesh.taken(keys.STATE)
    assert {refusal.owner for refusal in mesh.node.refused(mesh.now)} >= {"agent 100"}
    mesh.now += 2 * RECENT_S
    mesh.say(keys.STATE, 300, STATE)
    mesh.taken(keys.STATE)
    assert [refusal.owner for refusal in mesh.node.refused(mesh.now)] == ["agent 300"]
