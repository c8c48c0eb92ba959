"""MAVLink 2 signing on ArduCopter itself: `trust vehicle` sets it up, a mission flies, and a man on
the agent's link gets nothing. PX4 signs from 1.18; an older one is told as such."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections import deque
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.vehicles.instances import UDP
from swarm_ctl.engine.vehicles.order import Started
from swarm_ctl.mavlink.outgoing import ARM_DISARM, FORCE, command
from swarm_ctl.mavlink.stamp import stamp_at
from swarm_ctl.mavlink.wires import open_wire
from swarm_ctl.trust.provision import Terms, new
from tests.autopilots.sitl import Client, alone, standing
from tests.system.running import Running


class Wiretap:
    """A man between an agent and its vehicle: passes all on, keeps it, and adds frames."""

    def __init__(self, vehicle: str) -> None:
        (port,) = free_ports(1, UDP)
        self.endpoint = f"udpin:127.0.0.1:{port}"
        self.to_vehicle: deque[bytes] = deque()
        self.to_agent: deque[bytes] = deque()
        self.said: list[bytes] = []
        """By the vehicle."""
        self._vehicle, self._agent = open_wire(vehicle), open_wire(f"udpout:127.0.0.1:{port}")
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._vehicle.close()
        self._agent.close()

    def _work(self) -> None:
        while not self._ended.wait(0.005):
            for carry in (self._down, self._up):
                with contextlib.suppress(OSError):  # one of them is not there
                    carry(time.monotonic())

    def _down(self, now: float) -> None:
        while (chunk := self._agent.read(now)) is not None:
            self._vehicle.write(chunk, now)
        while self.to_vehicle:
            self._vehicle.write(self.to_vehicle.popleft(), now)

    def _up(self, now: float) -> None:
        while (chunk := self._vehicle.read(now)) is not None:
            self.said.append(chunk)
            self._agent.write(chunk, now)
        while self.to_agent:
            self._agent.write(self.to_agent.popleft(), now)


def trusted(folder: Path, vehicle: Started, endpoint: str) -> Path:
    """A mission of one agent, with keys."""
    new(folder / "trust", "pair", {1: "127.0.0.1"}, ["anna"], [], Terms(datetime.now(UTC)))
    path = alone(folder, vehicle, endpoint)
    mission = yaml.safe_load(path.read_text())
    mission["fleet"]["trust"] = "trust"
    path.write_text(yaml.safe_dump(mission))
    return path


def trust_vehicle(folder: Path, endpoint: str, *more: str) -> tuple[int, str]:
    """`swarm-ctl trust vehicle`: exit code and output."""
    where = ("--id", "1", "--folder", folder / "trust", "--endpoint", endpoint)
    with Running("trust", "vehicle", *where, *more, cwd=folder) as tool:
        return tool.wait(90.0), tool.output


def packed(
    message: Any, source: tuple[int, int], key: bytes | None = None, old_s: float = 0
) -> bytes:
    codec = dialect.MAVLink(None, *source)
    if key is not None:
        codec.signing.secret_key, codec.signing.sign_outgoing = key, True
        codec.signing.timestamp = stamp_at(time.time() - old_s)
    return bytes(message.pack(codec))


@contextlib.contextmanager
def tapped(vehicle: str) -> Iterator[Wiretap]:
    with contextlib.closing(Wiretap(vehicle)) as tap:
        yield tap


@pytest.mark.long
def test_an_arducopter_gets_its_key_flies_and_obeys_no_other(tmp_path: Path) -> None:
    with standing([VehicleKind.ARDUCOPTER], tmp_path / "vehicles") as started:
        vehicle = started[1]
        signs = vehicle.ground_station  # SERIAL1: the first port takes unsigned frames, as USB
        with tapped(signs) as tap:
            mission = trusted(tmp_path, vehicle, tap.endpoint)
        code, output = trust_vehicle(tmp_path, signs)
        assert (code, "an unsigned frame was ignored" in output) == (0, True), output
        code, output = trust_vehicle(tmp_path, vehicle.endpoint)
        assert (code, "on this port it takes unsigned frames, too" in output) == (0, True), output
        key = (tmp_path / "trust" / "agent-1" / "mavlink.key").read_bytes()
        with tapped(signs) as tap:
            mission.write_text(mission.read_text().replace(mission_endpoint(mission), tap.endpoint))
            attack(tmp_path, mission, tap, key, vehicle)
        assert trust_vehicle(tmp_path, signs, "--clear")[0] == 0
        with Client(vehicle) as client:
            assert client.get("MAV_SYSID") == vehicle.sysid


def mission_endpoint(mission: Path) -> str:
    return str(yaml.safe_load(mission.read_text())["fleet"]["agents"][0]["endpoint"])


def attack(folder: Path, mission: Path, tap: Wiretap, key: bytes, vehicle: Started) -> None:
    """Fly, and try to end the flight."""
    agent, autopilot = (250, 191), (vehicle.sysid, 1)
    disarm = command(vehicle.sysid, ARM_DISARM, 0.0, FORCE)
    with Running("run", mission, "--headless", "--no-report", cwd=folder) as run:
        run.wait_for(lambda: "step 3/" in run.output, 240.0)
        recorded = tap.said[-200:]
        for _ in range(20):
            tap.to_vehicle.append(packed(disarm, agent))
            tap.to_vehicle.append(packed(disarm, agent, bytes(32)))
            tap.to_vehicle.append(packed(disarm, agent, key, 3600.0))
            lands = dialect.MAVLink_heartbeat_message(2, 3, 1, 9, 4, 3)
            tap.to_agent.append(packed(lands, autopilot))
            tap.to_agent.append(packed(lands, autopilot, bytes(32)))
            tap.to_agent.extend(recorded[:20])
            time.sleep(0.1)
        assert run.wait(240.0) == 0, run.output
        run.assert_nothing_left()
        summary = run.summary()
    assert [each["outcome"] for each in summary["agents"]] == ["completed"]
    status = json.loads((run.folder / "agents" / "1.json").read_text())
    print(status["vehicle_link"], [each["text"] for each in summary.get("alarms", [])])
    refusals = status["vehicle_link"]["refusals"]
    assert min(refusals[why] for why in ("unsigned", "wrongly signed", "replayed")) >= 20
    assert "frames for vehicle 1 refused" in run.output


def test_a_px4_before_1_18_is_told_not_to_sign(tmp_path: Path) -> None:
    with standing([VehicleKind.PX4], tmp_path / "vehicles") as started:
        trusted(tmp_path, started[1], started[1].endpoint)
        code, output = trust_vehicle(tmp_path, started[1].endpoint)
    if code == 0:
        pytest.skip("this PX4 signs")
    assert code == 1
    assert "vehicle 1: it does not sign, although it was told to (PX4 signs from 1.18)" in output
