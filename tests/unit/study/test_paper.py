"""The paper's experiments: what must be so whatever was chosen."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from swarm_ctl.study.batch.batch import Batch, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.paper import cases
from swarm_ctl.study.paper import reproduce as paper
from swarm_ctl.study.paper.claims import CLAIMS, holds
from swarm_ctl.study.paper.pairs import PairSteps
from swarm_ctl.study.paper.reproduce import hexagon, reproduce, studies_of
from swarm_ctl.study.rerun import Trace
from tests.unit.core.law.evaluated import evaluate


def test_both_forms_form_the_hexagon_alike() -> None:
    """Discrete and continuous end in the same shape, no two under r_in, at nearly the same
    iteration."""
    ends = []
    for part in (1.0, 0.5):
        trace = Trace()
        outcome = fly(hexagon(part), trace)
        assert outcome.converged[0]
        assert outcome.smallest[0] > 0.5
        ends.append((outcome.time_s[0], trace.positions()[-1]))
    assert abs(ends[0][0] - ends[1][0]) < 1.0
    assert np.abs(ends[0][1] - ends[1][1]).max() < 0.02


def test_everything_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures 7 to 17 as PNG and SVG, rows, and a table that names every claim."""
    monkeypatch.setattr(paper, "FORMS", {"discrete": 1.0})
    monkeypatch.setattr(cases, "_LIMIT", 100)
    reproduce(tmp_path, 1, 1, 1, Console(file=io.StringIO()), limit=100, cases=2)
    names = {path.name for path in (tmp_path / "discrete").iterdir()}
    assert names == {f"fig{k:02d}.{kind}" for k in range(7, 18) for kind in ("png", "svg")}
    text = " ".join((tmp_path / "claims.txt").read_text().split())
    for claim in CLAIMS:
        assert claim.text.split(":")[0] in text


def blocked(limit: int) -> Batch:
    """Two missions in which two agents must change places, head on."""
    cell = studies_of(2, 1, limit)["six-discrete"].cells()[0]
    batch = draw(cell.model_copy(update={"n": 2, "start": "random"}), 0, 2)
    starts = np.array([[-1.5, 1.5], [0.0, 0.0]])[..., None].repeat(2, axis=-1)
    links = ~np.eye(2, dtype=bool)[..., None].repeat(2, axis=-1)
    return replace(batch, starts=starts, slots=-starts, links=links)


@pytest.mark.parametrize(("limit", "at_rest"), [(100, False), (1000, True)])
def test_a_mission_at_rest_is_told_from_one_that_was_cut_off(limit: int, at_rest: bool) -> None:
    """Two agents that push against each other head on come to rest without a formation: that
    breaks an asymptotic claim. After 100 iterations they still move: that does not."""
    flown = fly(blocked(limit))
    assert not flown.converged.any()
    assert flown.stuck.tolist() == [at_rest, at_rest]


def test_a_claim_is_tested_only_where_it_could_break() -> None:
    """Bounds of pairs need a pair within r_out; formation needs an end other than the time-out."""
    statuses = ("paper", "narrow", "inactive", "overspeed")
    alone = {f"sigma_{name}": 0 for name in statuses} | {"converged": 0, "stuck": 0}
    met = alone | {"sigma_paper": 3, "stuck": 1}
    tested = {claim.text: (claim.tested(alone), claim.tested(met)) for claim in CLAIMS}
    assert tested["no distance under r_in"] == (False, True)
    assert tested["D_ub - D_lb > 2 for every pair"] == (False, True)
    assert tested["formation reached"] == (False, True)
    assert [holds(0, 0), holds(0, 9), holds(1, 9)] == ["not tested", "not broken", "no"]


def test_inequality_30_is_tested_on_the_law_itself() -> None:
    """The displacement beside each pair is |u_i| of the law at those positions."""
    batch, trace = hexagon(1.0, 400), Trace()
    steps = PairSteps(batch.cell.law)
    near = replace(batch, starts=batch.starts * 0.4)
    fly(near, steps)
    fly(near, trace)
    n = near.cell.n
    z, links = near.slots[..., 0].T, near.links[..., 0]
    law = replace(near.cell.law, h=float(near.h[0]))
    others, lower = ~np.eye(n, dtype=bool), np.triu(np.ones((n, n), dtype=bool), 1)
    u = [
        evaluate(
            p.T, z, np.tile(p.T, (n, 1, 1)), np.tile(z, (n, 1, 1)), links, others, lower, law
        ).u
        for p in trace.positions()
    ]
    sizes = np.linalg.norm(u, axis=-1)
    seen = steps.samples()
    assert len(seen.distance) > 100
    off = np.abs(seen.displacement[:, None] - sizes.ravel()).min(axis=1)
    assert off.max() < 1e-12
    assert (seen.bound <= seen.laxest + 1e-12).all()


def test_a_blocked_swarm_that_drifts_has_come_to_rest() -> None:
    """Table II with random slots, mission 9: the two agents of a pair see different sigmas, so the
    blocked swarm flies on as one, 0.3 units in 1000 iterations, and never forms."""
    cell = studies_of(40, 1, 5000)["six-discrete"].cells()[0]
    batch, trace = draw(cell, 0, 40).only(np.array([9, 9])), Trace()
    flown = fly(batch, trace)
    late, end = trace.positions()[[4000, 5000]]
    assert flown.stuck.all()
    assert np.linalg.norm((end - late).mean(axis=-1)) > 0.2
    shape = end - end.mean(axis=-1, keepdims=True), late - late.mean(axis=-1, keepdims=True)
    assert np.abs(shape[0] - shape[1]).max() < 1e-3
