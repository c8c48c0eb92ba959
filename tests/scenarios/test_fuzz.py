"""Drawn flights break no invariant."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.fuzz.campaign import Campaign

FLIGHTS = 200


@pytest.mark.fuzz
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", [1])
def test_drawn_flights_break_nothing(seed: int, tmp_path: Path) -> None:
    campaign = Campaign(seed, tmp_path / "fuzz")
    campaign.load()
    for _ in campaign.fly(FLIGHTS):
        pass
    assert not campaign.found()
