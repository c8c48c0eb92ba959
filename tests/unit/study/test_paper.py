"""The paper's experiments: what must be so whatever was chosen."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from swarm_ctl.study import paper
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.paper import hexagon, reproduce, thirty_two
from swarm_ctl.study.paper_claims import CLAIMS
from swarm_ctl.study.rerun import Trace


def test_table_two_is_the_path_graph() -> None:
    """At r = 4.5: 6-2-1-3-5-4 and nothing else."""
    links = hexagon(1.0).links[..., 0]
    found = {(i + 1, j + 1) for i, j in np.argwhere(np.triu(links)).tolist()}
    assert found == {(2, 6), (1, 2), (1, 3), (3, 5), (4, 5)}


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


def test_thirty_two_start_in_their_square() -> None:
    starts = thirty_two(1.0).starts
    assert starts.shape == (2, 32, 1)
    assert starts.min() >= 0
    assert starts.max() <= 20


def test_everything_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures 7 to 17 as PNG and SVG, rows, and a table that names every claim."""
    monkeypatch.setattr(paper, "FORMS", {"discrete": 1.0})
    reproduce(tmp_path, 2, 1, 1, Console(file=io.StringIO()), limit=600, cases=3)
    names = {path.name for path in (tmp_path / "discrete").iterdir()}
    assert names == {f"fig{k:02d}.{kind}" for k in range(7, 18) for kind in ("png", "svg")}
    text = " ".join((tmp_path / "claims.txt").read_text().split())
    for claim in CLAIMS:
        assert claim.text.split(":")[0] in text
