"""A recording of a ready mission holds no alarm: one that a correct mission raises is a defect.

In lockstep, so that no process is late on a busy machine. `test_whole.py` has the hexagon,
`tests/scenarios/test_missions.py` the same without processes.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenarios.test_missions import HURT, MISSIONS, TRUE_ALARMS
from tests.system.running import ROOT, Running, raised


@pytest.mark.long
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("name", [name for name in MISSIONS if name != "hexagon.yaml"])
def test_a_ready_mission_raises_no_alarm(tmp_path: Path, name: str) -> None:
    """But the true ones of a timetable of faults."""
    mission = name.removesuffix(".yaml")
    run = ("run", ROOT / "missions" / name, "--speedup", "max", "--headless", "--no-report")
    with Running(*run, cwd=tmp_path) as running:
        assert running.wait(1400) == int(mission in HURT), running.output
        assert raised(running.folder) == TRUE_ALARMS.get(mission, [])
