"""dronekit and MAVProxy: large, old, and in use. `pip install -e '.[dev,clients]' && pytest -m
clients -rs`."""

from __future__ import annotations

import collections
import collections.abc
import contextlib
import importlib.util
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.protocol.simulator import (
    ORIGIN,
    Simulator,
    free_port,
    pilot,
    settings,
    simulator,
    wait_until,
)
from tests.system.running import ROOT, Running

pytestmark = [pytest.mark.clients, pytest.mark.foreign, pytest.mark.timeout(180)]
PERSONAS = pytest.mark.parametrize("persona", ["ardupilot", "px4"])
SPEEDUP = 3.0
MAVPROXY = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
NEEDS_MAVPROXY = pytest.mark.skipif(
    MAVPROXY is None, reason="pip install 'swarm-ctl[clients]' (MAVProxy: 637 MB)"
)
NEEDS_DRONEKIT = pytest.mark.skipif(
    importlib.util.find_spec("dronekit") is None,
    reason="pip install 'swarm-ctl[clients]' (dronekit)",
)


@contextlib.contextmanager
def dronekit_vehicle(sim: Simulator) -> Iterator[Any]:
    """Connected, everything it waits for has come."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        collections.MutableMapping = collections.abc.MutableMapping  # type: ignore[attr-defined]
        dronekit = pytest.importorskip("dronekit")
        vehicle = dronekit.connect(
            sim.endpoint(), wait_ready=True, source_system=255, heartbeat_timeout=30, timeout=30
        )
        try:
            yield vehicle
        finally:
            vehicle.close()


@NEEDS_DRONEKIT
@pytest.mark.filterwarnings("ignore")
def test_dronekit_flies_velocities_and_a_mission(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "ardupilot") | {"speedup": SPEEDUP}
    with simulator(tmp_path, configuration) as sim, dronekit_vehicle(sim) as v:
        import dronekit

        def send(north: float) -> None:
            zeros = (0.0,) * 5
            factory = v.message_factory.set_position_target_local_ned_encode
            v.send_mavlink(factory(0, 0, 0, 1, 3527, 0, 0, 0, north, 0.0, 0.0, *zeros))

        v.parameters["GUID_TIMEOUT"] = 2.0
        assert v.parameters["FRAME_CLASS"] == 1
        wait_until(sim, "armable", lambda: v.is_armable)
        v.mode = dronekit.VehicleMode("GUIDED")
        wait_until(sim, "mode", lambda: v.mode.name == "GUIDED")
        v.armed = True
        wait_until(sim, "armed", lambda: v.armed)
        v.simple_takeoff(4.0)
        wait_until(sim, "height", lambda: v.location.global_relative_frame.alt > 3.6)

        def moving() -> bool:
            send(1.5)
            return bool(v.velocity[0] > 1.2)

        wait_until(sim, "velocity", moving)
        wait_until(sim, "stop after silence", lambda: abs(v.velocity[0]) < 0.1)
        assert (v.mode.name, v.armed) == ("GUIDED", True)
        v.commands.download()
        v.commands.wait_ready()
        assert v.home_location.lat == pytest.approx(ORIGIN["lat_deg"], abs=5e-6)
        v.commands.clear()
        for command, north in ((22, 0.0), (16, 10.0), (21, 10.0)):
            place = (ORIGIN["lat_deg"] + north / 111_200.0, ORIGIN["lon_deg"], 5.0)
            v.commands.add(dronekit.Command(0, 0, 0, 3, command, 0, 0, 0, 0, 0, 0, *place))
        v.commands.upload()
        v.mode = dronekit.VehicleMode("AUTO")
        wait_until(sim, "landed and disarmed", lambda: not v.armed)
        assert v.location.global_frame.lat == pytest.approx(place[0], abs=1e-5)


@NEEDS_DRONEKIT
@pytest.mark.filterwarnings("ignore")
def test_dronekit_flies_px4(tmp_path: Path) -> None:
    """As far as dronekit knows PX4: no `is_armable`, no empty list downloaded, no take-off command
    without a target."""
    configuration = settings(tmp_path, "px4") | {"speedup": SPEEDUP}
    with simulator(tmp_path, configuration) as sim, dronekit_vehicle(sim) as v:
        import dronekit

        v.parameters["COM_OF_LOSS_T"] = 0.8
        assert v.parameters["COM_OF_LOSS_T"] == pytest.approx(0.8)
        wait_until(
            sim, "home", lambda: v.location.global_frame.alt is not None and v.gps_0.fix_type == 3
        )
        v.commands.clear()
        for command, north in ((22, 0.0), (16, 10.0), (21, 10.0)):
            place = (ORIGIN["lat_deg"] + north / 111_200.0, ORIGIN["lon_deg"], 5.0)
            v.commands.add(dronekit.Command(0, 0, 0, 3, command, 0, 1, 0, 0, 0, 0, *place))
        v.commands.upload(timeout=10)

        def armed() -> bool:
            v.armed = True
            return bool(v.armed)

        wait_until(sim, "armed", armed)
        v.mode = dronekit.VehicleMode("MISSION")
        wait_until(sim, "height", lambda: v.location.global_relative_frame.alt > 4.5)
        wait_until(sim, "landed and disarmed", lambda: not v.armed)
        assert v.location.global_frame.lat == pytest.approx(place[0], abs=1e-5)


class MavProxy:
    """MAVProxy without a screen; its commands are typed, its words read from a file."""

    def __init__(self, sim: Simulator, folder: Path) -> None:
        self._said = folder / "mavproxy.txt"
        self.sim = sim
        assert MAVPROXY is not None
        out = f"udpout:127.0.0.1:{free_port()}"
        options = [
            "--state-basedir",
            str(folder),
            "--default-modules",
            "mode,arm,param,wp,cmdlong,misc,rally,link",
        ]
        command = [
            sys.executable,
            MAVPROXY,
            "--master",
            sim.endpoint(),
            "--out",
            out,
            "--retries",
            "9",
            *options,
        ]
        self._file = self._said.open("w")
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=self._file,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
        )

    def type(self, line: str) -> None:
        """A command."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def hear(self, text: str) -> None:
        """Waits for a word of it."""
        try:
            wait_until(self.sim, repr(text), lambda: text in self._said.read_text())
        except TimeoutError as error:
            raise TimeoutError(f"{error}; it said: {self._said.read_text()[-3000:]}") from None

    def close(self) -> None:
        """Ends it."""
        self.process.kill()
        self.process.communicate()
        self._file.close()


@contextlib.contextmanager
def mavproxy(sim: Simulator, folder: Path) -> Iterator[MavProxy]:
    """A running one."""
    proxy = MavProxy(sim, folder)
    try:
        yield proxy
    finally:
        proxy.close()


def waypoints(folder: Path) -> Path:
    """A QGC WPL file: home, take-off, a point, land."""
    rows = ["QGC WPL 110"]
    for i, (frame, command, north) in enumerate(
        ((0, 16, 0.0), (3, 22, 0.0), (3, 16, 8.0), (3, 21, 8.0))
    ):
        lat = ORIGIN["lat_deg"] + north / 111_200.0
        numbers = [
            i,
            int(i == 0),
            frame,
            command,
            0,
            0,
            0,
            0,
            f"{lat:.7f}",
            f"{ORIGIN['lon_deg']:.7f}",
            5.0,
            1,
        ]
        rows.append("\t".join(str(x) for x in numbers))
    path = folder / "mission.txt"
    path.write_text("\n".join(rows) + "\n")
    return path


@NEEDS_MAVPROXY
@PERSONAS
def test_mavproxy_reads_parameters_and_a_mission_goes_up(tmp_path: Path, persona: str) -> None:
    configuration = settings(tmp_path, persona) | {"speedup": SPEEDUP}
    with simulator(tmp_path, configuration) as sim, mavproxy(sim, tmp_path) as proxy:
        proxy.hear("Detected vehicle 1:1")
        proxy.hear("Received")
        proxy.type(f"wp load {waypoints(tmp_path)}")
        proxy.hear("MISSION_ACK: TYPE_MISSION: ACCEPTED")
        proxy.type("wp list")
        proxy.hear("Requesting 4 waypoints")
        proxy.hear("Saved 4 waypoints")


@NEEDS_MAVPROXY
def test_mavproxy_flies_arducopter(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "ardupilot") | {"speedup": SPEEDUP}
    with (
        simulator(tmp_path, configuration) as sim,
        mavproxy(sim, tmp_path) as proxy,
        pilot(sim, system=254) as watcher,
    ):
        for number, rate_hz in ((1, 2.0), (32, 10.0), (33, 5.0)):
            watcher.stream(number, rate_hz)
        proxy.hear("Received")
        watcher.wait("SYS_STATUS", lambda m: bool(m.onboard_control_sensors_health & 0x10000000))
        proxy.type("param set GUID_TIMEOUT 2")
        proxy.type("mode guided")
        watcher.wait("HEARTBEAT", lambda m: m.custom_mode == 4)
        proxy.type("arm throttle")
        watcher.wait("HEARTBEAT", lambda m: bool(m.base_mode & 128))
        proxy.type("takeoff 5")
        watcher.wait("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 4500)
        proxy.type("velocity 2 0 0")
        watcher.wait("LOCAL_POSITION_NED", lambda m: m.vx > 1.0)
        watcher.wait("LOCAL_POSITION_NED", lambda m: abs(m.vx) < 0.1)
        proxy.type(f"wp load {waypoints(tmp_path)}")
        proxy.hear("MISSION_ACK: TYPE_MISSION: ACCEPTED")
        proxy.type("mode auto")
        watcher.wait("HEARTBEAT", lambda m: not m.base_mode & 128)


@NEEDS_MAVPROXY
@PERSONAS
def test_mavproxy_beside_a_run_sees_all_vehicles_and_no_alarm(tmp_path: Path, persona: str) -> None:
    """With `--gcs`, from before the start to the end of a mission: no fence breach on the ground,
    no failsafe, no failed check. Of a PX4, a real one too, it says `fence breach` at once: PX4's
    SYS_STATUS has no word of a fence."""
    assert MAVPROXY is not None
    mission = yaml.safe_load((ROOT / "missions" / "hexagon.yaml").read_text())
    mission["fleet"] = {"agents": [{"id": i, "autopilot": persona} for i in range(1, 7)]}
    (tmp_path / "mission.yaml").write_text(yaml.safe_dump(mission))
    port, told = free_port(), tmp_path / "mavproxy.txt"
    options = ("--non-interactive", "--state-basedir", str(tmp_path))
    command = [sys.executable, MAVPROXY, f"--master=udpin:127.0.0.1:{port}", *options]
    run = ("run", "mission.yaml", "--gcs", str(port), "--headless", "--no-report")
    with (
        told.open("w") as file,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file) as proxy,
    ):
        try:
            until = time.monotonic() + 60.0
            while "Waiting for heartbeat" not in told.read_text():
                assert time.monotonic() < until, told.read_text()
                time.sleep(0.1)
            with Running(*run, cwd=tmp_path) as flight:
                assert flight.wait(150.0) == 0, flight.output
        finally:
            proxy.kill()
    said = told.read_text()
    assert {i for i in range(1, 7) if f"Detected vehicle {i}:1" in said} == set(range(1, 7)), said
    assert "Received" in said
    assert said.index("ARMED") < said.index("DISARMED")
    alarms = ("breach", "failsafe", "prearm", "unhealthy", "bad ", "denied", "lost")
    found = [line for line in said.splitlines() if any(a in line.lower() for a in alarms)]
    assert found == ["fence breach"] * (persona == "px4")
