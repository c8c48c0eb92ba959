"""`measure --vehicles` on the autopilots themselves: started, measured, ended."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import VehicleKind
from tests.autopilots.sitl import needed
from tests.system.running import SWARM_CTL

SPEEDUP = {VehicleKind.ARDUCOPTER: 3, VehicleKind.PX4: 2}


@pytest.mark.long
@pytest.mark.timeout(400)
@pytest.mark.parametrize("kind", SPEEDUP)
def test_an_autopilot_answers_about_as_its_typical_response_says(
    kind: VehicleKind, tmp_path: Path
) -> None:
    """Dead time and lag together within 0.4 s; nothing is left of what it started."""
    needed(kind)
    options = ("--speed", "3", "--speedup", str(SPEEDUP[kind]))
    command: list[str | Path] = [SWARM_CTL, "measure", "--vehicles", kind, *options]
    there = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run(command, env=there, capture_output=True, text=True, check=False)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    found = re.search(r"dead_time_s: ([\d.]+), lag_s: ([\d.]+)", done.stdout)
    assert found is not None
    typical = AUTOPILOT_KINDS[kind.autopilot or ""].response
    late_s = float(found[1]) + float(found[2])
    assert late_s == pytest.approx(typical.dead_time_s + typical.lag_s, abs=0.4)
    assert not list(tmp_path.iterdir())
    assert not [each for each in _work_folders() if each.startswith(str(tmp_path))]


def _work_folders() -> Iterator[str]:
    """Of all processes."""
    for link in Path("/proc").glob("[0-9]*/cwd"):
        with contextlib.suppress(OSError):  # it has just ended, or is another user's
            yield str(link.readlink())
