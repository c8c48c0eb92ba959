"""Scenarios in which a drawn flight, or a field report, found a fault. Their first line is the
outcome."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.fuzz.invariants import broken
from swarm_ctl.virtual.scenario import load_scenario
from swarm_ctl.virtual.scenario_flight import fly_scenario

FOUND = sorted(Path(__file__).with_name("found").glob("*.yaml"))


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.stem)
def test_it_is_mended(path: Path) -> None:
    """Every invariant holds, and the flight ends with the word that it should have."""
    outcome = path.read_text().splitlines()[0].removeprefix("# ")
    flown = fly_scenario(*load_scenario(path))
    assert broken(flown) == []
    assert flown.summary.outcome == outcome, flown.summary.reason
