"""Missions on the autopilots themselves end as on the simulator: completed, nothing left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.autopilots.sitl import MISSIONS, Flight
from tests.system.running import raised

LATE = {"slow machine", "silent", "vehicle silent", "old state", "old link", "no station"}
LATE |= {"slow ticks", "late ticks"}
"""Alarms that are true on a busy machine; an autopilot can't wait for it."""
SHORT_OF_R = {"hexagon.yaml": [("long link", pair) for pair in ((1, 2), (1, 3), (3, 5))]}
"""These start 0.14 m under r in the paper's Table II; a vehicle that takes off moves by more."""
PAIR = Path(__file__).with_name("pair.yaml")
SHORT = {
    "height_m: 6": "height_m: 2",
    "settle_s: 2": "settle_s: 1",
    "duration_s: 5": "duration_s: 1",
}
"""What is held is the way through all steps."""


def late(*row: Any) -> Any:
    """A row on demand."""
    return pytest.param(*row, marks=pytest.mark.long)


@pytest.mark.parametrize(
    ("mission", "vehicles", "speedup"),
    [
        ("pair.yaml", "arducopter", 2),
        ("pair.yaml", "px4", 1),  # at 2 it lost its GPS once beside other tests; why is not known
        late("hexagon.yaml", "arducopter", 2),
        late("hexagon.yaml", "arducopter", 1),
        late("hexagon.yaml", "px4", 1),
        late("hexagon.yaml", "1-3=arducopter,4-6=px4", 1),
        late("crossing.yaml", "arducopter", 2),
        late("crossing.yaml", "px4", 1),
        late("crossing.yaml", "arducopter,px4", 1),
        late("square.yaml", "arducopter", 2),
        late("sweep.yaml", "arducopter", 2),
        late("letters.yaml", "arducopter", 1),
        late("letters.yaml", "px4", 0.5),  # twelve take more than two cores
    ],
)
def test_a_mission_completes(mission: str, vehicles: str, speedup: float, tmp_path: Path) -> None:
    path = MISSIONS / mission
    if mission == PAIR.name:
        path, text = tmp_path / mission, PAIR.read_text()
        for long, short in SHORT.items():
            assert long in text
            text = text.replace(long, short)
        path.write_text(text)
    with Flight(path, vehicles, cwd=tmp_path, speedup=speedup) as flight:
        flight.assert_completed()
        assert {step["result"] for step in flight.summary()["steps"]} == {"done"}
        others = [alarm for alarm in raised(flight.folder) if alarm[0] not in LATE]
        assert [alarm for alarm in others if alarm not in SHORT_OF_R.get(mission, [])] == []


@pytest.mark.long
def test_two_runs_at_once_on_one_machine(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
    with (
        Flight(PAIR, "arducopter,px4", cwd=folders[0]) as one,
        Flight(PAIR, "arducopter,px4", cwd=folders[1]) as two,
    ):
        one.assert_completed()
        two.assert_completed()
        pids = [each.pid for run in (one, two) for each in run.started.values()]
        assert len({*pids}) == 4
