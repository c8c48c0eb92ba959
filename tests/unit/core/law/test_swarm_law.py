"""The law for whole swarms gives every agent what `law.evaluate` gives it alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law.formation_law import STATUSES, evaluate
from swarm_ctl.core.law.swarm_law import Rings, SwarmLaw
from swarm_ctl.core.model.plan import LawParameters

LAW = LawParameters(h=0.05)


@st.composite
def batches(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(points, slots, links): m missions of n agents, crowded; some agents on one spot."""
    n, m = draw(st.sampled_from([2, 3, 5, 6, 7, 17])), draw(st.integers(1, 5))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    side = draw(st.sampled_from([0.5, 3.0, 8.0]))
    points, slots = random.random((2, n, m)) * side, random.random((2, n, m)) * 8
    if draw(st.booleans()):
        points[:, 1] = points[:, 0]
    links = np.triu(random.random((m, n, n)) < draw(st.sampled_from([0.0, 0.4, 1.0])), 1)
    return points, slots, np.moveaxis(links | links.transpose(0, 2, 1), 0, -1)


def one_by_one(points: np.ndarray, slots: np.ndarray, links: np.ndarray) -> Any:
    """`evaluate` over (m, n) agents, each hearing all others and ignoring itself."""
    _, n, m = points.shape
    p, z = points.transpose(2, 1, 0), slots.transpose(2, 1, 0)
    others, other_slots = (np.repeat(a[:, None], n, axis=1) for a in (p, z))
    present = np.broadcast_to(~np.eye(n, dtype=bool), (m, n, n))
    lower = np.broadcast_to(np.triu(np.ones((n, n), dtype=bool), 1), (m, n, n))
    return evaluate(p, z, others, other_slots, np.moveaxis(links, -1, 0), present, lower, LAW)


@given(batches())
def test_same_as_one_by_one(batch: Any) -> None:
    """u agrees for every agent, and each pair's sigma and status for both of its agents."""
    points, slots, links = batch
    u, near = SwarmLaw(slots, links, np.full(points.shape[-1], LAW.h), LAW).step(points)
    want = one_by_one(points, slots, links)
    assert u.transpose(2, 1, 0) == pytest.approx(want.u, rel=1e-9, abs=1e-12)
    if near is None:
        assert want.pairs is None
        return
    sigma = np.full(links.shape, np.nan)
    status = np.full(links.shape, len(STATUSES))
    for row, (i, j) in enumerate(((near.first, near.second), (near.second, near.first))):
        sigma[i, j, near.mission] = near.numbers.sigma[row]
        status[i, j, near.mission] = near.numbers.status[row]
    mission, i, j = want.pairs.index
    assert np.count_nonzero(~np.isnan(sigma)) == len(i)
    settled = want.pairs.status == status[i, j, mission]
    assert (
        settled.mean() > 0.9
    )  # a pair on the edge between two statuses may fall to either side by rounding
    assert sigma[i, j, mission][settled] == pytest.approx(
        want.pairs.sigma[settled], rel=1e-6, abs=1e-9
    )


@given(batches())
def test_heard_truth_is_truth(batch: Any) -> None:
    """Agents that hear each other's present places do what agents do that know them, told once for
    all or to each apart."""
    points, slots, links = batch
    law = SwarmLaw(slots, links, np.full(points.shape[-1], LAW.h), LAW)
    n = points.shape[1]
    u, _ = law.step(points)
    for heard in (points[:, None], np.repeat(points[:, None], n, axis=1)):
        terms = law.step_heard(points, heard, slots, slots[:, None])
        assert terms.consensus + terms.avoidance == pytest.approx(u, rel=1e-9, abs=1e-12)


@given(batches())
def test_squared_distances_of_every_pair(batch: Any) -> None:
    """The pair layout holds each pair's squared distance, and `once` names each pair exactly
    once."""
    points, _, _ = batch
    _, n, m = points.shape
    rings = Rings(n, m)
    apart = points[:, rings.first] - points[:, rings.second]
    assert rings.measure(points) == pytest.approx((apart**2).sum(axis=0))
    named = {
        frozenset(pair)
        for pair in zip(rings.first[rings.once], rings.second[rings.once], strict=True)
    }
    assert len(named) == rings.once.sum() == n * (n - 1) // 2


def test_a_mission_does_not_depend_on_its_batch() -> None:
    """To the last bit: a mission moves with one other as it does among many."""
    random = np.random.default_rng(3)
    for n in (6, 20):
        points, slots = random.random((2, n, 50)) * 6, random.random((2, n, 50)) * 8
        links = np.ones((n, n, 50), dtype=bool) & ~np.eye(n, dtype=bool)[..., None]
        law = SwarmLaw(slots, links, np.full(50, LAW.h), LAW)
        together, _ = law.step(points)
        chosen = np.zeros(50, dtype=bool)
        chosen[[17, 30]] = True
        alone, _ = law.only(chosen).step(np.ascontiguousarray(points[..., chosen]))
        assert (alone[..., 0] == together[..., 17]).all()
