"""No velocity leaves the safety layer above the limits, whatever goes in."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.plan import Limits
from swarm_ctl.core.safety import climb_rate, limited

LIMITS = Limits(speed_mps=5.0, climb_mps=1.0, descent_mps=0.5)
ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(ANY, ANY)
def test_speed_never_above_the_limit(north: float, east: float) -> None:
    """Infinities and NaN included; those become zero."""
    out = limited(complex(north, east), LIMITS)
    assert abs(out) <= LIMITS.speed_mps * (1 + 1e-12)
    if not math.isfinite(math.hypot(north, east)):
        assert out == 0


@given(st.floats(-100, 100), st.floats(-100, 100))
def test_direction_is_kept(north: float, east: float) -> None:
    out = limited(complex(north, east), LIMITS)
    assert out.real * east == pytest.approx(out.imag * north, abs=1e-6)
    assert out.real * north >= 0


def test_slow_velocities_pass_unchanged() -> None:
    assert limited(3.0 - 1.0j, LIMITS) == 3.0 - 1.0j


@given(ANY)
def test_climb_rate_within_limits(error: float) -> None:
    assert -LIMITS.descent_mps <= climb_rate(error, LIMITS) <= LIMITS.climb_mps


def test_too_low_climbs() -> None:
    assert climb_rate(0.5, LIMITS) > 0 > climb_rate(-0.5, LIMITS)
