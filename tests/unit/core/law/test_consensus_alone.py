"""The consensus term alone is that of the whole law, to the last bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law.formation_law import consensus, evaluate
from swarm_ctl.core.model.plan import LawParameters

LAW = LawParameters(r=4.5, r_out=1.5, r_in=0.5, h=0.05)
coordinates = st.floats(-1e3, 1e3)
points = st.builds(complex, coordinates, coordinates)


def array(values: list[complex]) -> np.ndarray:
    return np.array([[[each.real, each.imag] for each in values]])


@given(points, points, st.lists(st.tuples(points, points, st.booleans()), min_size=1, max_size=20))
def test_it_is_the_first_term_of_the_law(
    own: complex, slot: complex, others: list[tuple[complex, complex, bool]]
) -> None:
    linked = np.array([[each[2] for each in others]])
    law = evaluate(
        array([own])[0],
        array([slot])[0],
        array([each[0] for each in others]),
        array([each[1] for each in others]),
        linked,
        np.ones_like(linked),
        linked,
        LAW,
    )
    errors = [at - place for at, place, is_linked in others if is_linked]
    found = consensus(own - slot, errors, LAW)
    assert (found.real, found.imag) == tuple(law.consensus[0].tolist())
