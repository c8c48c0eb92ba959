"""The law against worked cases of an independent implementation, and its properties
(docs/understand/law.md#what-must-hold)."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarm_ctl.core.kernel.law import NARROW, STATUSES
from swarm_ctl.core.model.plan import LawParameters
from tests.unit.core.law.evaluated import LawResult, evaluate

VECTORS = Path(
    os.environ.get("LAW_VECTORS", Path(__file__).parents[3] / "data" / "law_vectors.json")
)
CASES = json.loads(VECTORS.read_text())["cases"]
KEYS = {
    "distance": "distance",
    "sigma": "sigma",
    "sigma_lb": "sigma_lb",
    "dr_lb": "d_lb",
    "dr_ub": "d_ub",
    "dr": "d",
    "alpha": "alpha",
}


def evaluate_one(
    i: int, positions: np.ndarray, slots: np.ndarray, neighbours: list[int], law: LawParameters
) -> LawResult:
    """Agent i of `positions` (n, 2), as an agent calls it: leading size 1; column j of the pairs is
    id j without i."""
    others = [j for j in range(len(positions)) if j != i]
    return evaluate(
        positions[None, i],
        slots[None, i],
        positions[None, others],
        slots[None, others],
        np.array([[j in neighbours for j in others]]),
        np.ones((1, len(others)), dtype=bool),
        np.array([[i < j for j in others]]),
        law,
    )


@pytest.mark.parametrize("case", CASES, ids=[str(i) for i in range(len(CASES))])
def test_worked_cases(case: dict[str, Any]) -> None:
    """Every number of every case agrees to 1e-9 relative."""
    ids = sorted(case["positions"], key=int)
    i = ids.index(str(case["agent"]))
    result = evaluate_one(
        i,
        np.array([case["positions"][k] for k in ids], dtype=float),
        np.array([case["formation"][k] for k in ids], dtype=float),
        [ids.index(str(k)) for k in case["neighbours"]],
        LawParameters(**case["params"]),
    )
    expect = case["expect"]
    scale = max(np.linalg.norm(expect["consensus"]), np.linalg.norm(expect["avoidance"]))
    for name in ("u", "consensus", "avoidance"):
        # u may cancel to nearly nothing: relative to its terms
        assert getattr(result, name)[0] == pytest.approx(
            expect[name], rel=1e-9, abs=1e-9 * scale
        ), name
    others = [k for k in ids if k != str(case["agent"])]
    assert _pair_ids(result, others) == sorted(expect["pairs"])
    for k, (_, column) in enumerate(zip(*result.pairs.index, strict=True) if result.pairs else ()):
        _check_pair(result, k, expect["pairs"][others[column]])


def _pair_ids(result: LawResult, others: list[str]) -> list[str]:
    return sorted(others[j] for j in result.pairs.index[-1]) if result.pairs else []


def _check_pair(result: LawResult, k: int, want: dict[str, Any]) -> None:
    assert result.pairs is not None
    assert STATUSES[result.pairs.status[k]] == want["status"]
    assert bool(result.pairs.neighbour[k]) == want["neighbour"]
    for name, mine in KEYS.items():
        got = float(getattr(result.pairs, mine)[k])
        if want[name] is None:
            assert np.isnan(got), name
        else:
            assert got == pytest.approx(want[name], rel=1e-9, abs=1e-15), (name, want["status"])


# --- properties
# -------------------------------------------------------------------------------------------------

HEXAGON = LawParameters()


def coordinates(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit, allow_nan=False, width=64)


@st.composite
def swarms(
    draw: st.DrawFn, limit: float = 6.0
) -> tuple[np.ndarray, np.ndarray, list[int], LawParameters]:
    """(positions, slots, neighbours of agent 0, parameters): 2 to 7 agents, crowded enough to
    meet."""
    n = draw(st.integers(2, 7))
    positions = draw(arrays(float, (n, 2), elements=coordinates(limit)))
    slots = draw(arrays(float, (n, 2), elements=coordinates(limit)))
    neighbours = draw(st.lists(st.integers(1, n - 1), unique=True))
    law = replace(HEXAGON, h=draw(st.sampled_from([0.005, 0.05, 0.5])))
    return positions, slots, neighbours, law


@given(swarms(), coordinates(1e3), coordinates(1e3))
def test_translation_changes_nothing(swarm: Any, dx: float, dy: float) -> None:
    """Moving all agents together moves nothing of u."""
    positions, slots, neighbours, law = swarm
    shifted = positions + np.array([dx, dy])
    assume(_far_from_edges(positions, law) and _far_from_edges(shifted, law))
    a = evaluate_one(0, positions, slots, neighbours, law)
    b = evaluate_one(0, shifted, slots, neighbours, law)
    assume(_same_statuses(a, b))
    assert b.u == pytest.approx(a.u, rel=1e-6, abs=1e-6)


@given(swarms(), st.floats(0.0, 2 * np.pi))
def test_rotation_turns_u(swarm: Any, angle: float) -> None:
    """Turning the whole scene turns u by the same angle."""
    positions, slots, neighbours, law = swarm
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    assume(_far_from_edges(positions, law))
    a = evaluate_one(0, positions, slots, neighbours, law)
    b = evaluate_one(0, positions @ turn, slots @ turn, neighbours, law)
    assume(_same_statuses(a, b))
    assert b.u == pytest.approx(a.u @ turn, rel=1e-6, abs=1e-6)


@given(swarms(), st.randoms(use_true_random=False))
def test_relabelling_changes_nothing(swarm: Any, random: Any) -> None:
    """The order in which the others are listed does not matter."""
    positions, slots, neighbours, law = swarm
    assume(_far_from_edges(positions, law))
    order = list(range(1, len(positions)))
    random.shuffle(order)
    order = [0, *order]
    a = evaluate_one(0, positions, slots, neighbours, law)
    b = evaluate_one(0, positions[order], slots[order], [order.index(j) for j in neighbours], law)
    assert b.u == pytest.approx(a.u, rel=1e-9, abs=1e-12)


@given(swarms(limit=50.0), coordinates(100.0))
def test_formed_and_apart_means_rest(swarm: Any, offset: float) -> None:
    """u is zero when all e_i agree and no agent is within r_out."""
    _, slots, neighbours, law = swarm
    assume(_smallest_distance(slots) > law.r_out + 1e-6)
    result = evaluate_one(0, slots + offset, slots, neighbours, law)
    assert np.abs(result.u).max() < 1e-12
    assert result.pairs is None


@given(swarms())
def test_repulsion_stays_inside_its_bound(swarm: Any) -> None:
    """(44) for neighbours and (68) for strangers hold for every `paper` or `narrow` pair."""
    positions, slots, neighbours, law = swarm
    result = evaluate_one(0, positions, slots, neighbours, law)
    if result.pairs is None:
        return
    error = positions - slots
    n = sum((error[j] - error[0] for j in neighbours), start=np.zeros(2))
    columns = range(1, len(positions))
    strangers = sum(not neighbour for neighbour in result.pairs.neighbour)
    for k, column in enumerate(result.pairs.index[-1]):
        if result.pairs.status[k] > NARROW:
            continue
        q = positions[0] - positions[columns[column]]
        if np.linalg.norm(q) < 1e-9:
            q = np.array([np.sqrt(law.delta_a), 0.0])
        x = float(np.linalg.norm(q))
        room = law.r / result.pairs.d[k] - x / 2
        if result.pairs.neighbour[k]:
            N = len(neighbours)
            pushed = np.linalg.norm(result.pairs.alpha[k] * q + law.h / N**2 * n)
            assert pushed < room / (2 * N) * (1 + 1e-9)
        else:
            assert result.pairs.alpha[k] * x < room / (2 * strangers) * (1 + 1e-9)


@given(
    arrays(float, st.tuples(st.integers(2, 6), st.just(2)), elements=coordinates(1e6)),
    st.booleans(),
    st.integers(0, 2),
)
def test_finite_for_all_inputs(positions: np.ndarray, crowd: bool, linked: int) -> None:
    """sigma > 0 and finite, u finite, for every input up to 1e6 units, crowds and equal spots
    included."""
    if crowd:
        positions = positions * 1e-6
    slots = positions[::-1] * 1e3 if crowd else positions[::-1]
    result = evaluate_one(
        0, positions, slots, list(range(1, min(linked + 1, len(positions)))), HEXAGON
    )
    assert np.isfinite(result.u).all()
    if result.pairs is not None:
        assert (result.pairs.sigma > 0).all()
        assert np.isfinite(result.pairs.sigma).all()


def test_one_spot_parts_them() -> None:
    """Two agents on one spot push in opposite directions, the lower id to the north."""
    positions = np.zeros((2, 2))
    a = evaluate_one(0, positions, positions, [], HEXAGON)
    b = evaluate_one(1, positions, positions, [], HEXAGON)
    assert a.u[0, 0] > 0.1
    assert b.u == pytest.approx(-a.u)


def _smallest_distance(points: np.ndarray) -> float:
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return float(gaps[~np.eye(len(points), dtype=bool)].min())


def _far_from_edges(positions: np.ndarray, law: LawParameters) -> bool:
    """No distance so near 0 or r_out that rounding could change which case applies."""
    x = np.linalg.norm(positions[1:] - positions[0], axis=-1)
    return bool((np.abs(x - law.r_out) > 1e-6).all() and (x > 1e-2).all())


def _same_statuses(a: LawResult, b: LawResult) -> bool:
    if a.pairs is None or b.pairs is None:
        return a.pairs is b.pairs
    return bool((a.pairs.status == b.pairs.status).all())
