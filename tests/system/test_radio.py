"""One radio of 57,600 baud at a pseudo-terminal, three agents, three vehicles, all processes
real."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from tests.system.running import Running
from tests.system.sik import radio

TRIANGLE = Path(__file__).parents[1] / "scenarios" / "triangle.yaml"
BARE = TRIANGLE.read_text().partition("\nfleet:")[0]


def radio_mission(folder: Path, device: str) -> Path:
    fleet = "".join(f"    - {{id: {i}, endpoint: 'serial:{device}'}}\n" for i in (1, 2, 3))
    path = folder / "triangle.yaml"
    path.write_text(f"{BARE}\nfleet:\n  agents:\n{fleet}")
    return path


def airborne(truth: Path) -> list[bool]:
    """Which vehicles truly are in the air, by the last whole line."""
    lines = [line for line in truth.read_text().splitlines()[:-1] if '"state"' in line]
    found: list[bool] = json.loads(lines[-1])["airborne"]
    return found


@pytest.mark.long
def test_vehicles_land_by_their_own_failsafe_when_the_link_is_killed(tmp_path: Path) -> None:
    """Each vehicle comes down where it is, and the run says why."""
    bare, truth = tmp_path / "bare.yaml", tmp_path / "truth.jsonl"
    bare.write_text(BARE)
    with radio(bare, 3, truth=str(truth)) as device:
        mission = radio_mission(tmp_path, device)
        with Running("run", mission, "--headless", cwd=tmp_path) as run:
            run.wait_for(lambda: truth.exists() and "step 2" in run.output, 60)
            assert all(airborne(truth))
            run.kill("link-1")
            assert run.wait(120) == 1
            output = " ".join(run.output.split())
            run.assert_nothing_left()
        until = time.monotonic() + 30
        while any(airborne(truth)) and time.monotonic() < until:
            time.sleep(0.5)
        assert not any(airborne(truth))
    ended = f"link-1 to serial:{device} has ended: its vehicles land by their own failsafes"
    assert f"{ended}; exit code -9, see link-1.log" in output
    assert "link-1 was ended by SIGKILL" in output
