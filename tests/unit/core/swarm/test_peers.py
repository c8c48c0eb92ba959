"""What one agent counts of its peers."""

from __future__ import annotations

import pytest

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.timeouts import FRESH_S
from swarm_ctl.core.swarm.hearing import SMALL_SWARM
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.snapshot import OtherAircraft
from tests.unit.core.swarm.test_hearing import mission
from tests.unit.station.swarm import hexagon_plan, state_of


def test_the_age_of_a_state_is_not_counted_once_its_agent_has_ended() -> None:
    """Agent 2 ends at 5 s and says no more; agent 3 goes on."""
    plan = hexagon_plan()
    peers, links = Peers(plan, 1), {}
    for k in range(200):
        now = 0.05 * (k + 1)
        for agent in (2, 3):
            phase = Phase.ENDED if agent == 2 and now > 5.0 else Phase.FLY
            if agent == 3 or now <= 5.1:
                peers.hear(state_of(plan, agent, now, seq=k, phase=phase), now)
                peers.clocks.of[agent].answered(now - 0.01, now - 0.005, now - 0.005, now)
        peers.count_ages(now)
        links = {peer.id: peer.report(now) for peer in peers}
    assert [links[i].age_p99_s for i in (2, 3)] == [0.01, 0.01]


def test_the_link_from_one_that_is_expelled_has_no_age_until_it_is_listened_to_again() -> None:
    """Nobody wonders that it is not heard: no alarm, and no mesh that fell apart."""
    peers = Peers(LARGE, 1)
    peers.follow({2}, 9.0)
    ages_s = []
    for k, expelled in enumerate((False, True, True, False)):
        peers.expel({2} if expelled else (), 10.0 + k)
        tell(peers, 2, 10.0 + k, k + 1)
        ages_s.append(peers.links(10.5 + k)[2].age_s)
    assert ages_s == [pytest.approx(0.5), None, None, pytest.approx(0.5)]


LARGE = mission(SMALL_SWARM + 1)


def tell(peers: Peers, agent: int, now: float, seq: int, *, far: bool = False) -> None:
    """A state that was true when it came."""
    peers.clocks.of[agent].answered(now, now, now, now)
    peers.hear(state_of(LARGE, agent, now, seq=seq, phase=Phase.FLY), now, far=far)


def seen(peers: Peers, agent: int, now: float) -> OtherAircraft:
    """As the snapshot has it."""
    return next(peer for peer in peers.snapshot(now).peers if peer.id == agent)


def test_the_limits_of_a_far_peers_age_come_two_periods_later() -> None:
    """Fresh, followed, silent: one word may be lost. But it is not counted on to do its half by an
    old word. A near peer's limits are those of states once it was near for a second."""
    peers = Peers(LARGE, 1)
    for agent in (2, 3):
        tell(peers, agent, 10.0, 1, far=True)
    peers.follow({3}, 8.0)
    for after_s, fresh, followed in ((0.4, True, True), (1.4, True, True), (1.8, False, True)):
        far = seen(peers, 2, 10.0 + after_s)
        assert (far.fresh, far.followed, far.far) == (fresh, followed, True)
        assert far.yields is (after_s <= FRESH_S)
    assert not seen(peers, 2, 12.2).followed
    near = seen(peers, 3, 10.9)
    assert (near.fresh, near.followed, near.far) == (False, True, False)
    assert near.silent_s == pytest.approx(0.9)
    assert seen(peers, 2, 15.4).silent_s == pytest.approx(4.4, abs=0.11)
    assert seen(peers, 2, 15.4).age(15.4) == pytest.approx(5.4)


def test_a_state_is_rare_where_it_came_as_a_far_word_alone() -> None:
    """Whatever the peer is by now; what comes by both ways, in any order, is not."""
    peers = Peers(LARGE, 1)
    tell(peers, 2, 10.0, 1, far=True)
    assert seen(peers, 2, 10.1).rare
    peers.follow({2}, 10.2)
    assert seen(peers, 2, 14.0).rare
    tell(peers, 2, 14.1, 2, far=True)
    assert seen(peers, 2, 14.2).rare
    tell(peers, 2, 14.1, 2, far=False)
    tell(peers, 2, 14.1, 2, far=True)
    assert not seen(peers, 2, 14.2).rare
    peers.follow(set(), 14.3)
    assert not seen(peers, 2, 19.0).rare


def test_a_stop_of_the_agent_itself_is_no_silence_of_its_peers() -> None:
    """Its words are as old as they are; but nobody listened, so nobody was silent."""
    peers = Peers(LARGE, 1)
    peers.follow({3}, 8.0)
    for agent in (2, 3):
        tell(peers, agent, 10.0, 1, far=agent == 2)
    assert seen(peers, 3, 11.0).silent_s == pytest.approx(1.0)
    peers.sleep(8.0, 19.5)
    for agent in (2, 3):
        assert seen(peers, agent, 19.5).age(19.5) == pytest.approx(9.5)
        assert not seen(peers, agent, 19.5).followed
        assert seen(peers, agent, 19.5).silent_s == pytest.approx(1.5)
    peers.sleep(2.0, 22.0)  # what was heard by then was not heard again
    assert seen(peers, 3, 22.0).silent_s == pytest.approx(2.0)
    tell(peers, 3, 22.1, 2)
    assert seen(peers, 3, 27.6).silent_s == pytest.approx(5.5)
    peers.sleep(8.0, 27.6)  # longer than it was silent: it came while the agent was stopped
    assert seen(peers, 3, 27.6).silent_s == 0.0


def test_stops_do_not_pardon_a_peer_whose_words_are_late() -> None:
    """One that is heard 6 s late is lost, however often the agent is stopped for a moment."""
    peers = Peers(LARGE, 1)
    peers.follow({3}, 8.0)
    for k in range(10):
        now = 20.0 + 4.0 * k
        peers.clocks.of[3].answered(now - 6.0, now - 6.0, now - 6.0, now - 6.0)
        peers.hear(state_of(LARGE, 3, now - 6.0, seq=k + 1, phase=Phase.FLY), now)
        peers.sleep(0.7, now)
        assert seen(peers, 3, now).silent_s == pytest.approx(5.3)


def test_only_gaps_between_states_are_lost() -> None:
    """A far word that comes with its state or before it is no gap, nor is what was not subscribed
    to."""
    peers = Peers(LARGE, 1)
    tell(peers, 2, 10.0, 1, far=True)
    tell(peers, 2, 10.5, 11, far=True)
    peers.follow({2}, 10.6)
    for k in (14, 15, 16, 18):
        tell(peers, 2, 10.0 + 0.05 * k, k)
    tell(peers, 2, 11.0, 21, far=True)
    tell(peers, 2, 11.0, 21)
    tell(peers, 2, 11.05, 22)
    assert peers.links(11.1)[2].lost == 1 + 2
    peers.follow(set(), 11.1)
    assert peers.links(11.1) == {}
    peers.follow({2}, 14.0)
    tell(peers, 2, 14.05, 82)
    assert peers.links(14.1)[2].lost == 3


def test_a_far_peers_view_is_made_anew_when_it_changes() -> None:
    """When it is heard, when it is overdue, when it is doubted or expelled; at no other tick."""
    peers = Peers(LARGE, 1)
    tell(peers, 2, 10.0, 1, far=True)
    first = seen(peers, 2, 10.05)
    assert seen(peers, 2, 10.45) is first
    assert first.age(10.45) == pytest.approx(0.45)
    tell(peers, 2, 10.5, 11, far=True)
    second = seen(peers, 2, 10.55)
    assert second is not first
    peers.expel({2}, 10.6)
    assert seen(peers, 2, 10.6).expelled
    peers.expel((), 10.6)
    third = seen(peers, 2, 10.65)
    assert not third.expelled
    assert seen(peers, 2, 11.05) is not third
