"""The law of one agent, number by number, is that of the arrays that own laws get, to the last
bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.law import Law, Pair, terms
from swarm_ctl.core.law.formation_law import evaluate
from swarm_ctl.core.model.plan import LawParameters

LAW = LawParameters(r=4.5, r_out=1.5, r_in=0.5, h=0.05)
coordinates = st.one_of(st.floats(-1e3, 1e3), st.floats(-1.5, 1.5), st.sampled_from([0.0, 1e-10]))
points = st.builds(complex, coordinates, coordinates)
Aircraft = tuple[complex, complex, bool, bool, bool]


def array(values: list[complex]) -> np.ndarray:
    return np.array([[[each.real, each.imag] for each in values]])


@given(
    points,
    points,
    st.lists(
        st.tuples(points, points, st.booleans(), st.booleans(), st.booleans()),
        min_size=1,
        max_size=20,
    ),
)
def test_number_by_number_it_is_the_law_of_arrays(
    own: complex, slot: complex, others: list[Aircraft]
) -> None:
    """Terms, and all that is told of each pair; crowded, and on one spot."""
    at, to, linked, present, lower = (list(each) for each in zip(*others, strict=True))
    linked = [a and b for a, b in zip(linked, present, strict=True)]
    flags = (np.array([each]) for each in (linked, present, lower))
    want = evaluate(array([own])[0], array([slot])[0], array(at), array(to), *flags, LAW)
    pairs = list[Pair]()
    law = Law(LAW.r, LAW.r_out, LAW.r_in, LAW.h, LAW.delta_l, LAW.delta_a)
    consensus, avoidance, found = terms(own, slot, at, to, linked, present, lower, law, pairs)
    assert [consensus.real, consensus.imag] == want.consensus[0].tolist()
    assert [avoidance.real, avoidance.imag] == want.avoidance[0].tolist()
    if want.pairs is None:
        assert found == 0
        return
    assert [pair.place for pair in pairs[:found]] == want.pairs.index[-1].tolist()
    for name in ("distance", "neighbour", "sigma", "sigma_lb", "d_lb", "d_ub", "alpha", "status"):
        assert [getattr(pair, name) for pair in pairs[:found]] == getattr(want.pairs, name).tolist()
    np.testing.assert_array_equal([pair.d for pair in pairs[:found]], want.pairs.d)
