"""What a law sees of the others."""

from __future__ import annotations

from cmath import phase

import pytest

from swarm_ctl.core.kernel.receiver import out_of_reach


@pytest.mark.parametrize("away", [3 + 0j, -0.3 + 0.4j, 60j])
@pytest.mark.parametrize("reach", [0.5, 7.0])
def test_one_that_is_apart_by_height_is_moved_straight_away_by_the_reach(
    away: complex, reach: float
) -> None:
    """So the law sees it beyond, on the same side; on the same spot, northwards."""
    moved = out_of_reach(away, reach)
    assert abs(moved) == pytest.approx(reach)
    assert phase(moved) == pytest.approx(phase(away))
    assert abs(away + moved) >= reach
    assert out_of_reach(0j, reach) == reach


def test_a_reach_without_end_stays_a_number() -> None:
    assert 0.0 < abs(out_of_reach(1 + 1j, float("inf"))) < float("inf")
