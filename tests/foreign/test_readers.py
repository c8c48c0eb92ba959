"""What a flight leaves behind, read by others' programs: `mcap`, MAVExplorer's loader, a JUnit
reader, a browser; and the mission files, by jsonschema."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from pymavlink import mavutil

from swarm_ctl.recording import RECORDING
from tests.foreign.conftest import Flight
from tests.system.running import ROOT

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(200)]
READY = sorted((ROOT / "missions").glob("*.yaml"))
SCHEMA = json.loads((ROOT / "missions" / "mission.schema.json").read_text())
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


@pytest.fixture
def run(flight: Flight) -> Path:
    """The run folder of the flight."""
    return flight.folder


def test_mcap_reads_the_recording(run: Path) -> None:
    with (run / RECORDING).open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        heard = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert sum(heard.values()) == summary.statistics.message_count
    assert all(heard[f"/agent/{i}/state"] > 100 for i in range(1, 7)), heard


def test_mavexplorer_loads_a_log(run: Path) -> None:
    """By pymavlink's reader, with MAVExplorer's arguments: a track with positions, and times that
    go on."""
    log = mavutil.mavlink_connection(str(run / "1.tlog"), notimestamps=False, zero_time_base=True)
    messages = iter(lambda: log.recv_match(blocking=False), None)
    seen = [(m._timestamp, m.get_type()) for m in messages]
    log.close()
    times = [time for time, _ in seen]
    assert times == sorted(times)
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "SET_POSITION_TARGET_LOCAL_NED"} <= {
        name for _, name in seen
    }


def test_a_junit_reader_reads_the_result(run: Path) -> None:
    junit = pytest.importorskip("junitparser", reason="pip install junitparser")
    cases = [case for suite in junit.JUnitXml.fromfile(str(run / "junit.xml")) for case in suite]
    assert cases
    assert all(case.is_passed for case in cases)
    assert "takeoff" in " ".join(case.name for case in cases)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium in the PATH")
def test_chromium_shows_the_report(run: Path, tmp_path: Path) -> None:
    """Its scripts end without an error, and the page is there."""
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            CHROMIUM,
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--enable-logging=stderr",
            f"--user-data-dir={tmp_path}",
            "--virtual-time-budget=3000",
            "--dump-dom",
            (run / "report.html").as_uri(),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=90,
    )
    assert re.search(r"<title>[^<]*hexagon", done.stdout), done.stderr[-2000:]
    assert "<figure" in done.stdout
    assert "completed" in done.stdout
    assert "Uncaught" not in done.stderr


@cache
def checker() -> Any:
    jsonschema = pytest.importorskip("jsonschema", reason="pip install jsonschema")
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    return jsonschema.Draft202012Validator(SCHEMA)


@pytest.mark.parametrize("mission", READY, ids=lambda path: path.stem)
def test_jsonschema_takes_each_mission(mission: Path) -> None:
    data = yaml.safe_load(mission.read_text())
    assert [error.message for error in checker().iter_errors(data)] == []
    data["steps"][0] = {"jump": {}}
    assert list(checker().iter_errors(data))
