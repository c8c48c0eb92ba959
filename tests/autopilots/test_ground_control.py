"""QGroundControl's first steps with ArduCopter and PX4 themselves, through the relay of `run
--gcs`: over the vehicle's second link, and over the only one, which its agent shares."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
import yaml

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.plan import Geodetic
from tests.autopilots.sitl import Flight, needed, standing
from tests.protocol.qgroundcontrol import QGroundControl, Vehicle
from tests.system.running import Running

PAIR = Path(__file__).with_name("pair.yaml")
KINDS = (VehicleKind.ARDUCOPTER, VehicleKind.PX4)


def connected(qgc: QGroundControl) -> dict[int, Vehicle]:
    """Both vehicles, each step done; checks what is the same for both links."""
    assert qgc.find(2, 240.0) == [1, 2]
    vehicles = {system: qgc.connect(system) for system in (1, 2)}
    copter, px4 = vehicles[1], vehicles[2]
    assert (copter.is_ardupilot, px4.is_ardupilot) == (True, False)
    for vehicle in vehicles.values():
        assert len(vehicle.parameters) > 500
        assert vehicle.version.flight_sw_version > 0
        assert abs(vehicle.home.latitude * 1e-7 + 35.363262) < 0.001
        assert vehicle.fence == vehicle.rally == []
    return vehicles


@pytest.mark.long
def test_qgroundcontrol_connects_over_each_vehicles_second_link(tmp_path: Path) -> None:
    with (
        contextlib.closing(QGroundControl()) as qgc,
        Flight(PAIR, "arducopter,px4", cwd=tmp_path, more=f"--gcs {qgc.port}") as flight,
    ):
        vehicles = connected(qgc)
        assert vehicles[2].modes > 5  # messages newer than the dialect pass
        flight.assert_completed()


@pytest.mark.long
def test_qgroundcontrol_connects_over_the_links_that_agents_share(tmp_path: Path) -> None:
    """The agents keep their rates meanwhile, and fly."""
    needed("arducopter px4")
    data = yaml.safe_load(PAIR.read_text())
    origin = Geodetic(**data["origin"])
    data["agents"] = [{"id": 1, "start": [0, 0]}, {"id": 2, "start": [0, 10]}]
    data["steps"][2] = {"hold": {"duration_s": 40}}
    with standing(KINDS, tmp_path / "vehicles", origin=origin) as started:
        data["fleet"] = {
            "agents": [
                {"id": i, "autopilot": kind, "endpoint": started[i].endpoint}
                for i, kind in ((1, "ardupilot"), (2, "px4"))
            ]
        }
        mission = tmp_path / "own.yaml"
        mission.write_text(json.dumps(data))
        cwd = tmp_path / "run"
        cwd.mkdir()
        with (
            contextlib.closing(QGroundControl()) as qgc,
            Running(
                *("run", mission, "--headless", "--no-report", "--gcs", str(qgc.port)), cwd=cwd
            ) as running,
        ):
            connected(qgc)
            running.wait(240.0)
            running.assert_nothing_left()
            summary = running.summary()
            assert {each["outcome"] for each in summary["agents"]} == {"completed"}
            assert summary["setpoint_rate_hz"] >= 19.0
