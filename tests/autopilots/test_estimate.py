"""What ArduCopter and PX4 themselves say of their estimates and their limits, and what agents make
of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.mavlink import outgoing
from tests.autopilots.sitl import Client, Flight, alone, standing
from tests.system.running import Running

PAIR = Path(__file__).with_name("pair.yaml")
HOLD = 3
DOUBTS = ("accuracy", "estimator", "GPS", "EKF_STATUS_REPORT", "ESTIMATOR_STATUS")


@pytest.mark.long
def test_a_flight_without_faults_raises_no_doubt(tmp_path: Path) -> None:
    with Flight(PAIR, "arducopter,px4", cwd=tmp_path) as flight:
        flight.assert_completed()
        said = [event["text"] for event in flight.events() if event["text"].startswith("hold")]
        assert [text for text in said if any(word in text for word in DOUBTS)] == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "names", "share"),
    [
        (VehicleKind.ARDUCOPTER, ("WP_SPD", "WPNAV_SPEED"), 0.3),
        (VehicleKind.PX4, ("MPC_XY_VEL_MAX",), 0.25),
    ],
)
def test_a_mission_faster_than_the_vehicle_is_refused(
    kind: VehicleKind, names: tuple[str, ...], share: float, tmp_path: Path
) -> None:
    with standing([kind], tmp_path / "vehicles") as started:
        vehicle = started[1]
        with Client(vehicle) as ground_station:
            name = known(ground_station, names)
            ground_station.set(name, share * ground_station.get(name))
        mission = alone(tmp_path, vehicle)
        with Running("run", mission, "--headless", "--no-report", cwd=tmp_path) as run:
            assert run.wait(90.0) == 1
            assert f"the mission flies 5.0 m/s; vehicle 1 allows 3.0 ({name}" in run.output


@pytest.mark.long
def test_an_arducopter_as_delivered_does_not_know_the_wind(tmp_path: Path) -> None:
    """It sends WIND of 0 m/s, which is no calm: the agent says once, before arming, that the limit
    can't act, and no limit acts."""
    with standing([VehicleKind.ARDUCOPTER], tmp_path / "vehicles") as started:
        mission = alone(tmp_path, started[1])
        mission.write_text(f"{mission.read_text()}policies: {{wind_limit_mps: 5}}\n")
        with Client(started[1]) as ground_station:
            ground_station.set("SIM_WIND_SPD", 8.0)
        with Running("run", mission, "--headless", "--no-report", cwd=tmp_path) as run:
            assert run.wait(180.0) == 0, run.output
            events = (run.folder / "events.jsonl").read_text()
    before_take_off, after = events.split("step 1: takeoff")
    assert before_take_off.count("does not estimate the wind: the limit of 5 m/s can't act") == 1
    assert "wind" not in after


def known(client: Client, names: tuple[str, ...]) -> str:
    """The name that this version has."""

    def ask() -> None:
        for name in names:
            client.send(outgoing.read_parameter(client.sysid, name))

    client.wait_for(lambda: any(name in client.parameters for name in names), ask)
    return next(name for name in names if name in client.parameters)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "parameter", "value", "doubt", "outcome"),
    [
        # 4.4 m: refused for 7 s, flagged until 17 s, and held through
        ("arducopter", "SIM_GPS1_GLTCH_X", 4e-5, "horizontal position differs", "completed"),
        (
            "arducopter",
            "SIM_GPS1_ACC",
            5.0,
            "position accuracy 5.0 m; allowed: at most 2",
            "failed",
        ),
        # without a GPS it lands by itself
        ("px4", "SIM_GPS_USED", 3, "the GPS has no 3D fix", "failed"),
    ],
)
def test_a_bad_gps_is_seen_and_held(
    kind: str, parameter: str, value: float, doubt: str, outcome: str, tmp_path: Path
) -> None:
    mission = tmp_path / "gps.yaml"
    mission.write_text(PAIR.read_text().replace("duration_s: 5", "duration_s: 10, timeout_s: 40"))
    with Flight(mission, kind, cwd=tmp_path) as flight:
        flight.wait_for_step(HOLD)
        with flight.client(1) as ground_station:
            ground_station.set(parameter, value)
        flight.wait(240.0)
        flight.assert_nothing_left()
        assert flight.outcomes()[1] == outcome, flight.output
        said = [e["text"] for e in flight.events() if e["agent"] == 1]
        assert [text for text in said if text.startswith("hold") and doubt in text], said
