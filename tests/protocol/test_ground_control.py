"""Ground control software and simulated vehicles, with the relay of `run --gcs` between: six
vehicles on one port, parameters and missions included."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.core.model.fleet import agent_sysids
from swarm_ctl.engine.gcs.config import GcsAddress, RelayConfig, RelayVehicle
from swarm_ctl.engine.launch_file import Launch, write_launch
from tests.protocol.qgroundcontrol import QGroundControl
from tests.protocol.simulator import Simulator, free_port, settings, simulator

KINDS = {i: "px4" if i > 3 else "ardupilot" for i in range(1, 7)}


@contextlib.contextmanager
def relay(tmp_path: Path, *gcs_ports: int, speedup: float = 1.0) -> Iterator[Simulator]:
    """Three ArduCopters and three PX4s; all frames go to and from these ports of ours."""
    configuration = settings(tmp_path, "ardupilot", len(KINDS)) | {"speedup": speedup}
    links = {}
    for vehicle in configuration["vehicles"]:
        sysid = vehicle["sysid"]
        links[sysid] = f"127.0.0.1:{free_port()}"
        vehicle |= {"persona": KINDS[sysid], "also": [f"udpin:{links[sysid]}"]}
        vehicle["ready_after_s"] = 0.0  # without a position a vehicle declines HOME_POSITION
    vehicles = [
        RelayVehicle(sysid, sysid, agent_sysid, f"udpout:{link}")
        for agent_sysid, (sysid, link) in zip(
            agent_sysids(len(links), links), links.items(), strict=True
        )
    ]
    stations = [GcsAddress("127.0.0.1", port, free_port()) for port in gcs_ports]
    told = RelayConfig(tuple(vehicles), tuple(stations))
    write_launch(tmp_path, Launch("log", relay=told))
    command = [sys.executable, "-m", "swarm_ctl.engine.gcs.gcs_process", str(tmp_path)]
    with (
        simulator(tmp_path, configuration) as sim,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process,
    ):
        try:
            assert process.stdout is not None
            assert process.stdin is not None
            assert b"ready" in process.stdout.readline()
            yield sim
            process.stdin.close()  # the lifeline: all vehicles are on the ground
            assert process.wait(5.0) == 0
        finally:
            process.kill()


def test_plans_go_up_and_down_of_one_vehicle_alone(tmp_path: Path) -> None:
    """Mission, fence and rally points that QGroundControl writes are what it reads again."""
    with contextlib.closing(QGroundControl()) as qgc, relay(tmp_path, qgc.port):
        qgc.find(6)
        for sysid in (2, 5):
            point = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 473_980_000, 85_460_000, 20.0)
            plans = {0: [(22, *point), (16, *point), (21, *point)], 1: [(5003, *point)]}
            plans[2] = [(5100, *point)]
            for kind, items in plans.items():
                qgc.write_plan(sysid, kind, items)
            vehicle = qgc.connect(sysid)
            read = {0: vehicle.mission, 1: vehicle.fence, 2: vehicle.rally}
            for kind, items in plans.items():
                assert len(read[kind]) == len(items)
                # what is told as an ArduPilot's first item is its home
                first = 1 if kind == 0 and vehicle.is_ardupilot else 0
                found = [(i.command, i.frame, i.x, i.y, i.z) for i in read[kind]]
                assert found[first:] == items[first:]
        assert qgc.connect(1).mission == []


def test_two_ground_stations_at_once_each_get_everything(tmp_path: Path) -> None:
    with (
        contextlib.closing(QGroundControl()) as one,
        contextlib.closing(QGroundControl(system=254)) as other,
        relay(tmp_path, one.port, other.port),
    ):
        for qgc in (one, other):
            qgc.find(6)
        assert one.connect(1).parameters == other.connect(1).parameters


def test_mavsdk_finds_all_and_reads_parameters_of_one(tmp_path: Path) -> None:
    """It listens, and speaks with an id of its own, 245."""
    mavsdk = pytest.importorskip("mavsdk", reason="pip install mavsdk>=4", exc_type=ImportError)
    param = pytest.importorskip("mavsdk.plugins.param", exc_type=ImportError)
    kind = mavsdk.ComponentType.GROUND_STATION
    port = free_port()
    with relay(tmp_path, port):
        client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        try:
            client.add_any_connection(f"udpin://127.0.0.1:{port}")
            until = time.monotonic() + 30.0
            while len(client.get_systems()) < len(KINDS) and time.monotonic() < until:
                time.sleep(0.1)
            found = {system.get_system_id(): system for system in client.get_systems()}
            assert sorted(found) == list(KINDS)
            assert param.Param(found[5]).get_param_int("MAV_SYS_ID") == 5
        finally:
            client.destroy()
