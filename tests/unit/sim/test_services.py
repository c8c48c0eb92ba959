"""What both personas serve alike: identity, parameters, streams, time, hostile fields."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_sim.firmware.ardupilot_persona import ArdupilotPersona
from swarm_sim.firmware.message import MavResult
from swarm_sim.firmware.parameters import BYTEWISE, CAST, ParamType
from swarm_sim.firmware.protocol.telemetry import MESSAGES, readings
from swarm_sim.firmware.px4_persona import Px4Persona
from swarm_sim.firmware.streams import Streams
from tests.unit.sim.harness import (
    ARM,
    IN_AIR,
    LOCAL_ORIGIN,
    Flight,
    Rig,
    command_fields,
    config,
    setpoint_fields,
)

Persona = type[ArdupilotPersona | Px4Persona]
BOTH = pytest.mark.parametrize("persona", [ArdupilotPersona, Px4Persona])
INTERVAL, REQUEST = 511, 512


def quiet(persona: Persona) -> Rig:
    """Ready, nothing streamed but heartbeats."""
    rig = Rig(persona)
    for name in tuple(rig.firmware.streams.interval_s):
        if name != "HEARTBEAT":
            rig.firmware.streams.set(name, None, 0.0)
    rig.run(3.0)
    rig.said.clear()
    return rig


@BOTH
def test_positions_are_the_same_place_in_every_message(persona: Persona) -> None:
    rig = quiet(persona)
    rig.sensed = IN_AIR
    for number in (32, 33, 49, 242):
        assert rig.ask(REQUEST, number) == MavResult.ACCEPTED
    rig.run(0.1)
    f = rig.firmware
    (local,) = readings(f, "LOCAL_POSITION_NED")
    (where,) = readings(f, "GLOBAL_POSITION_INT")
    (origin,) = readings(f, "GPS_GLOBAL_ORIGIN")
    assert [local[k] + o for k, o in zip("xyz", LOCAL_ORIGIN, strict=True)] == list(
        IN_AIR.position_ned_m
    )
    north_m = (where["lat"] - origin["latitude"]) * 0.0111
    assert north_m == pytest.approx(local["x"], rel=0.01)
    assert (origin["altitude"] - where["alt"]) / 1000 == pytest.approx(local["z"], abs=0.01)
    assert where["relative_alt"] == 10_000


@BOTH
@pytest.mark.parametrize(
    ("p", "answer"),
    [
        ((32, 50_000.0), MavResult.ACCEPTED),
        ((32, 1_000.0), MavResult.DENIED),
        ((9999, 50_000.0), MavResult.DENIED),
        ((32, -1.0), MavResult.ACCEPTED),
        ((math.nan, 1e6), MavResult.DENIED),
        ((32, math.inf), MavResult.DENIED),
    ],
)
def test_message_intervals(persona: Persona, p: tuple[float, float], answer: MavResult) -> None:
    if answer is MavResult.DENIED and p[0] != 32 and persona is Px4Persona:
        answer = MavResult.FAILED
    assert quiet(persona).ask(INTERVAL, *p) == answer


@given(
    interval=st.floats(0.0025, 5.0), steps=st.lists(st.floats(0.001, 0.2), min_size=20, max_size=60)
)
def test_a_stream_is_never_early_and_never_bursts(interval: float, steps: list[float]) -> None:
    streams = Streams()
    streams.set("X", interval, 0.0)
    now, sent = 0.0, []
    for step in steps:
        now += step
        taken = list(streams.take_due(now))
        assert len(taken) <= 1
        sent += [now] * len(taken)
    assert len(sent) <= now / interval + 1.001
    assert streams.next_s > now - 1e-6


def test_data_streams_override_message_intervals() -> None:
    rig = quiet(ArdupilotPersona)
    rig.ask(INTERVAL, 32, 50_000.0)
    ask: dict[str, Any] = {"target_system": 1, "target_component": 1, "start_stop": 1}
    rig.tell("REQUEST_DATA_STREAM", **ask, req_stream_id=0, req_message_rate=4)
    assert rig.firmware.streams.interval_s["LOCAL_POSITION_NED"] == 0.25
    assert rig.firmware.streams.interval_s["ATTITUDE"] == 0.25
    rig.tell("REQUEST_DATA_STREAM", **ask | {"start_stop": 0}, req_stream_id=6, req_message_rate=4)
    assert rig.firmware.streams.interval_s.get("LOCAL_POSITION_NED") is None
    assert rig.firmware.streams.interval_s["ATTITUDE"] == 0.25
    assert rig.firmware.streams.interval_s["HEARTBEAT"] == 1.0


@BOTH
def test_every_message_can_be_requested_and_unknown_ones_fail(persona: Persona) -> None:
    rig = quiet(persona)
    rig.contacts.append((2, (1.0, 2.0, -3.0), (0.1, 0.2, 0.3)))
    for name, (number, _) in MESSAGES.items():
        # ArduCopter sends its estimator's zero, PX4 nothing
        there = name != "WIND_COV"
        assert rig.ask(REQUEST, number) == (MavResult.ACCEPTED if there else MavResult.FAILED)
        assert len(rig.heard(name)) == there, name
    unknown = {ArdupilotPersona: MavResult.FAILED, Px4Persona: MavResult.DENIED}[persona]
    assert rig.ask(REQUEST, 9999) == unknown


@BOTH
def test_an_interval_can_be_asked_for(persona: Persona) -> None:
    """By GET_MESSAGE_INTERVAL, of both; by REQUEST_MESSAGE, of ArduCopter."""
    rig = quiet(persona)
    rig.ask(INTERVAL, 30, 1e5)
    for number, us, found in ((30, 100_000, True), (32, -1, True), (9999, 0, False)):
        refused = {ArdupilotPersona: MavResult.FAILED, Px4Persona: MavResult.ACCEPTED}[persona]
        assert rig.ask(510, number) == (MavResult.ACCEPTED if found else refused)
        assert rig.heard("MESSAGE_INTERVAL") == [{"message_id": number, "interval_us": us}]
        if persona is ArdupilotPersona:
            assert rig.ask(REQUEST, 244, number) == (MavResult.ACCEPTED if found else refused)
            assert rig.heard("MESSAGE_INTERVAL") == [{"message_id": number, "interval_us": us}]


@BOTH
def test_a_take_off_that_is_ordered_again_goes_on(persona: Persona) -> None:
    """Each second, as by a station that waits for the height: the motors spool up once."""
    flight = Flight(config(1, "ardupilot" if persona is ArdupilotPersona else "px4"))
    flight.run(0.5)
    flight.take_off()
    up = (0.0, 0.0, 10.0) if persona is ArdupilotPersona else (math.nan, math.nan, 498.0)
    for _ in range(6):
        flight.run(1.0)
        flight.command(0, 22, 0.0, 0.0, 0.0, math.nan, *up)
    assert -flight.ned()[2] > 1.0
    flight.run(10.0)
    assert -flight.ned()[2] == pytest.approx(10.0, abs=0.5)


@BOTH
def test_traffic_is_one_message_a_vehicle(persona: Persona) -> None:
    rig = quiet(persona)
    rig.contacts += [
        (7, (10.0, 20.0, -30.0), (3.0, 4.0, -1.0)),
        (9, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ]
    rig.ask(INTERVAL, 246, 1e6)
    rig.run(0.5)
    first, second = rig.heard("ADSB_VEHICLE")
    assert (first["ICAO_address"], second["ICAO_address"]) == (7, 9)
    assert (first["hor_velocity"], first["ver_velocity"], first["heading"]) == (500, 100, 5313)


@given(value=st.integers(-(2**31), 2**31 - 1))
def test_bytewise_integers_survive_the_wire(value: int) -> None:
    (wire,) = struct.unpack("<f", struct.pack("<f", BYTEWISE.encode(ParamType.INT32, value)))
    if not math.isnan(wire):  # Python may quieten a signalling NaN; real links carry the bytes
        assert BYTEWISE.decode(ParamType.INT32, wire) == value
    assert CAST.decode(ParamType.INT16, 3.0) == 3.0


@BOTH
def test_time_sync_mirrors_the_question(persona: Persona) -> None:
    rig = quiet(persona)
    rig.tell("TIMESYNC", tc1=0, ts1=12345)
    assert rig.heard("TIMESYNC") == [{"tc1": 3_000_000_000, "ts1": 12345}]
    rig.said.clear()
    rig.tell("TIMESYNC", tc1=99, ts1=12345)
    assert not rig.said


@BOTH
def test_reboot_falls_silent_then_starts_afresh_with_its_parameters(persona: Persona) -> None:
    rig = quiet(persona)
    rig.firmware.parameters.set(
        "GUID_TIMEOUT" if persona is ArdupilotPersona else "COM_OF_LOSS_T", 0.25
    )
    assert rig.ask(246, 1) == MavResult.ACCEPTED
    rig.said.clear()
    rig.run(2.9)
    assert not rig.said
    assert rig.ask(ARM, 1) is None
    rig.run(0.2)
    assert rig.heard("HEARTBEAT")
    assert not rig.firmware.ready()
    assert (
        rig.firmware.parameters["GUID_TIMEOUT" if persona is ArdupilotPersona else "COM_OF_LOSS_T"]
        == 0.25
    )


numbers = st.floats(width=32) | st.sampled_from([math.nan, math.inf, -math.inf, 3.4e38, -3.4e38])


@BOTH
@given(data=st.data())
def test_nothing_a_command_or_setpoint_can_hold_raises(
    persona: Persona, data: st.DataObject
) -> None:
    """Every command of the tables, any parameters, in the air and on the ground; then a good one is
    served."""
    rig = quiet(persona)
    rig.ask(ARM, 1)
    if data.draw(st.booleans()):
        rig.sensed = IN_AIR
    known = st.sampled_from(sorted(rig.firmware.commands))
    for _ in range(5):
        p = data.draw(st.tuples(*[numbers] * 7))
        fields: dict[str, Any] = command_fields(data.draw(known), *p)
        if fields["command"] != 246:
            rig.tell("COMMAND_LONG", **fields)
        v = data.draw(st.tuples(numbers, numbers, numbers))
        mask, frame = data.draw(st.integers(0, 0xFFFF)), data.draw(st.integers(0, 255))
        rig.tell("SET_POSITION_TARGET_LOCAL_NED", **setpoint_fields(*v, mask=mask, frame=frame))
        rig.run(0.2)
        assert all(math.isfinite(v) for v in rig.firmware.demand.velocity_ned_mps)
    assert rig.ask(REQUEST, 0) == MavResult.ACCEPTED


@pytest.mark.parametrize(("persona", "told"), [(ArdupilotPersona, True), (Px4Persona, False)])
def test_the_fence_of_a_vehicle_that_has_none_is_told_as_the_autopilot_tells_it(
    persona: Persona, told: bool
) -> None:
    """Seen on ArduCopter 4.7-dev and PX4 1.16-dev. MAVProxy calls `fence breach` where the bit is
    not healthy, so beside a PX4, too."""
    rig = Rig(persona)
    rig.ask(512, 1.0)
    status = rig.heard("SYS_STATUS")[-1]
    fence = 0x100000
    assert bool(status["onboard_control_sensors_health"] & fence) is told
    assert bool(status["onboard_control_sensors_present"] & fence) is told
    assert not status["onboard_control_sensors_enabled"] & fence


@pytest.mark.parametrize(
    ("persona", "named"),
    [
        (ArdupilotPersona, {4: ("GUIDED", 0, 0), 9: ("LAND", 0, 0)}),
        (
            Px4Persona,
            {6 << 16: ("Offboard", 0, 1), 3 << 16: ("", 1, 0), 4 << 16 | 6 << 24: ("", 7, 1)},
        ),
    ],
)
def test_modes_that_can_be_set_have_the_names_that_are_shown(
    persona: Persona, named: dict[int, tuple[str, int, int]]
) -> None:
    """A ground station offers no other. Standard modes of PX4 go without a name, as it sends
    them."""
    rig = quiet(persona)
    assert rig.ask(REQUEST, 435, 0) == MavResult.ACCEPTED
    found = {
        each["custom_mode"]: (each["mode_name"].decode(), each["standard_mode"], each["properties"])
        for each in rig.heard("AVAILABLE_MODES")
    }
    assert found.keys() == set(persona.modes)
    assert named.items() <= found.items()
