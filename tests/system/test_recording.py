"""A station that is killed in flight: the agents land, and its recording is there
(`tests/foreign/test_whole.py` has what one holds)."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from swarm_ctl import recording
from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.recording.mcap_reader import is_whole
from tests.system.running import HELD, Running
from tests.system.test_run import assert_apart, assert_truth_ends_on_the_ground

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

RUN = ("run", HELD, "--speedup", "max", "--headless")


def times_s(folder: Path) -> list[float]:
    """Of the states in the recording."""
    return [p.time_s for _, p in recording.read(folder) if isinstance(p, AgentState)]


def test_a_killed_station_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    """SIGKILL in flight: by the mission's policy (land) the agents come down, and `run` writes the
    summary. The file reads up to the last chunk; `replay` gives it its footer, and says so
    (`report` does as well: `test_html_page.py`)."""
    with Running(*RUN, "--no-report", cwd=tmp_path) as running:
        running.wait_for_event("step 2: form hexagon", 3)
        running.wait_for(lambda: bool(times_s(running.folder)))  # the first second's chunk
        before_s = max(times_s(running.folder))
        running.kill("station")
        assert running.wait() == 1, running.output
        running.assert_nothing_left()
        folder = running.folder
        assert running.summary()["outcome"] == "failed"
        assert "station" in running.summary()["reason"]
        assert "the mission's policy without one: land after 5 s" in running.output
        assert_truth_ends_on_the_ground(folder)
        assert_apart(folder)
    assert not is_whole(folder)
    last_s = max(times_s(folder))
    assert last_s >= before_s
    alone = tmp_path / "alone.mcap"
    shutil.copy(folder / recording.RECORDING, alone)
    with Running("replay", alone, "--json", "--from", "end", cwd=tmp_path) as replaying:
        assert replaying.wait() == 0, replaying.output
        note, copied, line = replaying.output.splitlines()
    assert "was cut off; read up to its last second" in note
    assert "a whole copy" in copied
    assert last_s - 1e-6 <= json.loads(line)["time_s"] <= last_s + 1.0
    assert alone.read_bytes() == (folder / recording.RECORDING).read_bytes()
    assert is_whole(tmp_path / "alone.recovered.mcap")
