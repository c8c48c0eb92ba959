"""No wish passes above the speed limit, whatever goes in."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.wish import bent, limited

SPEED = 5.0
ANY = st.floats(allow_nan=True, allow_infinity=True)
SOME = st.floats(-100, 100)


@given(ANY, ANY)
def test_speed_never_above_the_limit(north: float, east: float) -> None:
    """Infinities and NaN included; those become zero."""
    out = limited(complex(north, east), SPEED)
    assert abs(out) <= SPEED * (1 + 1e-12)
    if not math.isfinite(math.hypot(north, east)):
        assert out == 0


@given(SOME, SOME)
def test_direction_is_kept(north: float, east: float) -> None:
    """A wish is scaled, not turned."""
    out = limited(complex(north, east), SPEED)
    assert out.real * east == pytest.approx(out.imag * north, abs=1e-6)
    assert out.real * north >= 0


def test_slow_velocities_pass_unchanged() -> None:
    """To the last bit."""
    assert limited(3.0 - 1.0j, SPEED) == 3.0 - 1.0j


@given(SOME, SOME, SOME, SOME, st.floats(0, 5))
def test_a_bent_wish_does_not_close_in_faster(
    north: float, east: float, away_north: float, away_east: float, closing: float
) -> None:
    """Towards the other aircraft at most `closing`."""
    wish, away = complex(north, east), complex(away_north, away_east)
    if abs(away) < 1e-3:
        return
    out = bent(wish, away, closing)
    assert -(out * away.conjugate()).real / abs(away) <= closing + 1e-6
