"""Dead time, lag and acceleration limit out of step responses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from swarm_ctl.core.identification.fit import Fit, Leg, fit, model
from swarm_ctl.core.model.plan import Response

TICK_S = 0.05
STEPS = ((1.0, 3.0), (3.0, 0.7), (3.0, 1.5), (3.0, 3.0))
USUAL = Response(0.4, 0.5, 2.8)


def flown(
    vehicle: Response, *, noise_mps: float = 0.0, late_s: float = 0.0, seed: int = 1
) -> list[Leg]:
    """What a vehicle that answers exactly like this would be heard to do, each tick a little
    late."""
    dice = np.random.default_rng(seed)
    legs = []
    for way in ("north", "east"):
        for speed, hold_s in STEPS:
            hold, rest = np.ones(round(hold_s / TICK_S)), np.zeros(round(3.0 / TICK_S))
            commands = speed * np.concatenate([hold, rest, -hold, rest])
            times = TICK_S * np.arange(len(commands)) + dice.uniform(0.0, late_s, len(commands))
            speeds = model(times, commands, vehicle)
            places = np.concatenate([[0.0], np.cumsum(speeds[:-1] * np.diff(times))])
            heard = speeds + dice.normal(0.0, noise_mps, len(speeds)) if noise_mps else speeds
            legs.append(Leg(way, f"{speed:g} m/s for {hold_s:g} s", times, commands, places, heard))
    return legs


def found(vehicle: Response, typical: Response = USUAL, **how: float) -> Fit:
    return fit(flown(vehicle, **how), typical)  # type: ignore[arg-type]


@settings(
    max_examples=3, phases=[Phase.explicit, Phase.generate]
)  # half a second each: too slow to shrink
@example(
    dead_s=0.0, lag_s=0.7946869188763019, reached=0.265, noise_mps=0.011265475878286472, seed=325
)
@example(
    dead_s=1e-05,
    lag_s=0.7846996634671557,
    reached=0.2579131687233733,
    noise_mps=0.039831600706844716,
    seed=263,
)
@given(
    dead_s=st.floats(0.0, 1.0),
    lag_s=st.floats(0.3, 1.0),
    reached=st.floats(0.25, 0.5),
    noise_mps=st.floats(0.0, 0.05),
    seed=st.integers(0, 1000),
)
def test_what_went_in_comes_out(
    dead_s: float, lag_s: float, reached: float, noise_mps: float, seed: int
) -> None:
    """Up to noise of 2 % of the step and late ticks: dead time within 0.02 s, lag within 8 %, limit
    within 5 %.

    The limit is a share of what the largest step asks for.
    """
    most_mps2 = reached * 3.0 / lag_s
    fitted = found(Response(dead_s, lag_s, most_mps2), noise_mps=noise_mps, late_s=0.01, seed=seed)
    assert fitted.limited
    assert fitted.usable
    assert fitted.response.dead_time_s == pytest.approx(dead_s, abs=0.02)
    assert fitted.response.lag_s == pytest.approx(lag_s, rel=0.08)
    assert fitted.response.acceleration_mps2 == pytest.approx(most_mps2, rel=0.05)
    assert fitted.residual_mps == pytest.approx(noise_mps, abs=0.03)


def test_a_typical_limit_that_is_too_low_does_not_bend_the_rest() -> None:
    fitted = found(Response(0.1, 0.6, 8.0), Response(0.4, 0.5, 2.0))
    assert fitted.response.acceleration_mps2 > 4.0
    assert fitted.response.lag_s == pytest.approx(0.6, rel=0.05)


def test_an_exact_vehicle_stops_where_it_is_predicted_to() -> None:
    """Half a tick at 3 m/s is what sampling alone costs."""
    fitted = found(Response(0.4, 0.5, 20.0))
    assert fitted.stop_rms_m < 0.05
    assert fitted.stop_most_m < 0.15
    assert fitted.warnings == ()
    assert all(part.dead_time_s == pytest.approx(0.4, abs=0.02) for part in fitted.spread)


def test_legs_that_differ_from_way_to_way_are_said() -> None:
    """North answers 0.3 s sooner than east."""
    legs = [
        leg
        for vehicle, way in ((Response(0.2, 0.5, 3.0), "north"), (Response(0.5, 0.5, 3.0), "east"))
        for leg in flown(vehicle)
        if leg.way == way
    ]
    assert any("from way to way" in text for text in fit(legs, USUAL).warnings)


def test_a_vehicle_that_does_not_obey_is_not_to_be_flown_with() -> None:
    """One that stands, and one that goes somewhere else."""
    for factor in (0.0, -1.0):
        legs = [
            Leg(
                leg.way,
                leg.kind,
                leg.times_s,
                leg.commands_mps,
                leg.positions_m,
                factor * np.asarray(leg.velocities_mps),
            )
            for leg in flown(USUAL)
        ]
        fitted = fit(legs, USUAL)
        assert not fitted.usable
        assert fitted.warnings


def test_no_steps_no_fit() -> None:
    leg = flown(USUAL)[0]
    still = Leg(
        "north", "", leg.times_s, (0.0,) * len(leg.times_s), leg.positions_m, leg.velocities_mps
    )
    for legs in ([], [still]):
        with pytest.raises(ValueError, match="no steps"):
            fit(legs, USUAL)
