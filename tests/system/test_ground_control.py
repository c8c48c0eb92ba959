"""Ground control software beside a swarm that flies: QGroundControl's steps for each vehicle, and
none that floods, hangs or dies takes anything from an agent."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.protocol.qgroundcontrol import QGroundControl
from tests.system.pair import SPEEDUP
from tests.system.running import HEXAGON, Running

SIX = {i: "px4" if i > 3 else "ardupilot" for i in range(1, 7)}
TWO = {1: "ardupilot", 2: "px4"}


def beside(folder: Path, kinds: dict[int, str]) -> Path:
    """Up, wait, down: a mission of these at their starts of `hexagon.yaml`."""
    data = yaml.safe_load(HEXAGON.read_text())
    data["tick_s"], data["law"]["kappa"] = 0.1, 10  # half the rate: for half the work
    data["agents"] = data["agents"][: len(kinds)]
    data["fleet"] = {"agents": [{"id": i, "autopilot": kind} for i, kind in kinds.items()]}
    data["shapes"] = {"start": {"kind": "offsets", "offsets": [a["start"] for a in data["agents"]]}}
    form, hold = {"shape": "start", "slots": "fixed"}, {"duration_s": 5}
    data["steps"] = [{"takeoff": {"height_m": 2}}, {"form": form}, {"hold": hold}, "land"]
    path = folder / "beside.yaml"
    path.write_text(json.dumps(data))  # JSON is YAML
    return path


@contextlib.contextmanager
def qgroundcontrol() -> Iterator[QGroundControl]:
    with contextlib.closing(QGroundControl()) as found:
        yield found


def test_qgroundcontrol_connects_to_vehicles_of_both_kinds_on_one_port(tmp_path: Path) -> None:
    """Each step of its start ends as it wants, in flight, without a resend of a command (six
    vehicles on one port: `tests/protocol/test_ground_control.py`)."""
    mission = beside(tmp_path, TWO)
    run = ("run", mission, "--speedup", f"{SPEEDUP:g}", "--headless", "--no-report")
    with qgroundcontrol() as qgc, Running(*run, "--gcs", str(qgc.port), cwd=tmp_path) as running:
        # without a position a vehicle declines HOME_POSITION: its agent takes off with one
        running.wait_for_event("step 1: takeoff", len(TWO))
        assert qgc.find(len(TWO)) == list(TWO)
        for system, kind in TWO.items():
            vehicle = qgc.connect(system)
            assert vehicle.is_ardupilot == (kind == "ardupilot")
            assert vehicle.version.flight_sw_version > 0
            assert vehicle.metadata != 0
            assert vehicle.information != 0
            # MAV_RESULT_UNSUPPORTED: MAVLink 2 by its capabilities; a PX4 accepts
            assert vehicle.protocol == (3 if kind == "ardupilot" else 0)
            own = "MAV_SYSID" if kind == "ardupilot" else "MAV_SYS_ID"
            assert own in vehicle.parameters
            # item 0 of an ArduPilot is its home; neither has a mission, a fence, rally points
            assert (vehicle.mission, vehicle.fence, vehicle.rally) == ([], [], [])
            assert abs(vehicle.home.latitude * 1e-7 + 35.363262) < 0.001
        assert qgc.retries == []
        assert running.wait() == 0, running.output
        running.assert_nothing_left()
        assert f"ground control software at 127.0.0.1:{qgc.port}, system 255" in running.output
        assert f"every vehicle is sent to 127.0.0.1:{qgc.port}" in running.output


FLOOD = textwrap.dedent("""
    import os, socket, sys, time
    from pymavlink.dialects.v20 import ardupilotmega as mavlink
    port, mav = int(sys.argv[1]), mavlink.MAVLink(None, 255, 190)
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    command = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0).pack(mav)
    until, due, k = time.monotonic() + 60, time.monotonic(), 0
    while time.monotonic() < until:
        due += 0.01
        for k in range(50):
            own.sendto(command if k % 2 else os.urandom(60), ("127.0.0.1", port))
        time.sleep(max(0.0, due - time.monotonic()))
""")


def gcs_port(output: str) -> int:
    """Where a GCS may write to, as `run` has printed it."""
    line = next(line for line in output.splitlines() if "connects by itself" in line)
    return int(line.rpartition(":")[2])


@pytest.mark.long
def test_a_gcs_that_floods_hangs_or_dies_takes_nothing_from_an_agent(tmp_path: Path) -> None:
    """One sends 5,000 frames a second, commands and noise, to one vehicle; one never reads; a
    third is killed. What is over the limit is dropped, and the mission completes."""
    with contextlib.ExitStack() as stack:
        silent = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        silent.bind(("127.0.0.1", 0))
        running = stack.enter_context(
            Running(
                *("run", beside(tmp_path, SIX), "--headless", "--no-report"),
                *("--gcs", str(silent.getsockname()[1])),
                cwd=tmp_path,
            )
        )
        running.wait_for_event("step 1: takeoff", 6)
        flood = [
            stack.enter_context(
                subprocess.Popen([sys.executable, "-c", FLOOD, str(gcs_port(running.output))])
            )
            for _ in range(2)
        ]
        running.wait_for_event("step 4: land")
        flood[0].kill()
        code = running.wait()
        flood[1].kill()
        assert code == 0, running.output
        log = (running.folder / "gcs.log").read_text()
        assert "sends more than 100 frames a second to vehicle 1: the oldest are dropped" in log
        running.assert_nothing_left()


@pytest.mark.long
def test_a_gcs_sees_the_vehicles_come_down_after_run_was_killed(tmp_path: Path) -> None:
    """The relay goes on until no vehicle is armed; then nothing is left."""
    run = ("run", beside(tmp_path, SIX), "--headless", "--no-report")
    with qgroundcontrol() as qgc, Running(*run, "--gcs", str(qgc.port), cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 6)
        assert qgc.find(6, 60.0) == list(range(1, 7))
        os.kill(running.process.pid, signal.SIGKILL)
        until = time.monotonic() + 60
        while any(m.base_mode & 128 for m in qgc.vehicles.values()):
            assert time.monotonic() < until
            for _ in qgc.listen(0.2):
                pass
        running.process.wait()
        running.assert_nothing_left(30.0)
