"""Both drivers against scripted vehicles, on a virtual clock: sequences, retries, loss, a pilot who
takes over."""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    YieldGoal,
)
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.autopilots import AUTOPILOTS, GUARDED, autopilot
from swarm_ctl.mavlink.autopilots.failsafe_parameters import OPTIONAL_ASKS
from swarm_ctl.mavlink.autopilots.timing import GROUNDED_S
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry
from tests.unit.mavlink import scripted, wire
from tests.unit.mavlink.scripted import Scripted, ScriptedArdupilot, ScriptedPx4

SCRIPTED = {"ardupilot": ScriptedArdupilot, "px4": ScriptedPx4}
CONTROLLED = {"ardupilot": wire.GUIDED, "px4": scripted.OFFBOARD}
PILOT = {"ardupilot": 5, "px4": scripted.POSCTL}  # LOITER, POSCTL
ARM, TAKE_OFF, MODE = 400, 22, 176

both = pytest.mark.parametrize("name", AUTOPILOTS)


def make(name: str, **how: Any) -> Scripted:
    return SCRIPTED[name](autopilot(name, 7), **how)


def commands(sent: list[tuple[float, Any]], number: int) -> list[tuple[float, Any]]:
    return [(t, m) for t, m in sent if m.msgname == "COMMAND_LONG" and m.command == number]


def of(sent: list[tuple[float, Any]], name: str) -> list[tuple[float, Any]]:
    return [(t, m) for t, m in sent if m.msgname == name]


def missing(vehicle: Scripted) -> str:
    return vehicle.driver.missing(vehicle.heard, vehicle.now)


def airborne(name: str, **how: Any) -> Scripted:
    vehicle = make(name, **how)
    vehicle.run(StandbyGoal(), 6.0)
    vehicle.run(AirborneGoal(3.0), 20.0)
    assert vehicle.height_m == pytest.approx(3.0, abs=0.1)
    return vehicle


def flying(name: str, **how: Any) -> Scripted:
    vehicle = airborne(name, **how)
    vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 6.0)
    assert vehicle.mode == CONTROLLED[name]
    return vehicle


# --- the whole way ---


@both
@settings(max_examples=8, deadline=None)  # a quarter of a second each
@given(
    loss=st.sampled_from([0.0, 0.2, 0.5]),
    seed=st.integers(0, 10_000),
    ready_s=st.sampled_from([0.0, 42.0]),
)
def test_every_goal_is_reached_through_loss_and_a_slow_start(
    name: str, loss: float, seed: int, ready_s: float
) -> None:
    vehicle = make(name, ready_s=ready_s, loss=loss, seed=seed)
    before = dict(vehicle.parameters)
    vehicle.run(StandbyGoal(), ready_s + 60.0)
    assert missing(vehicle) in (
        "",
        "heartbeat lost",
        "no SYS_STATUS",
        "no local position (LOCAL_POSITION_NED)",
        "whether it stands on the ground is unknown (EXTENDED_SYS_STATE)",
    )  # a run of losses
    assert not vehicle.armed
    vehicle.run(AirborneGoal(3.0), 60.0)
    if loss < 0.5:
        assert vehicle.height_m == pytest.approx(3.0, abs=0.3)
    # at half lost, PX4 may miss a second of setpoints: it lands, and is sent up again
    for _ in range(12):
        vehicle.run(AirborneGoal(3.0), 5.0 if abs(vehicle.height_m - 3.0) > 0.3 else 0.0)
    assert vehicle.height_m == pytest.approx(3.0, abs=0.3)
    vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 20.0)
    assert vehicle.mode == CONTROLLED[name] or loss == 0.5
    vehicle.run(LandGoal(), 60.0)
    assert (vehicle.armed, vehicle.height_m) == (False, 0.0)
    vehicle.run(ReleaseGoal(), 60.0)
    assert vehicle.parameters == before
    assert vehicle.driver.parameters.released(vehicle.heard)


# --- standby: streams, parameters, health ---


OURS = {
    "ardupilot": {"GUID_TIMEOUT": 0.5, "SYSID_MYGCS": 250, "FS_GCS_ENABLE": 5.0},
    "px4": {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": struct.unpack("<f", struct.pack("<i", 4))[0]},
}


@both
def test_our_failsafe_parameters_are_set_in_the_firmwares_encoding_and_put_back(name: str) -> None:
    vehicle = make(name)
    before = dict(vehicle.parameters)
    sent = vehicle.run(StandbyGoal(), 6.0)
    own = {key: value for key, (value, _) in before.items() if key not in OURS[name]}
    assert {key: value for key, (value, _) in vehicle.parameters.items()} == OURS[name] | own
    assert len(of(sent, "PARAM_SET")) == len(OURS[name]), "each once: PARAM_VALUE confirmed it"
    assert not vehicle.driver.parameters.released(vehicle.heard)
    sent = vehicle.run(ReleaseGoal(), 6.0)
    assert vehicle.parameters == before
    assert len(of(sent, "PARAM_SET")) == len(OURS[name])
    assert vehicle.driver.parameters.released(vehicle.heard)


@both
def test_the_parameters_of_a_vehicle_that_a_pilot_flies_are_left_alone(name: str) -> None:
    vehicle = make(name)
    vehicle.armed, vehicle.height_m, vehicle.mode = True, 5.0, PILOT[name]
    assert of(vehicle.run(StandbyGoal(), 10.0), "PARAM_SET") == []
    assert missing(vehicle).startswith("failsafe parameters not confirmed")
    assert vehicle.driver.parameters.released(vehicle.heard)


@both
def test_parameters_are_not_put_back_while_armed(name: str) -> None:
    vehicle = flying(name)
    assert of(vehicle.run(ReleaseGoal(), 2.0), "PARAM_SET") == []
    assert vehicle.armed
    assert not vehicle.driver.parameters.released(vehicle.heard)


GCS_IDS = {
    "4.1": {"SYSID_MYGCS": (255.0, 4)},
    "4.6": {"SYSID_MYGCS": (255.0, 4), "FS_GCS_TIMEOUT": (30.0, 9)},
    "4.7": {"MAV_GCS_SYSID": (255.0, 4), "FS_GCS_TIMEOUT": (5.0, 9)},
    "a range": {"MAV_GCS_SYSID": (250.0, 4), "MAV_GCS_SYSID_HI": (255.0, 4)},
    "impatient": {"MAV_GCS_SYSID": (7.0, 4), "FS_GCS_TIMEOUT": (3.0, 9)},
}


@pytest.mark.parametrize("version", GCS_IDS)
def test_only_our_heartbeats_count_for_an_arducopter_of_each_version(version: str) -> None:
    """Whichever parameters it has, a ground station's id keeps no dead agent's vehicle up, and it
    lands 5 s after our last heartbeat at the latest; afterwards all are its own again."""
    vehicle = ScriptedArdupilot(autopilot("ardupilot", 7, 249))
    del vehicle.parameters["SYSID_MYGCS"]
    vehicle.parameters |= GCS_IDS[version]
    before = dict(vehicle.parameters)
    vehicle.run(StandbyGoal(), 4.0)
    assert missing(vehicle) == ""
    now = {name: value for name, (value, _) in vehicle.parameters.items()}
    assert now.get("MAV_GCS_SYSID", now.get("SYSID_MYGCS")) == 249
    assert now.get("MAV_GCS_SYSID_HI", 0.0) <= 249
    assert now.get("FS_GCS_TIMEOUT", 5.0) == min(5.0, before.get("FS_GCS_TIMEOUT", (5.0, 9))[0])
    vehicle.run(ReleaseGoal(), 3.0)
    assert vehicle.parameters == before


def test_an_arducopter_that_does_not_tell_whose_heartbeats_count_is_not_flown() -> None:
    vehicle = make("ardupilot")
    del vehicle.parameters["SYSID_MYGCS"]
    sent = vehicle.run(StandbyGoal(), 30.0)
    assert missing(vehicle) == "failsafe parameters not confirmed: MAV_GCS_SYSID, SYSID_MYGCS"
    asked = [m.param_id for _, m in of(sent, "PARAM_REQUEST_READ")]
    assert asked.count("SYSID_MYGCS") > 20, "one that has not answered may do so later"
    assert asked.count("FS_GCS_TIMEOUT") == OPTIONAL_ASKS, "one that is not needed does not exist"


def test_a_parameter_that_is_changed_back_is_set_again() -> None:
    vehicle = make("ardupilot")
    vehicle.run(StandbyGoal(), 5.0)
    vehicle.parameters["GUID_TIMEOUT"] = (3.0, 9)
    vehicle.say(wire.parameter("GUID_TIMEOUT", 3.0))
    assert missing(vehicle) == "failsafe parameters not confirmed: GUID_TIMEOUT"
    vehicle.run(StandbyGoal(), 3.0)
    assert missing(vehicle) == ""
    assert vehicle.driver.parameters.own["GUID_TIMEOUT"].own == 3.0


@both
def test_health_names_what_is_missing(name: str) -> None:
    vehicle = make(name)
    driver, heard = vehicle.driver, vehicle.heard
    assert missing(vehicle) == "no heartbeat yet from sysid 7"
    heard.stranger = 9
    assert missing(vehicle) == "no heartbeat yet from sysid 7 (heard sysid 9 instead)"
    vehicle.run(StandbyGoal(), 6.0)
    assert missing(vehicle) == ""
    later = vehicle.now + 1.2
    assert driver.missing(heard, later) == "no local position (LOCAL_POSITION_NED)"
    assert driver.missing(heard, vehicle.now + 4.0) == "heartbeat lost"
    for status, reason in (
        (wire.system_status(health=0), "pre-arm checks not passed"),
        (
            wire.system_status(present=0x2F, enabled=0x2F, health=0x0B),
            "pre-arm checks not passed: compass, GPS",
        ),
    ):
        vehicle.say(status)
        assert missing(vehicle).startswith(reason)
    vehicle.say(wire.system_status())
    for field, reason in (("origin", "GPS_GLOBAL_ORIGIN"), ("global_", "GLOBAL_POSITION_INT")):
        kept = getattr(heard, field)
        setattr(heard, field, None)
        assert reason in missing(vehicle)
        setattr(heard, field, kept)
    heard.estimate.report_s = -math.inf
    assert missing(vehicle) == f"no {driver.estimate_rules.message}"
    heard.system_status_s = -math.inf
    assert missing(vehicle) == "no SYS_STATUS"


@pytest.mark.parametrize(("name", "healthy"), [("ardupilot", False), ("px4", True)])
def test_prearm_bit_alone_is_enough_for_px4_only(name: str, healthy: bool) -> None:
    """PX4 sets the health bit without present and enabled; ArduPilot without them has its checks
    switched off."""
    for present in (0, wire.PREARM):
        heard = Telemetry(sensors_present=present, sensors_health=wire.PREARM)
        assert autopilot(name, 7).prearm(heard) is healthy


# --- faults ---


def test_an_unknown_name_is_refused_with_what_is_allowed() -> None:
    with pytest.raises(LinkError, match="'betaflight' does not exist; allowed: ardupilot, px4"):
        autopilot("betaflight", 1)


@pytest.mark.parametrize(
    ("heartbeat", "says"),
    [
        (wire.heartbeat(autopilot=12), "autopilot px4 (12); allowed here: ardupilot (3)"),
        (wire.heartbeat(autopilot=8), "autopilot invalid (8)"),
        (wire.heartbeat(autopilot=200), "autopilot unknown (200)"),
        (wire.heartbeat(kind=1), "type fixed_wing (1); allowed: quadrotor (2)"),
    ],
)
def test_another_firmware_or_kind_of_vehicle_gets_nothing_but_heartbeats(
    heartbeat: Any, says: str
) -> None:
    driver, heard = autopilot("ardupilot", 7), Telemetry()
    Scripted.say.__get__(vehicle := make("ardupilot"))(heartbeat)
    heard = vehicle.heard
    assert says in driver.fault(heard)
    for goal in (
        StandbyGoal(),
        AirborneGoal(3.0),
        FlyGoal((1.0, 0.0, 0.0)),
        LandGoal(),
        ReleaseGoal(),
    ):
        assert {m.msgname for m in driver.pursue(goal, heard, 1.0)} <= {"HEARTBEAT"}


def test_a_take_off_that_was_accepted_is_not_asked_for_again_while_motors_spool_up() -> None:
    vehicle = make("ardupilot", spool_up_s=5.0)
    vehicle.run(StandbyGoal(), 6.0)
    assert len(commands(vehicle.run(AirborneGoal(3.0), 20.0), TAKE_OFF)) == 1
    assert vehicle.height_m == pytest.approx(3.0, abs=0.1)
    assert not [text for text in vehicle.heard.texts.take(vehicle.now) if "refused" in text]


# --- airborne ---


def test_a_vehicle_that_is_silent_is_not_told_to_take_off_again() -> None:
    vehicle = make("ardupilot", spool_up_s=1.0)
    vehicle.run(StandbyGoal(), 6.0)
    vehicle.run(AirborneGoal(30.0), 3.0)
    say, vehicle.say = vehicle.say, lambda message: None  # type: ignore[method-assign]
    sent = vehicle.run(AirborneGoal(30.0), 15.0)
    vehicle.say = say  # type: ignore[method-assign]
    sent += vehicle.run(AirborneGoal(30.0), 20.0)
    assert commands(sent, TAKE_OFF) == [], "a second one would restart the climb"
    assert vehicle.height_m == pytest.approx(30.0, abs=0.1)


def test_a_take_off_that_had_no_effect_is_asked_for_again() -> None:
    vehicle = make("ardupilot", spool_up_s=math.inf)
    vehicle.run(StandbyGoal(), 6.0)
    times = [t for t, _ in commands(vehicle.run(AirborneGoal(3.0), 32.0), TAKE_OFF)]
    assert [b - a for a, b in pairwise(times)] == pytest.approx([10.0] * 3)


def test_a_px4_that_has_flown_is_ready_for_another_flight() -> None:
    """A PX4 goes back to OFFBOARD when it disarms, and its pre-arm checks fail there."""
    vehicle = flying("px4")
    vehicle.run(LandGoal(), 6.0)
    assert (vehicle.armed, vehicle.mode) == (False, scripted.OFFBOARD)
    vehicle.run(ReleaseGoal(), 2.0)
    assert vehicle.mode == scripted.LOITER, "the next one, ours or not, finds it ready"
    vehicle.mode = scripted.OFFBOARD  # as an agent leaves it that was killed
    vehicle.run(StandbyGoal(), 1.0)
    vehicle.run(StandbyGoal(), 4.0)
    assert (missing(vehicle), vehicle.mode) == ("", scripted.LOITER)


def test_a_px4_in_a_pilots_mode_is_left_there_while_it_stands_by() -> None:
    vehicle = make("px4")
    vehicle.mode = PILOT["px4"]
    assert commands(vehicle.run(StandbyGoal(), 10.0), MODE) == []


def test_px4_climbs_only_while_its_height_is_known() -> None:
    vehicle = make("px4")
    vehicle.run(StandbyGoal(), 6.0)
    vehicle.run(AirborneGoal(30.0), 8.0)
    say, vehicle.say = vehicle.say, lambda message: None  # type: ignore[method-assign]
    vehicle.run(AirborneGoal(30.0), 1.1)
    silent = vehicle.run(AirborneGoal(30.0), 5.0)
    assert {m.vz for _, m in of(silent, "SET_POSITION_TARGET_LOCAL_NED")} == {0.0}
    vehicle.say = say  # type: ignore[method-assign]
    vehicle.run(AirborneGoal(30.0), 40.0)
    assert vehicle.height_m == pytest.approx(30.0, abs=0.1)


@both
@pytest.mark.parametrize("when_s", [0.0, 1.5, 2.5, 4.0, 6.0])
def test_a_pilot_who_takes_over_on_the_way_up_keeps_the_vehicle(name: str, when_s: float) -> None:
    vehicle = make(name)
    vehicle.run(StandbyGoal(), 6.0)
    vehicle.run(AirborneGoal(3.0), 1.5 + when_s)
    vehicle.mode = PILOT[name]
    vehicle.run(AirborneGoal(3.0), 1.05)  # until its heartbeat has said so
    sent = vehicle.run(AirborneGoal(3.0), 10.0)
    assert commands(sent, MODE) == commands(sent, ARM) == commands(sent, TAKE_OFF) == []


@both
@pytest.mark.parametrize(("armed", "height_m"), [(True, 0.0), (True, 5.0), (False, 5.0)])
def test_a_vehicle_in_a_pilots_hands_is_not_taken(name: str, armed: bool, height_m: float) -> None:
    vehicle = make(name)
    vehicle.run(StandbyGoal(), 6.0)
    vehicle.mode, vehicle.armed, vehicle.height_m = PILOT[name], armed, height_m
    vehicle.run(StandbyGoal(), 1.05)
    sent = vehicle.run(AirborneGoal(3.0), 10.0)
    assert commands(sent, MODE) == commands(sent, ARM) == commands(sent, TAKE_OFF) == []


# --- fly ---


@both
@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e39, -101.0])
def test_a_setpoint_that_is_none_is_not_sent(name: str, bad: float) -> None:
    vehicle = flying(name)
    assert of(vehicle.run(FlyGoal((0.0, bad, 0.0)), 0.5), "SET_POSITION_TARGET_LOCAL_NED") == []


def test_px4_begins_the_second_anew_after_a_gap() -> None:
    vehicle = make("px4")
    vehicle.run(StandbyGoal(), 6.0)
    vehicle.run(AirborneGoal(3.0), 1.0)
    vehicle.run(YieldGoal(), 1.0)
    start = vehicle.now
    asked = commands(vehicle.run(AirborneGoal(3.0), 4.0), MODE)[0][0]
    assert asked - start == pytest.approx(1.2, abs=0.06)


@both
def test_a_controlled_mode_that_was_left_is_never_entered_again(name: str) -> None:
    vehicle = flying(name)
    vehicle.mode = PILOT[name]
    doubting = vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 2.3)
    assert commands(doubting, MODE) == []
    sent = vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 10.0)
    assert commands(sent, MODE) == of(sent, "SET_POSITION_TARGET_LOCAL_NED") == []
    vehicle.mode = scripted.LOITER if name == "px4" else 17
    assert commands(vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 10.0), MODE) == []


def test_px4_that_lost_the_stream_is_left_to_its_failsafe() -> None:
    vehicle = flying("px4")
    for _ in range(25):
        vehicle.tick([])
    assert vehicle.mode == scripted.AUTO_LAND
    vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 1.05)
    assert commands(vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 5.0), MODE) == []


# --- down, and hands off ---


@both
def test_what_stays_armed_on_the_ground_is_disarmed_after_a_while(name: str) -> None:
    vehicle = flying(name)
    vehicle.run(LandGoal(), 1.5)
    vehicle.height_m = 0.0
    vehicle.armed = True
    vehicle.move = lambda: None  # type: ignore[method-assign]  # the autopilot's own disarming is broken
    start = vehicle.now
    sent = vehicle.run(LandGoal(), GROUNDED_S + 3.0)
    assert not vehicle.armed
    ((first, message), *_) = commands(sent, ARM)
    assert (message.param1, message.param2) == (0.0, 0.0), "never by force"
    assert GROUNDED_S <= first - start <= GROUNDED_S + 1.0


@both
@pytest.mark.parametrize("lands", [True, False])
def test_an_agent_that_yields_disarms_what_has_landed_by_itself(name: str, lands: bool) -> None:
    """In the landing mode; in a pilot's mode an armed vehicle on the ground is the pilot's."""
    vehicle = flying(name)
    vehicle.run(LandGoal(), 1.5)
    vehicle.mode = vehicle.mode if lands else PILOT[name]
    vehicle.height_m, vehicle.armed = 0.0, True
    vehicle.move = lambda: None  # type: ignore[method-assign]  # the autopilot's own disarming is broken
    sent = vehicle.run(YieldGoal(), GROUNDED_S + 5.0)
    asked = [(message.param1, message.param2) for _, message in commands(sent, ARM)]
    assert asked == [(0.0, 0.0)] * lands, "never by force"
    assert vehicle.armed is not lands


@both
def test_a_vehicle_on_the_ground_for_a_moment_only_is_not_disarmed(name: str) -> None:
    vehicle = flying(name)
    vehicle.run(LandGoal(), 1.5)
    sent = []
    for _ in range(4):
        for state in (1, 2):
            vehicle.say_stream = lambda name: None  # type: ignore[method-assign]
            vehicle.height_m, vehicle.armed = 5.0, True
            vehicle.say(wire.extended_state(state))
            sent += vehicle.run(LandGoal(), 3.0)
    assert commands(sent, ARM) == []


@both
def test_a_vehicle_that_does_not_take_the_landing_mode_is_stopped(name: str) -> None:
    """Before it is asked again: its last velocity stays in force for none of the time."""
    vehicle = flying(name)
    vehicle.do_176 = lambda message: 1  # type: ignore[attr-defined]
    sent = vehicle.run(LandGoal(), 3.0)
    told = [m for _, m in of(sent, "SET_POSITION_TARGET_LOCAL_NED")]
    assert len(told) > 2 * len(commands(sent, MODE)) > 0
    assert {(m.vx, m.vy, m.vz) for m in told} == {(0.0, 0.0, 0.0)}


@both
def test_a_pilot_who_breaks_a_landing_off_keeps_the_vehicle(name: str) -> None:
    vehicle = flying(name)
    vehicle.run(LandGoal(), 1.5)
    vehicle.mode = PILOT[name]
    sent = vehicle.run(LandGoal(), 6.0)
    assert commands(sent, MODE) == of(sent, "SET_POSITION_TARGET_LOCAL_NED") == []


@both
def test_yield_asks_for_nothing(name: str) -> None:
    """Heartbeats; a PX4 gets setpoints of zero, too: without any its pilot can't set OFFBOARD."""
    vehicle = flying(name)
    sent = vehicle.run(YieldGoal(), 10.0)
    setpoints = [m for _, m in sent if m.msgname == "SET_POSITION_TARGET_LOCAL_NED"]
    assert {m.msgname for _, m in sent} - {"SET_POSITION_TARGET_LOCAL_NED"} == {"HEARTBEAT"}
    assert bool(setpoints) is (name == "px4")
    assert {(m.vx, m.vy, m.vz) for m in setpoints} <= {(0.0, 0.0, 0.0)}


# --- failsafe parameters in flight ---

CHANGED = {"ardupilot": ("FS_GCS_ENABLE", 0.0), "px4": ("COM_OF_LOSS_T", 60.0)}


@both
@pytest.mark.parametrize("told", [True, False])
def test_a_failsafe_parameter_that_is_changed_in_flight_is_set_again(name: str, told: bool) -> None:
    """With FS_GCS_ENABLE 0 the vehicle of an agent that dies hovers for ever. A vehicle need not
    tell the agent's link of a change: then it is read again."""
    vehicle = flying(name)
    parameter, value = CHANGED[name]
    before, own = vehicle.parameters[parameter], vehicle.driver.parameters.own[parameter]
    vehicle.parameters[parameter] = (value, before[1])
    if told:
        vehicle.say(wire.parameter(parameter, value, before[1]))
    for _ in range(1 if told else 14):
        vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 1.0)
        if vehicle.parameters[parameter] == before:
            break
    assert vehicle.parameters[parameter] == before
    said = vehicle.heard.texts.take(vehicle.now)
    assert [text for text in said if "changed in flight" in text] == [
        f"changed in flight: {parameter} is {value:g}, allowed: {before[0]:g}; set again"
    ]
    assert parameter in vehicle.driver.parameters.unsafe(vehicle.now)
    vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 12.0)
    assert vehicle.driver.parameters.unsafe(vehicle.now) == ""
    assert vehicle.driver.parameters.own[parameter] == own, "it gets its own back"


@both
def test_the_watch_costs_a_read_in_two_seconds_and_no_set(name: str) -> None:
    """A slow radio has room for it (`budget`)."""
    vehicle = flying(name)
    sent = vehicle.run(FlyGoal((1.0, 0.0, 0.0)), 20.0)
    assert len(of(sent, "PARAM_REQUEST_READ")) in range(9, 12)
    assert of(sent, "PARAM_SET") == []


@both
def test_a_pilot_who_flies_the_vehicle_may_change_its_parameters(name: str) -> None:
    vehicle = flying(name)
    vehicle.mode = PILOT[name]
    vehicle.run(YieldGoal(), 5.0)
    parameter, value = CHANGED[name]
    kind = vehicle.parameters[parameter][1]
    vehicle.parameters[parameter] = (value, kind)
    vehicle.say(wire.parameter(parameter, value, kind))
    assert of(vehicle.run(YieldGoal(), 10.0), "PARAM_SET") == []


@both
def test_what_a_ground_station_may_not_set_has_all_that_we_set(name: str) -> None:
    assert autopilot(name, 7).parameters.names <= GUARDED
