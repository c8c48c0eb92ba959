"""Weather, sensor errors, broken parts and radio: each SIM_* parameter does what it says, and the
same every time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from swarm_sim.config import SimConfig
from swarm_sim.firmware.parameters import SIM_DEFAULTS
from swarm_sim.world.faults import TICK_S
from tests.scenarios.swarm import flown_once
from tests.unit.sim.harness import ARM, GUIDED, SET_MODE, Flight, config, setpoint_fields
from tests.unit.sim.network.test_hub import HELLO, A, Clients

PERSONAS = pytest.mark.parametrize("persona", ["ardupilot", "px4"])
REQUEST = 512


def hovering(persona: str = "ardupilot", n: int = 1, **more: Any) -> Flight:
    """Vehicle 0 at 10 m, held there by position."""
    flight = Flight(config(n, persona, **more))
    flight.run(0.5)
    flight.take_off()
    flight.run(15.0)
    return flight


def put(flight: Flight, place: int = 0, **values: float) -> None:
    for name, value in values.items():
        kind = flight.world.vehicles[place].firmware.parameters.value_message(name)["param_type"]
        fields = {"target_system": place + 1, "target_component": 1, "param_type": kind}
        flight.tell(
            place,
            "PARAM_SET",
            **fields,
            param_id=name,
            param_value=wire(flight, place, name, value),
        )


def wire(flight: Flight, place: int, name: str, value: float) -> float:
    parameters = flight.world.vehicles[place].firmware.parameters
    return float(parameters._encoding.encode(parameters._items[name].type, value))


def reported(flight: Flight) -> list[float]:
    firmware = flight.world.vehicles[0].firmware
    firmware.sensed = flight.world.vehicles[0].sense()
    return [
        a + b for a, b in zip(firmware.local_position(), firmware.local_origin_ned, strict=True)
    ]


@PERSONAS
def test_a_steady_wind_is_leant_into_and_carries_off_a_vehicle_that_holds_no_place(
    persona: str,
) -> None:
    flight = hovering(persona)
    put(flight, SIM_WIND_SPD=5.0, SIM_WIND_DIR=90.0)
    flight.run(20.0)
    assert flight.world.groups[persona].state.wind[0] == pytest.approx([0.0, -5.0, 0.0], abs=1e-6)
    assert abs(flight.ned()[1]) < 3.5
    sensed = flight.world.vehicles[0].sense()
    assert sensed.thrust_ned_mps2[1] > 0.5
    (attitude,) = [
        m.fields
        for m in flight.tell(
            0,
            "COMMAND_LONG",
            command=REQUEST,
            confirmation=0,
            target_system=1,
            target_component=1,
            **P30,
        )
        if m.name == "ATTITUDE"
    ]
    assert attitude["roll"] > math.radians(3.0)
    put(flight, SIM_WIND_SPD=0.0)
    flight.run(20.0)
    assert not flight.world.groups[persona].state.wind.any()


P30 = {"param1": 30.0} | {f"param{i}": 0.0 for i in range(2, 8)}


def test_gusts_blow_as_hard_as_asked_and_repeat_under_a_seed() -> None:
    def winds(seed: int) -> np.ndarray[Any, Any]:
        flight = Flight(config(1, seed=seed, sim_parameters={"SIM_WIND_GUST": 2.0}))
        out = []
        for _ in range(3000):
            flight.run(0.1)
            out.append(flight.world.groups["ardupilot"].state.wind[0].copy())
        return np.array(out)

    first, again, other = winds(1), winds(1), winds(2)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert first[:, :2].std() == pytest.approx(2.0, rel=0.3)


@PERSONAS
def test_gps_errors_are_in_what_it_reports_and_it_flies_by_them(persona: str) -> None:
    flight = hovering(persona)
    start = flight.ned()
    put(flight, SIM_GPS_JUMP_N=3.0)
    flight.run(0.2)
    assert reported(flight)[0] - flight.ned()[0] == pytest.approx(3.0)
    if persona == "ardupilot":  # still holds the place of its take-off
        flight.run(20.0)
        assert flight.ned()[0] - start[0] == pytest.approx(-3.0, abs=0.3)
    put(flight, SIM_GPS_JUMP_N=0.0)
    flight.run(0.2)
    assert reported(flight) == pytest.approx(flight.ned())


def test_noise_and_drift_have_their_size() -> None:
    """On the ground, and without the firmware: the errors alone move on."""
    for name, spread, every_s in (("SIM_GPS_NOISE", 0.5, 2.0), ("SIM_GPS_DRIFT", 2.0, 20.0)):
        vehicles = Flight(config(40, sim_parameters={name: spread})).world.vehicles
        late = []
        for vehicle in vehicles:
            truth = vehicle.sense()
            assert vehicle.faults.look()
            for tick in range(round(12 * every_s / TICK_S)):
                assert vehicle.faults.move(tick * TICK_S, truth)
                if tick * TICK_S > 6 * every_s and tick % round(every_s / TICK_S) == 0:
                    late.append(vehicle.faults.offset)
        assert np.array(late).std() == pytest.approx(spread, rel=0.25)


def test_a_velocity_estimate_errs_in_flight_and_the_vehicle_follows_it() -> None:
    """As a real PX4: it drifts while it says that it stands."""
    flight = hovering("px4")
    vehicle, place = flight.world.vehicles[0], flight.world.groups["px4"].state
    flight.run(1.5, setpoint=setpoint_fields(0.0, 0.0, 0.0))
    assert flight.command(0, SET_MODE, 1, 6, 0) == 0
    put(flight, SIM_VEL_NOISE=0.17)
    told, true = [], []
    for _ in range(200):
        flight.run(0.5, setpoint=setpoint_fields(0.0, 0.0, 0.0))
        told.append(vehicle.sense().velocity_ned_mps[:2])
        true.append(tuple(place.velocity[0][:2]))
    errors = np.array(true) - np.array(told)
    assert errors.std() == pytest.approx(0.17, rel=0.25)
    assert np.array(told).std() < 0.8 * np.array(true).std()
    flight.command(0, SET_MODE, 1, 4, 6)
    flight.run(60.0)
    assert vehicle.sense().velocity_ned_mps == (0.0, 0.0, 0.0), "on the ground it does not err"


@PERSONAS
@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_velocity_does_not_carry_a_landing_away(persona: str, seed: int) -> None:
    """Both firmwares land by their place; followed alone, this error led over 2 m away."""
    flight = hovering(persona, seed=seed)
    put(flight, SIM_VEL_NOISE=0.25)
    flight.run(3.0)
    above = flight.ned()
    mode = (1, 9) if persona == "ardupilot" else (1, 4, 6)
    assert flight.command(0, SET_MODE, *mode) == 0
    flight.run(60.0)
    assert flight.world.parked()
    assert math.dist(above[:2], flight.ned()[:2]) < 1.0


@PERSONAS
def test_without_gps_it_comes_down(persona: str) -> None:
    flight = hovering(persona)
    put(flight, SIM_GPS_OFF=1.0)
    flight.run(60.0)
    assert flight.world.parked()
    answer = flight.command(0, ARM, 1)
    assert answer != 0 or persona == "ardupilot"  # ArduCopter is in LAND, which is refused too
    assert not flight.world.armed()[0]


@PERSONAS
def test_refused_arming_says_why_and_shows_in_the_health(persona: str) -> None:
    flight = Flight(config(1, persona, sim_parameters={"SIM_ARM_REFUSE": 1.0}))
    flight.run(1.0)
    assert flight.command(0, ARM, 1) == {"ardupilot": 4, "px4": 1}[persona]  # MAV_RESULT
    assert flight.texts
    put(flight, SIM_ARM_REFUSE=0.0)
    assert flight.command(0, ARM, 1) == 0


@PERSONAS
def test_a_stopped_motor_is_a_crash(persona: str) -> None:
    flight = hovering(persona)
    put(flight, SIM_MOTOR_STOP=1.0)
    flight.run(4.0)
    assert flight.world.parked()
    assert [e.event for e in flight.world.events] == ["liftoff", "touchdown", "crash"]
    assert "Crash: Disarming" in flight.texts


@PERSONAS
def test_a_reboot_in_flight_is_a_fall_then_a_fresh_start(persona: str) -> None:
    flight = hovering(persona)
    put(flight, SIM_REBOOT=1.0)
    flight.run(6.0)
    firmware = flight.world.vehicles[0].firmware
    assert flight.world.parked()
    assert firmware.parameters["SIM_REBOOT"] == 0.0
    assert firmware.boot_s > 15.0


@pytest.mark.parametrize(
    ("persona", "name", "action"),
    [("ardupilot", "BATT_FS_LOW_ACT", 1.0), ("px4", "COM_LOW_BAT_ACT", 2.0)],
)
def test_a_failed_battery_acts_as_its_parameter_says(
    persona: str, name: str, action: float
) -> None:
    flight = hovering(persona)
    put(flight, SIM_BATT_FAIL=1.0)
    flight.run(5.0)
    assert flight.world.airborne() == [True], "warns only"
    assert any("attery" in text for text in flight.texts)
    put(flight, SIM_BATT_FAIL=0.0)
    put(flight, **{name: action})
    flight.run(1.0)
    put(flight, SIM_BATT_FAIL=1.0)
    flight.run(40.0)
    assert flight.world.parked()


@pytest.mark.parametrize("fall", [False, True])
def test_after_a_collision_both_fall_if_asked(fall: bool) -> None:
    flight = Flight(config(2, spacing_m=6.0, sim_parameters={"SIM_COLL_FALL": float(fall)}))
    flight.run(1.0)
    for place in (0, 1):
        flight.take_off(place, height_m=5.0)
    flight.run(12.0)
    flight.run(8.0, setpoint=setpoint_fields(1.0, 0.0, 0.0))
    assert "Collision with vehicle 2" in flight.texts
    assert "Collision with vehicle 1" in flight.texts
    assert flight.world.airborne() == [not fall, not fall]
    crashed = [e.sysid for e in flight.world.events if e.event == "crash"]
    assert crashed == ([1, 2] if fall else [])


def test_a_timetable_acts_at_its_time_on_whom_it_names() -> None:
    faults = [
        {"at_s": 5.0, "sysid": 2, "set": {"SIM_ARM_REFUSE": 1}},
        {"at_s": 2.0, "set": {"SIM_LOSS": 10}},
    ]
    flight = Flight(config(2, faults=faults))

    def values(name: str) -> list[float]:
        return [v.firmware.parameters[name] for v in flight.world.vehicles]

    flight.run(1.9)
    assert values("SIM_LOSS") == [0.0, 0.0]
    flight.run(0.2)
    assert values("SIM_LOSS") == [10.0, 10.0]
    assert values("SIM_ARM_REFUSE") == [0.0, 0.0]
    flight.run(3.0)
    assert values("SIM_ARM_REFUSE") == [0.0, 1.0]


def test_a_timetable_may_count_from_the_first_liftoff() -> None:
    """However long the vehicles stand there before."""
    flight = Flight(
        config(2, faults=[{"at_s": 2.0, "set": {"SIM_LOSS": 10}}], faults_since="liftoff")
    )
    flight.run(20.0)
    assert [event.event for event in flight.world.events] == []
    flight.take_off()
    flight.run(10.0)
    times = {event.event: event.time_s for event in flight.world.events if event.sysid == 1}
    assert times["SIM_LOSS 10"] == pytest.approx(times["liftoff"] + 2.0, abs=0.05)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"sim_parameters": {"SIM_WIND": 3}}, "SIM_WIND_SPD"),
        ({"faults": [{"at_s": 1, "sysid": 9, "set": {"SIM_LOSS": 1}}]}, "sysid 9"),
        ({"faults": [{"at_s": 1, "set": {}}]}, "set"),
        ({"sim_parameters": {"SIM_LOSS": math.nan}}, "finite"),
    ],
)
def test_mistakes_in_faults_are_named(more: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        config(1, **more)
    assert isinstance(config(1), SimConfig)


def beats(clients: Clients) -> int:
    return [m.get_type() for m in clients.heard(A)].count("HEARTBEAT")


def test_a_mute_heartbeat_leaves_everything_else() -> None:
    clients = Clients(sim_parameters={"SIM_HB_MUTE": 1})
    clients.tell(0, A, HELLO)
    clients.run(0.2)
    clients.command(0, A, 511, 30, 1e5)
    clients.run(5.0)
    assert beats(clients) == 0
    assert [m.get_type() for m in clients.heard(A)].count("ATTITUDE") > 40


def test_a_part_of_the_frames_is_lost_both_ways_the_same_under_a_seed() -> None:
    def heard(loss: float, seed: int = 1) -> list[int]:
        clients = Clients(seed=seed, sim_parameters={"SIM_LOSS": loss})
        clients.run(0.2)
        clients.tell(0, A, HELLO)
        for _ in range(10):
            clients.command(0, A, 511, 30, 2e4)
        clients.run(20.0)
        return [m.get_seq() for m in clients.heard(A)]

    assert heard(100.0) == []
    whole, part = heard(0.0), heard(30.0)
    assert len(part) / len(whole) == pytest.approx(0.7, abs=0.06)
    assert part == heard(30.0)
    assert part != heard(30.0, seed=2)


def test_delayed_frames_come_late_in_order_and_all() -> None:
    clients = Clients(sim_parameters={"SIM_DELAY": 0.5})
    clients.run(0.2)
    clients.command(0, A, 176, 1, GUIDED)
    clients.run(0.4)
    firmware = clients.hub.world.vehicles[0].firmware
    assert firmware.mode.custom != GUIDED
    clients.run(0.2)
    assert firmware.mode.custom == GUIDED
    assert not clients.heard(A)
    clients.run(0.5)
    assert "COMMAND_ACK" in [m.get_type() for m in clients.heard(A)]


BRIEF = {
    "SIM_ARM_REFUSE": 1.0,
    "SIM_BATT_DRAIN": 3.0,
    "SIM_BATT_FAIL": 1.0,
    "SIM_COLL_FALL": 1.0,
    "SIM_DELAY": 0.3,
    "SIM_GPS_ACC": 4.0,
    "SIM_GPS_DRIFT": 1.0,
    "SIM_GPS_FREEZE": 1.0,
    "SIM_GPS_JUMP_D": 1.0,
    "SIM_GPS_JUMP_E": 2.0,
    "SIM_GPS_JUMP_N": 5.0,
    "SIM_GPS_NOISE": 0.5,
    "SIM_GPS_SATS": 5.0,
    "SIM_HB_MUTE": 1.0,
    "SIM_LOSS": 40.0,
    "SIM_MOTOR_STOP": 1.0,
    "SIM_VEL_NOISE": 1.5,
    "SIM_WIND_DIR": 60.0,
    "SIM_WIND_GUST": 2.0,
    "SIM_WIND_SPD": 6.0,
}
"""Faults that a hovering vehicle survives for half a second: all but those that end its flight."""


hovering_again = flown_once(hovering)


@PERSONAS
@settings(max_examples=8)
@given(names=st.sets(st.sampled_from(sorted(BRIEF)), min_size=1), for_s=st.floats(0.1, 0.6))
@example(names=set(BRIEF), for_s=0.5)
@example(names={"SIM_VEL_NOISE"}, for_s=0.5)
@example(names={"SIM_MOTOR_STOP"}, for_s=0.5)
@example(names={"SIM_GPS_FREEZE"}, for_s=0.5)
@example(names={"SIM_WIND_GUST"}, for_s=0.5)
def test_a_fault_that_has_ended_has_left_nothing(
    persona: str, names: set[str], for_s: float
) -> None:
    """The vehicle's world is as before, and the vehicle comes back to its place."""
    assert SIM_DEFAULTS.keys() - BRIEF.keys() == {"SIM_GPS_OFF", "SIM_REBOOT"}
    flight = hovering_again(persona)
    vehicle, state = flight.world.vehicles[0], flight.world.groups[persona].state
    here = flight.ned()
    put(flight, **{name: BRIEF[name] for name in names})
    flight.run(for_s)
    put(flight, **{name: SIM_DEFAULTS[name].value for name in names})
    flight.run(0.3)
    assert not state.wind.any()
    assert not state.drift.any()
    assert flight.world.groups[persona].demands.lift.all()
    assert vehicle.sense() == vehicle.truth()
    assert (vehicle.faults.active, vehicle.faults.radio) == (False, None)
    flight.run(20.0)
    assert flight.ned() == pytest.approx(here, abs=0.3)
    assert flight.world.vehicles[0].firmware.battery.failed is False
