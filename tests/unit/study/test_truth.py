"""What the vehicles truly do, and what their agents believe of them, are two things."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import AGENT_RANGES, Range, Study, value
from tests.unit.study.flown import Flown

UNEQUAL: dict[str, Any] = {
    "missions": 40,
    "seed": 3,
    "lag_s": (Range(low=0.1, high=1.0),),
    "dead_time_s": (Range(low=0.0, high=0.8),),
    "acceleration_mps2": (Range(low=1.0, high=4.0),),
    "delay_s": (Range(low=0.0, high=0.3),),
    "late_s": (Range(low=-0.3, high=0.2),),
    "lag_error_s": (Range(low=-0.2, high=0.2),),
    "limit_s": 2.0,
}


def missions(**settings: Any) -> Batch:
    """The one block of a small study."""
    ((cell, first, count),) = blocks(Study.model_validate(UNEQUAL | settings))
    return draw(cell, first, count)


def test_vehicles_of_a_mission_are_alike_or_each_is_its_own() -> None:
    """From the same range; all else of the missions is the same."""
    alike, own = (missions(spread=(spread,)) for spread in ("mission", "agent"))
    for name in AGENT_RANGES:
        (span,) = UNEQUAL[name]
        one, each = getattr(alike, name), getattr(own, name)
        assert (one == one[0]).all()
        assert (np.ptp(each, axis=0) > 0).all()
        assert (each >= span.low).all()
        assert (each <= span.high).all()
        assert np.ptp(each) > 0.9 * (span.high - span.low)
    assert (alike.starts == own.starts).all()
    assert (alike.slots == own.slots).all()


def test_each_vehicle_answers_as_it_is() -> None:
    """A step of the command: still until the own dead time is over, then the own lag, never faster
    than the own acceleration."""
    batch = missions(spread=("agent",), n=(4,), missions=12)
    flown, tick_s = Flown(batch), 0.05
    speeds = []
    for _ in range(60):
        flown.steer(0.4)  # 2 m/s
        speeds.append(flown.agent["velocity_mps"].T.real.copy())
    speed = np.array(speeds)
    moves = (speed > 0).argmax(axis=0)
    assert (moves == np.rint(np.maximum(batch.dead_time_s + batch.late_s, 0.0) / tick_s)).all()
    want = np.zeros((4, 12))
    for tick in range(60):
        share = -np.expm1(-tick_s / np.maximum(batch.lag_s + batch.lag_error_s, 0.001))
        gain = np.minimum((2.0 - want) * share, batch.acceleration_mps2 * tick_s)
        want = np.where(tick >= moves, want + gain, 0.0)
        assert speed[tick] == pytest.approx(want, abs=1e-9)


@pytest.mark.parametrize("vehicle", ["lag", "px4"])
def test_missions_do_not_depend_on_the_missions_beside(vehicle: str) -> None:
    """Each vehicle keeps its dead time, lag and acceleration in another company, and in one that
    got smaller."""
    settings = {"missions": 6, "limit_s": 20.0, "settle_s": 0.0, "vehicle": vehicle}
    batch = missions(spread=("agent",), **settings)
    keep = np.array([0, 2, 3])
    whole, part = fly(batch), fly(batch.only(keep))
    assert len(set(whole.steps)) > 1
    for name in ("smallest", "error", "time_s", "touched", "steps"):
        assert (getattr(part, name) == getattr(whole, name)[keep]).all(), name


def test_a_model_of_no_lag_is_refused() -> None:
    with pytest.raises(ValueError, match="model_lag_s"):
        missions(model_lag_s=(0.0,))
    with pytest.raises(ValueError, match="acceleration_mps2: allowed"):
        missions(acceleration_mps2=value(0.0))
