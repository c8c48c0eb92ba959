"""Percentiles from bins against numpy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.histogram import Histogram


@given(st.lists(st.floats(0, 4.9), min_size=1, max_size=200), st.floats(0.01, 1.0))
def test_percentile_at_most_one_bin_above(values: list[float], share: float) -> None:
    histogram = Histogram(0.01)
    for value in values:
        histogram.add(value)
    exact = float(np.quantile(values, share, method="inverted_cdf"))
    found = histogram.percentile(share)
    assert found is not None
    assert exact <= found + 1e-9 <= exact + 0.01 + 2e-9 + 1e-6


def test_nothing_counted_has_no_percentile() -> None:
    assert Histogram(0.01).percentile(0.5) is None


def test_outliers_are_kept() -> None:
    histogram = Histogram(0.01)
    histogram.add(-1.0)
    histogram.add(1e9)
    assert histogram.most == 1e9
    assert histogram.percentile(0.5) == 0.01
