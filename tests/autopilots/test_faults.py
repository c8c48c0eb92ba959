"""Wind, sensors, motors, batteries, pilots and ground stations, on ArduCopter and PX4 themselves:
each row with its end.

A fault strikes the vehicle of agent 1 when the hold begins, through the ground-station port.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.autopilots.sitl import Client, Flight
from tests.system.running import Running

PAIR = Path(__file__).with_name("pair.yaml")
HOLD = 3
_METRES_PER_DEGREE = 111319.5
_INJECT_FAILURE, _BATTERY, _OFF = 420, 100, 1
_ARM_DISARM, _BY_FORCE = 400, 21196

Deed = Callable[[Client], None]


def parameters(**values: float) -> Deed:
    """Sets parameters of the vehicle."""

    def deed(client: Client) -> None:
        for name, value in values.items():
            client.set(name, value)

    return deed


def mode(name: str) -> Deed:
    """Changes the vehicle's mode, as a ground station does."""
    return lambda client: client.take_mode(name)


def empty_battery(client: Client) -> None:
    """Has PX4 lose its battery."""
    client.set("SYS_FAILURE_EN", 1)
    client.command(_INJECT_FAILURE, _BATTERY, _OFF)


def lands_and_stays_armed(client: Client) -> None:
    """AUTO.LAND, with PX4's own disarming off."""
    client.set("COM_DISARM_LAND", -1.0)
    client.take_mode("AUTO.LAND")


def glitch(north_m: float) -> Deed:
    return parameters(SIM_GPS1_GLTCH_X=north_m / _METRES_PER_DEGREE)


def motors_off(client: Client) -> None:
    """Disarms the vehicle in the air."""
    client.command(_ARM_DISARM, 0, _BY_FORCE)


COPTER, PX4 = "arducopter", "px4"
ROWS: dict[str, tuple[str, Deed, str, str]] = {
    "wind 8 m/s": (COPTER, parameters(SIM_WIND_DIR=180, SIM_WIND_SPD=8), "completed", ""),
    "gusts": (COPTER, parameters(SIM_WIND_SPD=6, SIM_WIND_TURB=4), "completed", ""),
    "a GPS glitch of 4 m": (COPTER, glitch(4.0), "completed", ""),
    "a compass fails": (COPTER, parameters(SIM_MAG1_FAIL=1), "completed", ""),
    "the battery's failsafe": (
        COPTER,
        parameters(BATT_FS_LOW_ACT=1, BATT_LOW_VOLT=11.5, SIM_BATT_VOLTAGE=11.0),
        "failed",
        "LAND",
    ),
    "a ground station lands": (COPTER, mode("LAND"), "failed", "LAND"),
    "motors off by force": (COPTER, motors_off, "failed", "disarmed"),
    "PX4: motors off by force": (PX4, motors_off, "failed", "disarmed"),
    "PX4: a ground station lands": (PX4, mode("AUTO.LAND"), "failed", "AUTO.LAND"),
    "PX4: lands and stays armed": (PX4, lands_and_stays_armed, "failed", "AUTO.LAND"),
    "PX4: the GPS is lost": (PX4, parameters(SIM_GPS_USED=0), "failed", ""),
    "PX4: the battery's failsafe": (PX4, empty_battery, "failed", ""),
    "PX4: a compass fails": (PX4, parameters(CAL_MAG0_PRIO=0), "completed", ""),
    # INJECT_FAILURE of a motor or compass changes nothing that SIH flies
    "PX4: its motors lose thrust": (PX4, parameters(SIH_T_MAX=1.5), "failed", ""),
}


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """The pair, with a hold that is long enough for what happens in it."""
    path = tmp_path / "faults.yaml"
    path.write_text(PAIR.read_text().replace("duration_s: 5", "duration_s: 20"))
    return path


@pytest.mark.long
@pytest.mark.parametrize("name", ROWS)
def test_whatever_happens_to_a_vehicle(name: str, mission: Path, tmp_path: Path) -> None:
    kind, deed, outcome, reason = ROWS[name]
    with Flight(mission, kind, cwd=tmp_path) as flight:
        flight.wait_for_step(HOLD)
        with flight.client(1) as ground_station:
            deed(ground_station)
            flight.wait(180)
        flight.assert_nothing_left()
        found: dict[str, Any] = flight.summary()
        assert found["outcome"] == outcome, flight.output
        assert reason in flight.reasons()[1]
        if "motors off" in name:
            # by the vehicle's own estimates; the cause comes before what the agents made of it
            assert {each["kind"] for each in found["findings"]} & {"disarmed in the air", "fall"}
            assert found["reason"].startswith("the vehicle of agent 1 ")


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "taken", "down"), [(COPTER, "BRAKE", "LAND"), (PX4, "AUTO.LOITER", "AUTO.LAND")]
)
def test_a_pilot_who_takes_a_vehicle_over_by_mode_keeps_it(
    kind: str, taken: str, down: str, mission: Path, tmp_path: Path
) -> None:
    """The agent does not fight the pilot, the other vehicle lands, and the run ends when the pilot
    has landed."""
    with Flight(mission, kind, cwd=tmp_path) as flight:
        flight.wait_for_step(HOLD)
        with flight.client(1) as pilot:
            pilot.beat()
            pilot.take_mode(taken)
            flight.wait_for(lambda: "agent 2: ended" in flight.output)
            assert pilot.mode == taken
            assert pilot.armed
            pilot.take_mode(down)
            flight.wait(120)
        flight.assert_nothing_left()
        assert flight.summary()["outcome"] == "failed"
        assert taken in flight.reasons()[1]


@pytest.mark.long
def test_an_arducopter_that_falls_is_told_and_the_other_one_lands(
    mission: Path, tmp_path: Path
) -> None:
    """ArduCopter with a dead motor lies on its side and stays armed in LAND: the operator's `kill`
    ends it."""
    with Flight(mission, COPTER, cwd=tmp_path) as flight:
        flight.wait_for_step(HOLD)
        with flight.client(1) as ground_station:
            parameters(SIM_ENGINE_FAIL=1, SIM_ENGINE_MUL=0)(ground_station)
            flight.wait_for(lambda: "agent 2: ended" in flight.output)
            assert ground_station.armed
        assert "agent 1: ERROR: land: leans" in flight.output
        with Running("send", "kill", "--yes", "--agents", "1", cwd=tmp_path) as send:
            send.wait(30)
        flight.wait(60)
        flight.assert_nothing_left()
        assert flight.summary()["outcome"] == "failed"
