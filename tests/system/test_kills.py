"""Every kind of process killed, stopped for a while and started again, in every phase of a flight.

Whatever it is, it ends: with no two vehicles under r_in in the truth, an outcome that is told, and
nothing left behind. The whole table: `pytest -n0 -m long -rP tests/system/test_kills.py`.
"""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from swarm_ctl.runfolder.truth import load_truth
from tests.system.running import ROOT, SWARM_CTL, Running

pytestmark = pytest.mark.timeout(180)

MISSION = Path(__file__).with_name("kills.yaml")
SPEEDUP = 2.0
"""A PX4 leaves OFFBOARD for good after a second without setpoints: a busy machine must not take
that long."""
PROCESSES = ("agent-1", "agent-2", "station", "simulator", "run")
"""Agent 1 flies an ArduCopter, agent 2 a PX4."""
DEEDS = ("kill", "blink", "sleep", "restart")
"""SIGKILL; SIGSTOP for 2 s, and for 12 (mission time); SIGKILL and the same again by hand, as an
operator would."""
PHASES = {"ready": 0, "takeoff": 1, "form": 2, "hold": 3, "landing": 4}
"""And the step that it is."""
ENDS = ("kill", "restart")
CODES = {"completed": 0, "failed": 1}
CODES_BY_HAND = {"agent": {0, 1}, "station": {0, 130}, "simulator": {0}, "run": {0}}
"""Of the process started again: an agent's vehicle may be in its own landing, which ends the
mission; a station ends by itself, with 0, where its run is over before Ctrl-C comes."""
IN_CI = {("simulator", "blink", "form")}
"""What `test_run.py` does not fly already, and is quick."""
BLINK_S, SLEEP_S, PATIENCE_S = 2.0, 12.0, 60.0


def row(*what: str) -> Any:
    return pytest.param(*what, marks=[] if what in IN_CI else [pytest.mark.long])


ROWS = [row(process, deed, phase) for process in PROCESSES for deed in DEEDS for phase in PHASES]


@pytest.mark.parametrize(("process", "deed", "phase"), ROWS)
def test_whatever_is_killed(tmp_path: Path, process: str, deed: str, phase: str) -> None:
    """It is survived, or the flight ends in order; see the module."""
    mission, text = tmp_path / "kills.yaml", MISSION.read_text()
    if (process, deed, phase) in IN_CI:  # no other phase has to last
        text = text.replace("height_m: 4", "height_m: 2").replace("fixed}", "fixed, settle_s: 2}")
        text = text.replace("duration_s: 5", "duration_s: 1")
    mission.write_text(text if deed != "restart" else patient(text))
    with Running(
        "run", mission, "--speedup", str(SPEEDUP), "--headless", "--no-report", cwd=tmp_path
    ) as running:
        reach(running, PHASES[phase])
        pid = running.process.pid if process == "run" else running.pids[process]
        if deed in ("blink", "sleep"):
            os.kill(pid, signal.SIGSTOP)
            time.sleep((BLINK_S if deed == "blink" else SLEEP_S) / SPEEDUP)
            os.kill(pid, signal.SIGCONT)
            code = running.wait()
        else:
            os.kill(pid, signal.SIGKILL)
            with again(process, running.folder, tmp_path) if deed == "restart" else nothing():
                code = running.wait()
                running.assert_nothing_left(60)
        running.assert_nothing_left(60)
        summary = running.summary()
        told = (
            f"{summary['outcome']}: {summary['reason']}"
            if summary["reason"]
            else summary["outcome"]
        )
        closest_m = min(
            load_truth(running.folder / "truth.jsonl").minima.values(), default=math.inf
        )
        print(f"| {process} | {deed} | {phase} | {code} | {closest_m:.1f} | {told} |")
        assert closest_m > summary["r_in_m"]
        assert summary["outcome"] in expected(process, deed)
        assert code == (
            -signal.SIGKILL if process == "run" and deed in ENDS else CODES[summary["outcome"]]
        )
        assert (
            process == "run"
            or deed not in ENDS
            or summary["outcome"] == "completed"
            or f"{process} was ended by SIGKILL" in summary["reason"]
        )
        assert_ports_free(running.folder)


def expected(process: str, deed: str) -> set[str]:
    """How the run may be called."""
    if deed in ENDS:
        # an agent that is started again by hand may complete
        again = {"completed"} if (process[:5], deed) == ("agent", "restart") else set()
        return again | {"aborted" if process == "run" else "failed"}
    # A PX4 leaves OFFBOARD when its agent blinks; after a sleep, of an agent, the station or the
    # simulator, the phase decides what is given up. `run` may be absent for as long as it likes.
    missed = process != "run" and (deed == "sleep" or (process, deed) == ("agent-2", "blink"))
    return {"completed", "failed"} if missed else {"completed"}


def patient(text: str) -> str:
    """The mission with time to start a process again."""
    document = yaml.safe_load(text)
    document["policies"] = {"agent_lost_after_s": PATIENCE_S, "station_lost_after_s": PATIENCE_S}
    return str(yaml.safe_dump(document))


def reach(running: Running, step: int) -> None:
    """Until all agents are in the step; 0: all processes are ready."""
    running.wait_for(lambda: bool(list(running.cwd.glob("runs/*/processes.json"))))
    if step:
        running.wait_for_event(f"step {step}:", 4)
        time.sleep(1.0 / SPEEDUP)


def manifest(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return found


@contextmanager
def nothing() -> Iterator[None]:
    yield


@contextmanager
def again(process: str, folder: Path, where: Path) -> Iterator[None]:
    """The same process once more, by hand; it ends by itself, in order."""
    told = manifest(folder)
    own = str(told["epoch_s"]), str(told["speedup"])
    if process == "run":
        command = [
            SWARM_CTL,
            "run",
            where / "kills.yaml",
            "--speedup",
            own[1],
            "--headless",
            "--no-report",
        ]
        command += ["--runs", where / "again"]
    elif process == "station":
        command = [SWARM_CTL, "station", folder, "--json"]
    elif process == "simulator":
        config = json.loads((folder / "sim.json").read_text()) | {
            "truth_path": str(where / "truth-again.jsonl")
        }
        (where / "sim-again.json").write_text(json.dumps(config))
        command = [sys.executable, "-m", "swarm_sim", "--config", where / "sim-again.json"]
    else:
        fleet = where / "fleet.yaml"
        keys = ("id", "sysid", "autopilot", "endpoint", "mesh")
        entries = [{key: agent[key] for key in keys} for agent in told["fleet"]]
        fleet.write_text(yaml.safe_dump({"version": 1, "agents": entries}))
        command = [SWARM_CTL, "agent", where / "kills.yaml", "--fleet", fleet, "--id", process[-1]]
        command += ["--epoch", own[0], "--speedup", own[1]]
    with (where / "again.out").open("wb") as out:
        started = subprocess.Popen(
            [*map(str, command)],
            stdin=subprocess.PIPE,
            stdout=out,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
        )
    try:
        yield
        if process == "station":
            started.send_signal(signal.SIGINT)
        assert started.stdin is not None
        started.stdin.close()
        assert started.wait(60) in CODES_BY_HAND[process.partition("-")[0]], (
            where / "again.out"
        ).read_text()
    finally:
        started.kill()
        started.wait()


def assert_ports_free(folder: Path) -> None:
    """Vehicles and mesh: the ports are free again."""
    told = manifest(folder)
    udp = [agent["endpoint"] for agent in told["fleet"]]
    tcp = [agent["mesh"] for agent in told["fleet"]] + [told["station_mesh"]]
    for kind, endpoints in ((socket.SOCK_DGRAM, udp), (socket.SOCK_STREAM, tcp)):
        for endpoint in endpoints:
            with socket.socket(socket.AF_INET, kind) as one:
                if kind == socket.SOCK_STREAM:
                    one.setsockopt(
                        socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
                    )  # connections that only wait are no user
                one.bind(("127.0.0.1", int(endpoint.rpartition(":")[2])))
