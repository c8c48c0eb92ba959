"""Scenarios in which a drawn flight, or a field report, found a fault. Their first line is the
outcome."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from swarm_ctl.fuzz.invariants.table import broken
from swarm_ctl.virtual.scenario import load_scenario
from swarm_ctl.virtual.scenario_flight import FlownScenario, fly_scenario
from tests.on_demand import on_demand

FOUND = sorted(Path(__file__).with_name("found").glob("*.yaml"))


ROWS = [on_demand(each) if each.stem.startswith("follow-past") else each for each in FOUND]
"""That one has twelve agents; the rule alone is in `tests/unit/core/kernel/test_constraints.py`."""


@cache
def flown(name: str) -> FlownScenario:
    """A flight that two tests of a worker look at is flown once."""
    return fly_scenario(*load_scenario(FOUND[0].with_name(f"{name}.yaml")))


@pytest.mark.parametrize("path", ROWS, ids=lambda path: path.stem)
def test_it_is_mended(path: Path) -> None:
    """Every invariant holds, and the flight ends with the word that it should have."""
    outcome = path.read_text().splitlines()[0].removeprefix("# ")
    found = flown(path.stem)
    assert broken(found) == []
    assert found.summary.outcome == outcome, found.summary.reason


def test_a_hold_says_its_reason_once() -> None:
    """The reason of a hold is what the step lacked, and stays that."""
    statuses = flown("held-after-its-time-out").statuses
    held = {status.reason for status in statuses if status.action == "hold"}
    assert held == {"step 1 (takeoff) timed out after 3.7 s: this agent was not done"}


def test_one_that_is_resumed_in_a_move_is_believed() -> None:
    """It leads from then on, with the frame of the one that led until then."""
    said = [event.text for event in flown("resumed-in-a-move").events]
    assert [text for text in said if "not believed" in text] == []


def test_a_flight_is_judged_alike_with_a_folder_and_without(tmp_path: Path) -> None:
    """The judge knows the zones that an operator's order added, also where nothing is written."""
    scenario, mission = load_scenario(FOUND[0].with_name("a-zone-over-one-that-lands.yaml"))
    written, alone = (
        fly_scenario(scenario, mission, tmp_path / "run"),
        flown("a-zone-over-one-that-lands"),
    )
    near = alone.summary.nearest_zone
    assert written.summary.nearest_zone == near
    assert near is not None
    assert near.zone == "pond"
    assert written.digest == alone.digest
