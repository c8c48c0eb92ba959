"""The `swarm` fixture that users write tests with: the same interface on the virtual clock and with
real processes."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from contextlib import closing
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.api.flight import FlightResult, SwarmFlight
from swarm_ctl.api.process_flight import ProcessFlight, _lives
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.testing.account import account
from swarm_ctl.testing.plugin import Fly
from tests.scenarios import test_steps
from tests.unit.report.run_folders import PLAN, write_run

TRIO = test_steps.TRIO + "  - hold: {duration_s: 20}\n  - land\n"


def flown_by_a_user(flight: SwarmFlight) -> None:
    """Orders of all kinds, and a killed agent."""
    flight.wait_step("hold")
    assert flight.command("hold").accepted
    assert flight.form("row").accepted
    refused = flight.move(9000, 0)
    assert "outside the geofence" in refused.reasons[1]
    flight.wait_s(5)
    flight.kill_agent(3)
    if isinstance(flight, ProcessFlight) and flight._seat is not None:
        # what it said last is heard first, or the machine would decide how much of it is
        assert _lives(flight._pids["agent-3"])
        flight.turn()
        assert not _lives(flight._pids["agent-3"])


def assert_all_but_3_failed(run: FlightResult) -> None:
    assert run.outcomes == {1: "failed", 2: "failed"}
    assert run.closest_m > 2.5
    assert run.all_down
    assert "agent 3 has not been heard" in run.texts


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "how",
    [
        pytest.param({"virtual": True}, id="virtual"),
        pytest.param({"speedup": 4}, id="4", marks=(pytest.mark.realtime, pytest.mark.long)),
    ],
)
def test_a_test_as_a_user_writes_it(swarm: Fly, how: dict[str, Any]) -> None:
    """And with real processes in lockstep, below."""
    flight = swarm(TRIO, **how)
    flown_by_a_user(flight)
    assert_all_but_3_failed(flight.finish())


@pytest.mark.lockstep
@pytest.mark.timeout(300)
def test_a_flight_with_processes_is_the_same_again(tmp_path: Path) -> None:
    """Orders, a killed agent and a killed station, in lockstep: they come at the same ticks, so
    truth and events are the same, byte for byte. As the fixture flies it, but without reports."""
    folders = []
    for name in ("one", "other"):
        flight = ProcessFlight(loads(TRIO), tmp_path / name, None, 3, report=False)
        with closing(flight):
            flown_by_a_user(flight)
            flight.wait_s(6)  # in which agent 3 is missed
            flight.kill_station()
            run = flight.finish()
        assert_all_but_3_failed(run)
        assert run.folder is not None
        folders.append(run.folder)
    for name in ("truth.jsonl", "events.jsonl"):
        one, other = [(folder / name).read_bytes() for folder in folders]
        assert one == other, name


@pytest.mark.lockstep
@pytest.mark.timeout(300)
def test_a_frozen_agent_in_lockstep(swarm: Fly) -> None:
    """Mission time goes on without it at once, the others notice it by their own time-outs; thawed
    it takes part again. And `close`, in the middle of a flight, ends every process."""
    flight = swarm(TRIO)
    assert isinstance(flight, ProcessFlight)
    flight.wait_step("form square")
    flight.freeze_agent(2)
    flight.wait_s(3)
    assert any(event.agent != 2 and "2 is not heard" in event.text for event in flight.events())
    flight.thaw_agent(2)
    flight.wait_s(2)
    assert flight.statuses()[2].time_s > flight.statuses()[1].time_s - 1
    for pid in flight._pids.values():
        os.kill(pid, 0)
    flight.close()
    for pid in flight._pids.values():
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_step_that_is_not_there(swarm: Fly) -> None:
    """A misspelt step is named with the ones there are."""
    flight = swarm(TRIO, virtual=True)
    for step in ("form circle", 9, -1):
        with pytest.raises(ValueError, match=r"allowed: 0 to \d, or prepare, takeoff, form square"):
            flight.wait_step(step)
    with pytest.raises(ValueError, match=r"no agent 9; allowed: 1-3"):
        flight.kill_agent(9)


def as_a_user(folder: Path, tests: str) -> tuple[list[str], dict[str, str]]:
    """How pytest is called for these tests in a folder of their own, from another one, and with
    what environment; `patrol.yaml` lies beside them."""
    (folder / "tests").mkdir()
    (folder / "tests" / "patrol.yaml").write_text(TRIO)
    (folder / "tests" / "test_patrol.py").write_text(tests)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"]
    if "swarm_ctl.testing.plugin" not in _entry_points():
        command += ["-p", "swarm_ctl.testing.plugin"]
    return command, os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}


def outside(folder: Path, tests: str) -> str:
    """What pytest says to these failing tests."""
    command, path = as_a_user(folder, tests)
    done = subprocess.run(
        command, cwd=folder, env=path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


def _entry_points() -> set[str]:
    return {point.value for point in metadata.entry_points(group="pytest11")}


def test_a_failing_test_shows_steps_last_events_and_where_to_look(tmp_path: Path) -> None:
    """As a user meets it; a mistake in the mission is shown without the parser's frames."""
    said = outside(
        tmp_path,
        """
def test_all_complete(swarm):
    flight = swarm("patrol.yaml", virtual=True)
    flight.wait_step("form square")
    flight.kill_agent(2)
    assert flight.finish().outcomes == {}

def test_a_mistake(swarm):
    swarm("version: 1\\nname: a b\\n", virtual=True)
""",
    )
    first, second = re.split(r"_{5,} test_a_mistake _{5,}", said)
    assert "- flight 1: quartet -" in first
    assert re.search(r"2 form square +[\d.]+ +-  1, 3 aborted; 2 running", first)
    assert re.search(r"\d land +-  +-  1-3 not reached", first)
    assert "the last 10 of" in first
    assert "land: agent 2 has not been heard for 5 s" in first
    assert "s on the virtual clock, seed 1: no run folder" in first
    assert 'mission.yaml:2: name: "a b" is not allowed; did you mean a-b?' in second
    assert "yaml_file.py" not in second


@pytest.mark.realtime
@pytest.mark.long
@pytest.mark.timeout(120)
def test_ctrl_c_in_a_test_leaves_no_process(tmp_path: Path) -> None:
    """As a terminal sends it, to pytest and to `run` at once, in flight: pytest says that it was
    interrupted, and no process of the flight is left."""
    tests = """
def test_long(swarm):
    flight = swarm("patrol.yaml", speedup=4)
    flight.wait_step("takeoff")
    print("up", flush=True)
    flight.wait_s(9000)
"""
    command, path = as_a_user(tmp_path, tests)
    with subprocess.Popen(
        [*command, "-s"],
        cwd=tmp_path,
        env=path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as pytests:
        assert pytests.stdout is not None
        try:
            assert any("up" in line.split() for line in pytests.stdout)
            os.killpg(pytests.pid, signal.SIGINT)
            said = pytests.stdout.read()  # until no process has it open
            assert pytests.wait() == pytest.ExitCode.INTERRUPTED, said
        finally:
            left = of_session(pytests.pid)
            for pid in left:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
    assert "KeyboardInterrupt" in said
    assert not left


def of_session(session: int) -> list[int]:
    """The processes that were started there and live."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                found.append(int(stat.parent.name))
    return found


@pytest.mark.long
@pytest.mark.timeout(120)
def test_a_failing_test_leaves_a_run_folder_with_a_report(tmp_path: Path) -> None:
    """With processes, in flight: the flight is ended for it."""
    said = outside(
        tmp_path,
        """
def test_none_answers(swarm):
    flight = swarm("patrol.yaml", speedup=4)
    flight.wait_step("takeoff")
    flight.wait_s(2)
    assert flight.command("hold").reasons == {1: "no"}
""",
    )
    assert re.search(r"1 takeoff +[\d.]+ +-  1-3 running", said)
    (report,) = re.findall(r"^report: (.*)$", said, re.MULTILINE)
    assert Path(report).read_text().startswith("<!doctype html>")
    assert "verdict: none: the flight was ended with the test" in said


def test_of_a_run_folder_the_last_events_and_the_report_are_told(tmp_path: Path) -> None:
    """What a failing test shows of a flight with processes, from files alone."""
    flight = ProcessFlight.__new__(ProcessFlight)
    flight.plan, flight.folder, flight._client = PLAN, write_run(tmp_path), None
    assert re.search(r"2 form hexagon +20.0 +37.1  1-6 done", account(flight))
    assert flight.where.splitlines()[0] == "verdict: none yet"
    assert flight.where.endswith(f"none yet; swarm-ctl report {flight.folder}")
    (flight.folder / "report.html").touch()
    assert flight.where.endswith(str(flight.folder / "report.html"))
