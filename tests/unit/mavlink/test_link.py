"""The link over an in-memory wire: who is listened to, what is counted, and that nothing raises."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    Goal,
    LandGoal,
    LinkCounters,
    ReleaseGoal,
    StandbyGoal,
    YieldGoal,
)
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.link import MAX_CHUNKS, VehicleLink
from swarm_ctl.mavlink.wires import Wire, memory_wires
from tests.unit.mavlink import wire

GOALS: list[Goal] = [
    StandbyGoal(),
    AirborneGoal(3.0),
    FlyGoal((1.0, 0.0, 0.0)),
    LandGoal(),
    ReleaseGoal(),
    YieldGoal(),
]


def make(autopilot: str = "ardupilot", sysid: int = 7) -> tuple[VehicleLink, wire.Vehicle]:
    ours, theirs = memory_wires(limit=2 * MAX_CHUNKS)
    return VehicleLink(ours, autopilot, sysid), wire.Vehicle(theirs, sysid)


def healthy() -> tuple[VehicleLink, wire.Vehicle]:
    link, vehicle = make()
    vehicle.say(
        wire.heartbeat(custom_mode=4, armed=True),
        wire.local_position(),
        wire.global_position(),
        wire.global_origin(),
        wire.system_status(),
        wire.extended_state(2),
        wire.ekf_report(),
        wire.gps_raw(),
        wire.traffic(5),
        wire.text("careful"),
        wire.parameter("GUID_TIMEOUT", 0.5),
        wire.parameter("FS_GCS_ENABLE", 5.0, kind=2),
        wire.parameter("FS_GCS_TIMEOUT", 5.0),
        wire.parameter("MAV_GCS_SYSID", 250.0, kind=4),
        wire.parameter("MAV_GCS_SYSID_HI", 0.0, kind=4),
        wire.parameter("SYSID_MYGCS", 250.0, kind=4),
    )
    link.receive(10.0)
    return link, vehicle


def test_a_view_has_everything_that_was_heard() -> None:
    link, _ = healthy()
    view = link.view()
    assert (view.heartbeat_s, view.autopilot, view.fault) == (10.0, "ardupilot", "")
    assert (view.armed, view.mode, view.controlled, view.landing, view.on_ground) == (
        True,
        "GUIDED",
        True,
        False,
        False,
    )
    assert (view.healthy, view.health_reason, view.battery_percent) == (True, "", 80.0)
    assert view.local is not None
    assert view.local.time_s == 10.0
    assert view.global_ is not None
    assert view.origin is not None
    assert [contact.address for contact in view.contacts] == [5]
    assert (view.position_accuracy_m, view.estimate_fault) == (0.9, "")
    assert view.texts == ("careful",)
    assert link.view().texts == (), "each text once"


def test_refuted_heartbeats_are_told_once_in_ten_seconds() -> None:
    link, vehicle = healthy()
    texts: list[str] = []
    for tenth in range(100):
        vehicle.say(wire.heartbeat(custom_mode=9 if tenth % 2 else 4, armed=tenth % 2 == 0))
        link.receive(11.0 + 0.1 * tenth)
        view = link.view()
        assert (view.mode, view.armed) == ("GUIDED", True)
        texts += [text for text in view.texts if "heartbeat" in text]
    assert texts == [
        (
            "a heartbeat said LAND, disarmed; those after it did not, so it is ignored (1 so far):"
            " forged, or garbled on the link"
        )
    ]


@pytest.mark.parametrize(("system", "component"), [(8, 1), (7, 191), (255, 190), (0, 1)])
def test_only_the_expected_systems_autopilot_is_listened_to(system: int, component: int) -> None:
    link, vehicle = make()
    other = wire.Vehicle(vehicle.end, system, component)
    other.say(wire.heartbeat(), wire.local_position(), wire.text("boo"))
    link.receive(1.0)
    view = link.view()
    assert (view.heartbeat_s, view.local, view.texts) == (-math.inf, None, ())
    assert (link.counters.frames, link.counters.foreign) == (3, 3)


def test_lost_frames_are_counted_by_seq_over_the_wrap_but_not_late_or_repeated_ones() -> None:
    link, vehicle = make()
    frames = [vehicle.bytes_of(wire.heartbeat()) for _ in range(520)]
    for i in [*range(250), *range(253, 262), 258, 261, *range(300, 520)]:
        vehicle.end.write(frames[i])
    link.receive(1.0)
    assert link.counters.lost == 3 + 38


def test_fields_that_cannot_be_true_are_counted() -> None:
    link, vehicle = make()
    vehicle.say(wire.local_position((math.nan, 0.0, 0.0)), wire.global_position(lat=0, lon=0))
    link.receive(1.0)
    assert (link.counters.frames, link.counters.rejected, link.view().local) == (2, 2, None)


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=300), max_size=10), st.sampled_from(GOALS))
def test_hostile_bytes_raise_nothing_and_the_good_frame_after_them_is_heard(
    chunks: list[bytes], goal: Goal
) -> None:
    link, vehicle = make()
    for chunk in chunks:
        vehicle.end.write(chunk)
    vehicle.say(wire.heartbeat(custom_mode=4))
    link.receive(1.0)
    link.pursue(goal, 1.0)
    assert link.view().heartbeat_s == 1.0


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(common.mavlink_map)), st.binary(min_size=1, max_size=255)),
        max_size=20,
    ),
    st.sampled_from(GOALS),
)
def test_well_framed_nonsense_from_the_vehicle_itself_raises_nothing(
    bodies: list[tuple[int, bytes]], goal: Goal
) -> None:
    link, vehicle = healthy()
    for number, payload in bodies:
        header = bytes([0xFD, len(payload), 0, 0, 0, 7, 1]) + number.to_bytes(3, "little")
        crc = common.x25crc(
            header[1:] + payload + bytes([common.mavlink_map[number].crc_extra])
        ).crc
        vehicle.end.write(header + payload + crc.to_bytes(2, "little"))
    link.receive(11.0)
    link.pursue(goal, 11.0)
    link.view()
    assert link.counters.frames == 16 + len(bodies), "the frames were good"


def test_a_flood_is_read_in_bounded_portions() -> None:
    link, vehicle = make()
    vehicle.say(*[wire.heartbeat()] * (MAX_CHUNKS + 10))
    link.receive(1.0)
    assert link.counters.frames == MAX_CHUNKS
    link.receive(1.1)
    assert link.counters.frames == MAX_CHUNKS + 10


class BrokenWire(Wire):
    """Every call fails as a socket may."""

    def read(self, now: float) -> bytes | None:
        raise ConnectionRefusedError

    def write(self, data: bytes, now: float, system: int = 0) -> None:
        raise BlockingIOError

    def confirm(self, system: int = 0, *, proven: bool = False) -> None:
        pass

    def close(self) -> None:
        pass


def test_socket_errors_are_counted_not_raised() -> None:
    link = VehicleLink(BrokenWire(), "px4", 1)
    for tick in range(3):
        link.receive(float(tick))
        link.pursue(StandbyGoal(), float(tick))
    assert link.counters == LinkCounters(errors=6)


@pytest.mark.parametrize("sysid", [0, 251, -1])
def test_a_sysid_out_of_range_is_refused(sysid: int) -> None:
    with pytest.raises(LinkError, match=r"allowed: 1\.\.250"):
        VehicleLink(memory_wires()[0], "px4", sysid)


@pytest.mark.parametrize("agent_sysid", [0, 255, 7])
def test_an_agent_does_not_speak_as_its_vehicle_or_a_ground_station(agent_sysid: int) -> None:
    with pytest.raises(LinkError, match=r"allowed: 1\.\.254, and not the vehicle's sysid"):
        VehicleLink(memory_wires()[0], "px4", 7, agent_sysid=agent_sysid)


def test_a_charge_that_is_told_no_more_is_unknown_and_said_once() -> None:
    """99 % was told to the end of the flight, so `battery_low` could not act."""
    link, vehicle = healthy()
    assert link.view().battery_percent == 80.0
    said: list[str] = []
    for now in range(11, 60):
        vehicle.say(
            wire.heartbeat(custom_mode=4, armed=True),
            wire.system_status(battery_percent=80 if now % 20 == 0 else -1),
        )
        link.receive(float(now))
        view = link.view()
        assert view.battery_percent == (80.0 if now % 20 == 0 else None)
        said += view.texts
    (text,) = said
    assert text.startswith("does not say its charge any more (last 80 %)")
