"""Safety in studies: no pair collides where all did, the paper's own regime is not touched, links
hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from swarm_ctl.core.model.plan import Compensation
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import Range, Study, value

LATE: dict[str, Any] = {
    "missions": 40,
    "delay_s": (Range(low=0.0, high=0.2),),
    "loss": (Range(low=0.0, high=0.2),),
    "lag_s": (Range(low=0.3, high=0.6),),
    "start_spacing": 1.5,
    "limit_s": 120.0,
}


def missions(**settings: Any) -> Batch:
    """The one block of a small study."""
    ((cell, first, count),) = blocks(Study.model_validate(LATE | settings))
    return draw(cell, first, count)


@pytest.mark.parametrize("n", [6, 12])
def test_no_pair_collides_where_all_did(n: int) -> None:
    """Two columns that change sides, news late and lost: every mission of the bare law brings a
    pair under r_in."""
    crossing = {
        "n": (n,),
        "start": ("crossing",),
        "slots": ("given",),
        "shape": ("grid",),
        "h": value(0.2),
    }
    bare, safe = (fly(missions(**crossing, safety=(level,))) for level in ("off", "release"))
    assert (bare.smallest < 0.5).all()
    assert (safe.smallest > 0.5).all()
    assert safe.converged.all()
    assert (safe.touched > 0).all()


def test_the_papers_own_regime_is_not_touched() -> None:
    """(9) with Table I's gains: the filter changes nothing at all, so the reproduction is the
    paper's with it too."""
    plain = {
        "compensation": (Compensation.NONE,),
        "vehicle": ("ideal",),
        "slots": ("random",),
        "h": value(0.005),
        "delay_s": value(0.0),
        "loss": value(0.0),
        "limit_s": 30.0,
    }
    bare, safe = (fly(missions(**plain, safety=(level,))) for level in ("off", "filter"))
    assert not safe.touched.any()
    assert safe.smallest == pytest.approx(bare.smallest, rel=1e-9)


def test_links_whose_slots_fit_are_kept_by_the_guard() -> None:
    """Without it a good part of the missions stretches one past r."""
    free, guarded = (
        fly(missions(n=(6,), slots=("random",), safety=(level,), limit_s=20.0))
        for level in ("filter", "guard")
    )
    assert np.count_nonzero(free.kept_broken) > 10
    assert not guarded.kept_broken.any()


def test_a_vehicle_whose_agent_died_is_not_hit() -> None:
    """It flies its last command for half a second, then stands in the way for ever."""
    outcome = fly(missions(n=(6,), slots=("random",), silent=value(1.0), limit_s=25.0))
    assert np.count_nonzero(np.isfinite(outcome.smallest_silent)) > 10
    assert (outcome.smallest_silent > 0.5).all()
    assert (outcome.smallest > 0.5).all()


@pytest.mark.long
def test_sparse_swarms_form_sooner_when_all_move_to_the_average() -> None:
    """Forty scattered sparsely: the slowest mode of their graph takes a minute, the average of all
    does not."""
    settings = {"n": (40,), "missions": 8, "h": value(0.2)}
    alone, aligned = (fly(missions(**settings, safety=(level,))) for level in ("release", "align"))
    assert aligned.converged.all()
    assert np.median(aligned.time_s) < 0.7 * np.median(alone.time_s)
    assert (aligned.smallest > 0.5).all()
    assert not aligned.kept_broken.any()


def test_exchange_shortens_the_way() -> None:
    """Two that are in each other's way take each other's slots: sooner formed, and no pair comes
    under r_in."""
    settings = {"n": (6,), "slots": ("random",)}
    fixed, exchanged = (
        fly(missions(**settings, safety=(level,))) for level in ("align", "exchange")
    )
    assert exchanged.exchanges.sum() > 20
    assert exchanged.converged.all()
    assert np.median(exchanged.time_s) < np.median(fixed.time_s)
    assert (exchanged.smallest > 0.5).all()
