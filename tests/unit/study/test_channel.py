"""What agents hear in a study: late by chance, lost in bursts, overtaken; and several that die."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.timeouts import FAR_LATE_S
from swarm_ctl.core.swarm.clocks import PeerClock
from swarm_ctl.core.swarm.peers import Peer
from swarm_ctl.core.swarm.plausibility import BeliefLimits
from swarm_ctl.study.batch import flight
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.batch.missions import DRAWN
from swarm_ctl.study.parameter_space import Range, Study
from tests.unit.core.builders import plan
from tests.unit.study.flown import Flown

TICK_S = 0.05


def missions(**settings: Any) -> Batch:
    """The one block of a small study."""
    study = Study.model_validate({"missions": 20, "seed": 8, "n": 4, "limit_s": 5.0} | settings)
    ((cell, first, count),) = blocks(study)
    return draw(cell, first, count)


def state(tick: int) -> AgentState:
    """What an agent says at a tick, at 2 m/s."""
    place = (0.1 * tick, 0.0)
    return AgentState(
        *(1, tick, tick * TICK_S, 0, Phase.FLY, 1, False, True, (*place, -8.0), (0.0, 0.0, 0.0)),
        *(place, (0.0, 0.0)),
    )


def test_states_that_overtake_each_other_are_heard_as_agents_hear_them() -> None:
    """What is heard is what `Peer` keeps of the same arrivals, tick by tick."""
    batch = missions(delay_s="0:0.2", jitter_s=0.5, loss=0.2, spread="agent")
    flown, mission = Flown(batch), 7
    many, whole = flown.many, flown.many.whole[mission]
    ways: dict[tuple[int, int], list[tuple[int, int]]] = {}
    peers = {way: Peer(1, PeerClock(), BeliefLimits.of(plan())) for way in ((0, 1), (2, 3), (3, 0))}
    for peer in peers.values():
        peer.clock.answered(0.0, 0.0, 0.0, 0.0)
    overtaken = 0
    for tick in range(200):
        flown.hear(batch.starts + tick)
        for (i, j), peer in peers.items():
            q = flown.pair[mission, i, j]
            if not q.lost:
                by_chance = whole.jitter * many.jitter[mission, tick % DRAWN, i, j]
                late = round(flown.agent[mission, j].exact_delay + by_chance)
                ways.setdefault((i, j), []).append((tick + late, tick))
            for _, told in [way for way in ways.get((i, j), []) if way[0] == tick]:
                overtaken += peer.state is not None and told < peer.state.seq
                peer.hear(state(told), tick * TICK_S)
            if peer.state is not None:
                told_at = q.told.real - batch.starts[0, j, mission]
                assert told_at == pytest.approx(peer.state.seq)
                assert q.sent_at == peer.state.seq
    assert overtaken > 50


def others(n: int) -> Any:
    """Pairs of two (n, n)."""
    return ~np.eye(n, dtype=bool)


@pytest.mark.parametrize(("loss", "burst_s"), [(0.2, 0.5), (0.05, 1.0), (0.6, 0.0), (0.3, 0.05)])
def test_losses_come_in_bursts_and_keep_their_share(loss: float, burst_s: float) -> None:
    """The share that is asked for, and the mean length; without bursts that of single chances."""
    batch = missions(loss=loss, burst_s=burst_s, missions=60, limit_s=150.0, settle_s=300.0)
    flown, each = Flown(batch), []
    for _ in range(3000):
        flown.draw()
        flown.stage(flight.DECIDE)
        flown.tick += 1
        each.append(flown.pair["lost"][:, others(4)])
    lost = np.array(each)
    starts = np.count_nonzero(lost[1:] & ~lost[:-1])
    assert lost.mean() == pytest.approx(loss, rel=0.05)
    want = max(burst_s / TICK_S, 1.0 / (1.0 - loss))
    assert np.count_nonzero(lost[1:]) / starts == pytest.approx(want, rel=0.05)


def test_losses_do_not_depend_on_the_missions_beside() -> None:
    """Jitter and bursts, too: the same row in another company hears the same."""
    batch = missions(jitter_s=0.2, loss=0.3, burst_s=0.4)
    some = np.array([3, 11])
    whole, part = Flown(batch), Flown(batch.only(some))
    for tick in range(150):
        sent = batch.starts + tick
        whole.hear(sent)
        part.hear(sent[..., some])
        assert (whole.told[some] == part.told).all()


@pytest.mark.parametrize(("given", "want"), [("1", 1), ("3", 3), ("0.5", 3), ("0.01", 1), ("9", 5)])
def test_as_many_agents_die_as_are_asked_for(given: str, want: int) -> None:
    """A number, or a share of the six; one of them lives."""
    batch = missions(n=6, silent=0.5, silent_agents=given, missions=60)
    dead = np.isfinite(batch.silent_s).sum(axis=0)
    assert (dead == batch.silent_agents).all()
    assert set(dead) == {0, want}
    assert (batch.silent_s[np.isfinite(batch.silent_s)] <= 20.0).all()
    assert len(np.unique(batch.silent_s[np.isfinite(batch.silent_s)])) == dead.sum()


def test_a_distance_counts_between_two_ticks() -> None:
    """Two that cross within a tick come as close as their ways do, not as their places do."""
    batch = missions(
        n=2,
        vehicle="ideal",
        safety="off",
        speed_mps=20.0,
        unit_m=1.0,
        h=0.5,
        shape="line",
        slots="random",
        missions=80,
        area=6.0,
        settle_s=100.0,
    )
    tracks: list[Any] = []
    outcome = fly(batch, lambda *seen: tracks.append(seen[2].copy()))
    track = np.array(tracks)[:, :, 0] - np.array(tracks)[:, :, 1]
    shares = np.linspace(0.0, 1.0, 201)[:, None, None, None]
    between = np.linalg.norm(track[:-1] + shares * np.diff(track, axis=0), axis=2).min(axis=(0, 1))
    ticks = np.linalg.norm(track, axis=1).min(axis=0)
    assert (outcome.smallest <= between + 1e-9).all()
    assert outcome.smallest == pytest.approx(between, abs=5e-3)
    assert (ticks - outcome.smallest).max() > 0.01


def test_states_later_than_a_lost_agent_are_refused() -> None:
    with pytest.raises(ValueError, match="delay_s, jitter_s: allowed: up to 1 s together"):
        missions(delay_s=(Range(low=0.0, high=0.5),), jitter_s=0.6)


def test_far_news_is_as_old_as_far_words() -> None:
    """Two groups of nine that pass each other: a near peer's states come at every tick, from five
    ticks after it has come near; a far peer's word twice a second. The limits of age are later for
    far peers, and for those that came near a moment ago, as `Peer` has them."""
    batch = missions(n=18, missions=2, delay_s="0:0.1", area=12.0)
    flown = Flown(batch)
    pair = flown.pair
    speed = np.where(np.arange(18) < 9, 0.1, -0.1)[:, None]
    delay = np.rint(batch.delay_s / TICK_S).T[:, None]
    near_since = np.where(pair["near"], -100.0, np.inf)
    newest, came, went = np.zeros(pair.shape), 0, 0
    peers = [Peer(1, PeerClock(), BeliefLimits.of(plan())) for _ in range(18)]
    for peer, near in zip(peers, pair["near"][0, 0], strict=True):
        peer.near_s = -100.0 if near else np.inf
    for tick in range(200):
        points = batch.starts.copy()
        points[0] += (tick - 100) * speed
        flown.hear(points)
        sent = np.broadcast_to(tick - delay, pair.shape)
        arrives = (sent + np.arange(18)) % 10 == 0
        arrives |= sent >= near_since + 5
        newest = np.where(arrives, sent, newest)
        assert (np.maximum(pair["sent_at"], 0) == np.maximum(newest, 0))[:, others(18)].all()
        since = flight.since(flown.setup, tick)
        for j, peer in enumerate(peers):
            if j and tick - near_since[0, 0, j] != 20:  # the limit itself, to rounding
                late_s = FAR_LATE_S if pair["heard_from"][0, 0, j] > since else 0.0
                assert late_s == peer.late_s(tick * TICK_S)
        before = pair["near"].copy()
        flown.look_around(tick)
        came += np.count_nonzero(pair["near"] & ~before)
        went += np.count_nonzero(before & ~pair["near"])
        near_since = np.where(pair["near"], np.where(before, near_since, tick), np.inf)
        for peer, near in zip(peers, pair["near"][0, 0], strict=True):
            peer.approach(tick * TICK_S, near=bool(near))
        assert (pair["near"] | ~pair["link"]).all()
    assert min(came, went) > 50
