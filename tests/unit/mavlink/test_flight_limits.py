"""The vehicle's own limits, by the parameters of each version."""

from __future__ import annotations

import pytest

from swarm_ctl.core.model.vehicle import FlightLimit, LimitKind, StandbyGoal
from swarm_ctl.mavlink.autopilots import autopilot
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.telemetry.incoming import fold
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry
from tests.unit.mavlink import wire
from tests.unit.mavlink.scripted import ScriptedArdupilot, ScriptedPx4


def heard(driver: Autopilot, **values: float) -> Telemetry:
    telemetry = Telemetry(watched=driver.watched)
    for name, value in values.items():
        fold(telemetry, wire.parameter(name, value), 0.0)
    return telemetry


OLD = {
    "WPNAV_SPEED": 500.0,
    "WPNAV_SPEED_UP": 250.0,
    "WPNAV_SPEED_DN": 150.0,
    "WPNAV_ACCEL": 250.0,
    "ANGLE_MAX": 3000.0,
}
NEW = {"WP_SPD": 5.0, "WP_SPD_UP": 2.5, "WP_SPD_DN": 1.5, "WP_ACC": 2.5, "ATC_ANGLE_MAX": 30.0}


@pytest.mark.parametrize("values", [OLD, NEW], ids=["up to 4.6", "from 4.7"])
def test_an_ardupilot_s_limits_by_either_name(values: dict[str, float]) -> None:
    driver = autopilot("ardupilot", 7)
    telemetry = heard(driver, **values)
    assert driver.flight_limits.unread(telemetry) == ()
    found = [
        (limit.kind, round(limit.allowed, 2)) for limit in driver.flight_limits.limits(telemetry)
    ]
    assert found == [
        (LimitKind.SPEED, 5.0),
        (LimitKind.CLIMB, 2.5),
        (LimitKind.DESCENT, 1.5),
        (LimitKind.ACCELERATION, 3.0),
        (LimitKind.ACCELERATION, 5.66),
    ]


def test_a_lean_limit_of_zero_is_none() -> None:
    driver = autopilot("ardupilot", 7)
    leaning = heard(driver, **OLD, PSC_ANGLE_MAX=10.0)
    assert FlightLimit(
        LimitKind.ACCELERATION, pytest.approx(1.73, abs=0.01), "PSC_ANGLE_MAX 10"
    ) in driver.flight_limits.limits(leaning)
    free = driver.flight_limits.limits(heard(driver, **OLD, PSC_ANGLE_MAX=0.0))
    assert free == driver.flight_limits.limits(heard(driver, **OLD))


@pytest.mark.parametrize("loss", [0.0, 0.5])
@pytest.mark.parametrize(("name", "kind"), [("ardupilot", ScriptedArdupilot), ("px4", ScriptedPx4)])
def test_the_limits_are_read_in_standby_and_asked_for_no_more(
    name: str, kind: type[ScriptedArdupilot | ScriptedPx4], loss: float
) -> None:
    vehicle = kind(autopilot(name, 7), loss=loss)
    vehicle.run(StandbyGoal(), 60.0)
    assert vehicle.driver.flight_limits.unread(vehicle.heard) == ()
    required = {n for s in vehicle.driver.limit_sources if not s.optional for n in s.names}
    later = [
        m.param_id for _, m in vehicle.run(StandbyGoal(), 10.0) if m.msgname == "PARAM_REQUEST_READ"
    ]
    assert not required & set(later)
