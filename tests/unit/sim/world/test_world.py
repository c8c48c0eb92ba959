"""Whole flights of simulated vehicles on a virtual clock: firmware and physics together."""

from __future__ import annotations

import math

import numpy as np
import pytest

from swarm_sim.firmware.message import LandedState
from swarm_sim.world.world import STEP_S, PairMinima, World
from tests.unit.sim.harness import (
    ARM,
    GUIDED,
    LAND,
    OFFBOARD,
    SET_MODE,
    Flight,
    config,
    setpoint_fields,
)

PERSONAS = pytest.mark.parametrize("persona", ["ardupilot", "px4"])
LANDING = {"ardupilot": (1, LAND), "px4": (1, 4, 6)}


def at_height(persona: str, n: int = 1) -> Flight:
    """Vehicle 0 hovers at 10 m, all others stand."""
    flight = Flight(config(n, persona))
    flight.run(0.5)
    flight.take_off()
    flight.run(20.0)
    return flight


def offboard(setpoint: dict[str, float], **parameters: float) -> Flight:
    """A PX4 that is armed in OFFBOARD and stands; after 1 s it is asked to climb."""
    flight = Flight(config(1, "px4"))
    for name, value in parameters.items():
        flight.world.vehicles[0].firmware.parameters.set(name, value)
    flight.run(1.5, setpoint=setpoint_fields(0.0, 0.0, 0.0))
    assert flight.command(0, SET_MODE, 1, *OFFBOARD) == 0
    assert flight.command(0, ARM, 1) == 0
    flight.run(1.0, setpoint=setpoint_fields(0.0, 0.0, 0.0))
    flight.run(1.5, setpoint=setpoint)
    return flight


@pytest.mark.parametrize(
    "setpoint",
    [
        pytest.param(setpoint_fields(0.0, 0.0, -1.5), id="velocity"),
        pytest.param(setpoint_fields(0.0, 0.0, 0.0, mask=3579, z=-20.0), id="position"),
    ],
)
def test_a_px4_spools_up_and_ramps_up_its_climb_in_offboard_too(setpoint: dict[str, float]) -> None:
    flight = offboard(setpoint)
    assert not flight.world.airborne()[0]
    assert flight.world.vehicles[0].firmware.landed_state() is LandedState.ON_GROUND
    flight.run(2.0, setpoint=setpoint)
    assert flight.world.airborne()[0]


def test_a_px4_takes_off_in_offboard_as_fast_as_the_real_one() -> None:
    """Two PX4 1.16 (SIH): by seconds since arming, heights above where they stood."""
    climb = setpoint_fields(0.0, 0.0, -1.5)
    flight = offboard(climb)
    for seconds, low_m, high_m in [(4.5, 1.0, 1.3), (7.5, 5.0, 5.3), (10.0, 8.5, 8.9)]:
        flight.run(seconds - (flight.world.time_s - 1.5), setpoint=climb)
        assert low_m - 0.3 <= -flight.ned()[2] <= high_m + 0.3


def test_the_times_of_a_px4_s_take_off_are_parameters() -> None:
    flight = offboard(setpoint_fields(0.0, 0.0, -1.5), MPC_TKO_RAMP_T=0.5)
    assert flight.world.airborne()[0]
    flight = offboard(setpoint_fields(0.0, 0.0, -1.5), MPC_TKO_RAMP_T=0.5, COM_SPOOLUP_TIME=3.0)
    assert not flight.world.airborne()[0]


@PERSONAS
def test_landing_from_ten_metres_is_slow_at_the_end_and_disarms(persona: str) -> None:
    flight = at_height(persona)
    start, began = flight.ned(), flight.world.time_s
    assert flight.command(0, SET_MODE, *LANDING[persona]) == 0
    touch = 0.0
    while not flight.world.parked():
        if flight.world.airborne()[0]:
            touch = flight.velocity()[2]
        flight.run(0.1)
        assert flight.world.time_s < began + 40.0
    assert touch == pytest.approx({"ardupilot": 0.5, "px4": 0.7}[persona], abs=0.05)
    assert flight.ned() == pytest.approx([start[0], start[1], 0.0], abs=0.02)
    expected = {"ardupilot": 22.3, "px4": 22.5}[persona]
    assert flight.world.time_s - began == pytest.approx(expected, abs=1.5), "as the real ones"


def fly(flight: Flight, persona: str, velocity: tuple[float, float, float], seconds: float) -> None:
    """Velocity setpoints, in the mode that follows them."""
    if persona == "px4":
        flight.run(1.2, setpoint=setpoint_fields(0.0, 0.0, 0.0))
        assert flight.command(0, SET_MODE, 1, 6, 0) == 0
    flight.run(seconds, setpoint=setpoint_fields(*velocity))


def test_ardupilot_silence_from_3_mps_stops_as_measured() -> None:
    """Target to zero 3.1 s after the last setpoint, 11.7 m in all, still GUIDED and armed, not a
    word."""
    flight = at_height("ardupilot")
    fly(flight, "ardupilot", (3.0, 0.0, 0.0), 10.0)
    flight.texts.clear()
    start = flight.ned()
    flight.run(10.0)
    assert flight.ned()[0] - start[0] == pytest.approx(11.7, abs=0.8)
    firmware = flight.world.vehicles[0].firmware
    assert (firmware.mode.custom, firmware.armed, flight.texts) == (GUIDED, True, [])


@PERSONAS
def test_every_vehicle_has_an_origin_of_its_own_the_same_for_a_seed(persona: str) -> None:
    def origins(seed: int) -> list[tuple[float, float, float]]:
        world = World(config(4, persona, seed=seed), 0.0)
        return [v.firmware.local_origin_ned for v in world.vehicles]

    assert origins(1) == origins(1)
    assert origins(1) != origins(2)
    for place, (north, east, _) in enumerate(origins(1)):
        assert 3.0 <= math.hypot(north - 10.0 * place, east) <= 30.0
    assert len({round(north - 10.0 * i, 3) for i, (north, _, _) in enumerate(origins(1))}) == 4


def test_a_collision_is_noted_once_for_both() -> None:
    flight = Flight(config(2, spacing_m=6.0))
    flight.run(1.0)
    flight.take_off(0, height_m=3.0)
    flight.take_off(1, height_m=3.0)
    flight.run(12.0)
    flight.run(8.0, setpoint=setpoint_fields(1.0, 0.0, 0.0))
    events = [(e.sysid, e.event) for e in flight.world.events if e.event == "collision"]
    assert events == [(1, "collision"), (2, "collision")]
    assert flight.world.pairs.shrunk()[-1][2] < 0.02


def test_one_above_the_other_is_a_small_distance_but_no_collision() -> None:
    pairs = PairMinima(2)
    assert pairs.update(np.array([[0.0, 0.0, -5.0], [0.1, 0.0, -8.0]])) == []
    ((i, j, distance),) = pairs.shrunk()
    assert (i, j, round(distance, 9)) == (0, 1, 0.1)
    assert pairs.update(np.array([[0.0, 0.0, -5.0], [0.1, 0.0, -5.2]])) == [(0, 1)]
    assert pairs.update(np.array([[0.0, 0.0, -5.0], [0.1, 0.0, -5.2]])) == []
    assert pairs.shrunk() == []


def test_a_pass_between_two_steps_counts() -> None:
    """At 50 m/s relative the two are 0.5 m apart at both steps and touch between them."""
    pairs = PairMinima(2)
    assert pairs.update(np.array([[0.0, -0.5, -5.0], [0.0, 0.1, -5.0]])) == []
    assert pairs.update(np.array([[0.0, 0.5, -5.0], [0.0, 0.1, -5.0]])) == [(0, 1)]
    ((_, _, distance),) = pairs.shrunk()
    assert distance == pytest.approx(0.0, abs=1e-9)


@PERSONAS
def test_motors_off_in_the_air_are_an_event_and_the_crash_has_its_speed(persona: str) -> None:
    """Disarmed by force 10 m high: it hits the ground with 13 m/s, as a fall with drag does."""
    flight = at_height(persona)
    assert flight.command(0, ARM, 0.0, 21196.0) == 0
    flight.run(4.0)
    _, disarm, touchdown, crash = flight.world.events
    assert [disarm.event, touchdown.event, crash.event] == ["disarm", "touchdown", "crash"]
    assert disarm.height_m == pytest.approx(10.0, abs=0.2)
    assert disarm.time_s < touchdown.time_s == crash.time_s
    assert touchdown.impact_mps == crash.impact_mps
    assert crash.impact_mps == pytest.approx(12.7, abs=0.7)


def test_an_ideal_vehicle_has_the_velocity_it_is_told_at_once() -> None:
    settings = config(2).model_dump()
    settings["vehicles"][1]["response"] = "ideal"
    flight = Flight(type(config(1)).model_validate(settings))
    flight.run(0.5)
    for place in (0, 1):
        flight.take_off(place, height_m=5.0)
    flight.run(10.0)
    for place in (0, 1):
        flight.tell(
            place,
            "SET_POSITION_TARGET_LOCAL_NED",
            **setpoint_fields(2.0, 0.0, 0.0, target_system=place + 1),
        )
    flight.run(2 * STEP_S)
    assert flight.velocity(1) == pytest.approx([2.0, 0.0, 0.0])
    assert flight.velocity(0)[0] < 0.2
