"""Which run an order, or a station that joins, means."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from swarm_ctl.engine.flying_runs import flying_run, process_space
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.runfolder.manifest import write_manifest
from tests.unit.report.run_folders import PLAN, manifest

DEAD = -1


def a_run(runs: Path, name: str, mission: str, pid: int = DEAD, *, ended: bool = False) -> Path:
    folder = runs / name
    folder.mkdir(parents=True)
    write_manifest(folder, manifest(replace(PLAN, name=mission), epoch_s=0.0))
    (folder / "processes.json").write_text(json.dumps({"agent-1": pid, "station": os.getpid()}))
    if ended:
        (folder / "summary.json").touch()
        (folder / "recording.mcap").touch()
    return folder


@pytest.fixture
def dead() -> int:
    """The id of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_several_that_fly_are_listed(tmp_path: Path) -> None:
    one = a_run(tmp_path, "1-square", "square", os.getpid())
    two = a_run(tmp_path, "2-hexagon", "hexagon", os.getpid())
    with pytest.raises(InputError) as error:
        flying_run(None, tmp_path)
    listed = f"2 swarms are in the air: square ({one}), hexagon ({two}); name one by its mission"
    assert str(error.value).startswith(listed)
    assert flying_run("hexagon", tmp_path) == two
    assert flying_run(one, tmp_path) == one


def test_two_of_one_mission_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    folders = [a_run(tmp_path, f"{k}-square", "square", os.getpid()) for k in (1, 2)]
    with pytest.raises(InputError, match=r"2 swarms are in the air: .*; name one by its folder$"):
        flying_run("square", tmp_path)
    assert flying_run(folders[0], tmp_path) == folders[0]


def test_a_name_that_means_none_is_refused(tmp_path: Path, dead: int) -> None:
    a_run(tmp_path, "1-square", "square", dead)
    words = "hexagon is no run folder, and no mission that flies"
    with pytest.raises(StartError, match=f"{words}; no run of "):
        flying_run("hexagon", tmp_path)
    a_run(tmp_path, "2-square", "square", os.getpid())
    with pytest.raises(InputError, match=f"{words}; in the air: square"):
        flying_run("hexagon", tmp_path)


def test_where_nothing_flies_it_is_said_before_anything_is_asked(tmp_path: Path, dead: int) -> None:
    with pytest.raises(StartError, match=r"^nothing flies: no run in .* is in the air\. Start"):
        flying_run(None, tmp_path)
    a_run(tmp_path, "1-square", "square", dead)
    newest = a_run(tmp_path, "2-square", "square", ended=True)
    with pytest.raises(StartError, match=r"the newest run there, 2-square, has ended"):
        flying_run(None, tmp_path)
    with pytest.raises(StartError, match=r"2-square has ended; watch it again with swarm-ctl rep"):
        flying_run(newest, tmp_path)


def test_a_run_that_was_killed_is_said_to_have_ended(tmp_path: Path, dead: int) -> None:
    """By its folder, too: else a station joins it and waits for ever. Its station may outlive it
    for a moment, and the swarm still lands then."""
    folder = a_run(tmp_path, "1-square", "square", dead)
    assert flying_run(folder, tmp_path) == folder, "its station lives"
    (folder / "processes.json").write_text(json.dumps({"agent-1": dead, "station": dead}))
    with pytest.raises(StartError, match=r"1-square was killed: none .* no summary$"):
        flying_run(folder, tmp_path)


def test_of_a_run_in_another_container_no_process_tells(tmp_path: Path, dead: int) -> None:
    folder = a_run(tmp_path, "1-square", "square", dead)
    (folder / "processes.json").write_text(json.dumps({"agent-1": dead}))
    here, there = process_space(), {"process_space": "pid:[1]"}
    told = manifest(replace(PLAN, name="square"), epoch_s=0.0)
    write_manifest(folder, told.model_copy(update=there))
    assert flying_run(folder, tmp_path) == folder
    write_manifest(folder, told.model_copy(update={"process_space": here}))
    with pytest.raises(StartError, match="was killed"):
        flying_run(folder, tmp_path)


def test_a_process_that_nothing_has_asked_for_its_exit_code_is_dead(tmp_path: Path) -> None:
    """In a container the first process may ask for none."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    try:
        a_run(tmp_path, "1-square", "square", process.pid)
        with pytest.raises(StartError, match=r"^nothing flies"):
            flying_run(None, tmp_path)
    finally:
        process.wait()


def test_a_run_that_starts_has_not_ended_unless_it_was_killed(tmp_path: Path, dead: int) -> None:
    """Its processes are not known yet, but itself is."""
    folder = tmp_path / "1-square"
    folder.mkdir()
    for process in (None, os.getpid()):
        write_manifest(folder, manifest(epoch_s=0.0, process=process))
        assert flying_run(folder, tmp_path) == folder
    write_manifest(folder, manifest(epoch_s=0.0, process=dead))
    with pytest.raises(StartError, match="1-square was killed"):
        flying_run(folder, tmp_path)


def test_a_run_whose_agents_other_hosts_started_is_meant_where_no_other_flies(
    tmp_path: Path,
) -> None:
    """No process of this computer tells whether it flies."""
    folder = tmp_path / "1-square"
    folder.mkdir()
    told = manifest(replace(PLAN, name="square"), epoch_s=0.0).model_copy(
        update={"elsewhere": True}
    )
    write_manifest(folder, told)
    assert flying_run(None, tmp_path) == folder
