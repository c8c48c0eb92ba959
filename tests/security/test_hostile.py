"""Hostile frames, samples and files against all that reads what others send
(`tests/bench/bench_hostile.py`): honest words between them arrive; it does not grow."""

from __future__ import annotations

import pytest

from tests.bench.bench_hostile import KIB, assault

MOST_KIB = 16 * KIB


@pytest.mark.parametrize(
    "count", [5_000, pytest.param(10_000_000, marks=[pytest.mark.long, pytest.mark.timeout(7200)])]
)
def test_hostile_samples_lose_nothing_and_leave_nothing(count: int) -> None:
    for name, (samples, _, growth_kib) in assault(count, seed=1).items():
        assert samples
        assert growth_kib < MOST_KIB, name
