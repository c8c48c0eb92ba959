"""The pull to the average error of all agents that are heard."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law.mean_error_feedback import RATE, pull

coordinates = st.floats(-1e3, 1e3)
errors = st.lists(st.builds(complex, coordinates, coordinates), min_size=2, max_size=12)


def pulls(e: list[complex]) -> np.ndarray:
    """Of all agents, where all hear each other."""
    found = [pull(np.array(own), np.array(e), np.arange(len(e)) != k) for k, own in enumerate(e)]
    return np.array(found)


@given(errors)
def test_it_moves_all_agents_to_the_mean_and_the_mean_nowhere(e: list[complex]) -> None:
    """Each pull is `RATE` times the way to the mean of all; the swarm as a whole is left where it
    is."""
    np.testing.assert_allclose(pulls(e), RATE * (np.mean(e) - np.array(e)), atol=1e-9)
    assert abs(pulls(e).sum()) < 1e-8


@given(errors, st.builds(complex, coordinates, coordinates))
def test_only_differences_count(e: list[complex], moved: complex) -> None:
    """Translating the swarm changes nothing."""
    np.testing.assert_allclose(pulls([each + moved for each in e]), pulls(e), atol=1e-8)


@given(errors)
def test_who_is_not_counted_does_not_matter(e: list[complex]) -> None:
    """Whatever is known of a lost agent, even that its place is not a number."""
    counted = np.arange(len(e)) > 1
    bad = np.array([np.nan, *e[1:]])
    assert pull(np.array(e[0]), bad, counted) == pull(np.array(e[0]), np.array(e), counted)


def test_along_an_axis() -> None:
    """Receivers, senders, missions: as the studies have them."""
    own = np.array([[1 + 1j], [3 - 1j]])
    others, counted = (
        np.array([[[0j], [3 - 1j]], [[1 + 1j], [0j]]]),
        np.array([[[False], [True]], [[True], [False]]]),
    )
    np.testing.assert_allclose(
        pull(own, others, counted, axis=1), RATE * np.array([[1 - 1j], [-1 + 1j]])
    )
