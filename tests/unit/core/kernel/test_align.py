"""The pull to the average error of all agents that are heard."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.control.controller import LawInputBuilder
from swarm_ctl.core.kernel.wish import ALIGN_RATE, pull
from swarm_ctl.core.swarm.snapshot import Formation
from tests.unit.core.builders import UNIT_M, peer, plan, snapshot

coordinates = st.floats(-1e3, 1e3)
errors = st.lists(st.builds(complex, coordinates, coordinates), min_size=2, max_size=12)


def pulls(e: list[complex]) -> np.ndarray:
    """Of all agents, where all hear each other."""
    return np.array([pull(own, sum(e) - own, len(e) - 1) for own in e])


@given(errors)
def test_it_moves_all_agents_to_the_mean_and_the_mean_nowhere(e: list[complex]) -> None:
    """Each pull is the rate times the way to the mean of all; the swarm as a whole is left where it
    is."""
    np.testing.assert_allclose(pulls(e), ALIGN_RATE * (np.mean(e) - np.array(e)), atol=1e-9)
    assert abs(pulls(e).sum()) < 1e-8


@given(errors, st.builds(complex, coordinates, coordinates))
def test_only_differences_count(e: list[complex], moved: complex) -> None:
    """Translating the swarm changes nothing."""
    np.testing.assert_allclose(pulls([each + moved for each in e]), pulls(e), atol=1e-8)


def test_who_is_not_counted_does_not_matter() -> None:
    """Whatever is known of a lost agent, even that its place is not a number."""
    there, lost = 1 + 1j, complex(math.nan, math.nan)
    lost = peer(2, 9.0, stop_point_m=(math.nan, math.nan))
    there = peer(3, 0.0, stop_point_m=(UNIT_M, UNIT_M))
    assert there.formation is not None
    formation = Formation({2: (0.0, 0.0), 3: (0.0, 1.0)}, frozenset((2, 3)), 0j, there.formation)
    heard = LawInputBuilder(plan(), 1).build(snapshot(lost, there), formation, 0.1, 0j, math.inf)
    assert heard.errors == [0j, 1 + 0j]
    assert heard.along == 1
