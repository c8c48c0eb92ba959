"""The swarm in ROS 2's messages, as two readers by others see it: Foxglove's, from a message's
definition in words, and that of ros2-pyterfaces, on Cyclone DDS with definitions of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra `ros2` is not installed")

from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.extensions.ros2.messages import (
    diagnostics,
    fix,
    markers,
    odometry,
    pose,
    time_of,
    transforms,
)
from swarm_ctl.extensions.ros2.rmw import cdr, type_of
from swarm_ctl.station.picture.alarms import Level, alarms
from tests.unit.station.pictures import PICTURES
from tests.unit.station.swarm import hexagon_plan, state_of

PLAN = hexagon_plan()
AT = time_of(1_700_000_000_250_000_000)
STORE = get_typestore(Stores.ROS2_JAZZY)
METRES = st.floats(-1e5, 1e5)


def read_by_foxglove(message: Any) -> Any:
    dynamic = pytest.importorskip("mcap_ros2._dynamic")
    name = type_of(message).name
    text, _ = STORE.generate_msgdef(name, ros_version=2)
    return dynamic.generate_dynamic(name, text)[name](cdr(message))


def read_by_cyclone(message: Any) -> Any:
    package, _, kind = type_of(message).name.split("/")
    theirs = pytest.importorskip(f"ros2_pyterfaces.cyclone.{package}.msg")
    return getattr(theirs, kind).deserialize(cdr(message))


READERS = pytest.mark.parametrize("read", [read_by_foxglove, read_by_cyclone])
Read = Callable[[Any], Any]


def xyz(of: Any) -> tuple[float, float, float]:
    return of.x, of.y, of.z


@READERS
@given(position=st.tuples(METRES, METRES, METRES), velocity=st.tuples(METRES, METRES, METRES))
def test_a_state_is_a_pose_and_an_odometry_in_east_north_up(
    read: Read, position: tuple[float, ...], velocity: tuple[float, ...]
) -> None:
    state = replace(state_of(PLAN, 3, 5.0), position_ned_m=position, velocity_ned_mps=velocity)
    (north, east, down), (vn, ve, vd) = position, velocity
    told = read(pose(state, AT))
    assert (told.header.frame_id, told.header.stamp.sec) == ("map", 1_700_000_000)
    assert told.header.stamp.nanosec == 250_000_000
    assert xyz(told.pose.position) == (east, north, -down)
    assert (*xyz(told.pose.orientation), told.pose.orientation.w) == (0, 0, 0, 1)
    odom = read(odometry(state, 0.5, AT))
    assert (odom.header.frame_id, odom.child_frame_id) == ("map", "drone_3")
    assert xyz(odom.pose.pose.position) == (east, north, -down)
    assert xyz(odom.twist.twist.linear) == (ve, vn, -vd)
    diagonal = [odom.pose.covariance[7 * k] for k in range(6)]
    assert diagonal == pytest.approx([0.25] * 3 + [math.pi**2] * 3)
    assert sum(odom.pose.covariance) == pytest.approx(sum(diagonal))
    assert not any(read(odometry(state, None, AT)).pose.covariance)


@READERS
def test_a_fix_is_where_the_drone_is_and_has_no_height(read: Read) -> None:
    state = state_of(PLAN, 3, 5.0)
    told = read(fix(state, 0.5, PLAN.origin, AT))
    assert told.header.frame_id == "drone_3"
    assert (told.status.status, told.status.service) == (0, 1)
    place = Geodetic(told.latitude, told.longitude, PLAN.origin.alt_m - state.position_ned_m[2])
    found = ned_from_geodetic(place, PLAN.origin)
    assert found == pytest.approx(state.position_ned_m, abs=1e-2)
    assert math.isnan(told.altitude)
    assert [*told.position_covariance] == [0.25, 0, 0, 0, 0.25, 0, 0, 0, 0.25]
    assert told.position_covariance_type == 1
    assert read(fix(state, None, PLAN.origin, AT)).position_covariance_type == 0


def test_transforms_lead_from_the_map_to_each_drone() -> None:
    """By one reader alone: the other one has no tf2_msgs."""
    states = [state_of(PLAN, agent.id, 5.0) for agent in PLAN.agents]
    told = read_by_foxglove(transforms((state, AT) for state in states))
    assert [each.child_frame_id for each in told.transforms] == [f"drone_{k}" for k in range(1, 7)]
    for each, state in zip(told.transforms, states, strict=True):
        north, east, down = state.position_ned_m
        assert each.header.frame_id == "map"
        assert xyz(each.transform.translation) == (east, north, -down)
        assert each.transform.rotation.w == 1.0


@pytest.mark.parametrize("unix_ns", [-1, 0, 2**31 * 10**9, 2**63 - 1])
def test_no_time_is_too_far_for_a_message(unix_ns: int) -> None:
    made = time_of(unix_ns)
    assert 0 <= made.sec < 2**31
    assert 0 <= made.nanosec < 10**9


@READERS
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_is_drawn(read: Read, name: str) -> None:
    """Each drone that was heard once, with its name and its disc; no two markers of one name and
    number, none without a size or a colour, none that stays for ever."""
    view = PICTURES[name]()
    told = read(markers(view, AT, 2.5, [agent.id for agent in view.agents])).markers
    kinds = [(each.ns, each.id) for each in told]
    assert len(set(kinds)) == len(kinds)
    heard = {agent.id for agent in view.agents if agent.state is not None}
    for kind in ("drones", "names", "keep_out"):
        assert {number for ns, number in kinds if ns == kind} == heard
    assert all(each.scale.x > 0 or each.scale.z > 0 for each in told)
    assert all(each.color.a > 0 for each in told)
    assert all((each.lifetime.sec, each.lifetime.nanosec) == (2, 500_000_000) for each in told)
    assert all(each.header.frame_id == "map" and each.action == 0 for each in told)
    lines = [each for each in told if each.type in (4, 5)]
    assert all(len(each.points) > 1 for each in lines)
    text = [each for each in told if each.type == 9]
    assert all(each.text for each in text)
    assert ("zones" in dict(kinds)) == bool(view.zones)
    assert sum(ns == "targets" for ns, _ in kinds) == 2 * len(view.targets)


@READERS
@pytest.mark.parametrize("name", PICTURES)
def test_every_alarm_is_a_diagnosis(read: Read, name: str) -> None:
    """Of each drone that it is about, or of the swarm; the level is the worst one's."""
    view = PICTURES[name]()
    told = read(diagnostics(view, AT))
    names = [each.name for each in told.status]
    assert names == ["swarm_ctl: swarm", *(f"swarm_ctl: drone {a.id}" for a in view.agents)]
    found = {each.hardware_id: each for each in told.status}
    for alarm in alarms(view):
        of = [f"drone_{agent}" for agent in alarm.agents] or [view.plan.name]
        for each in of:
            assert alarm.words in found[each].message
            assert level(found[each]) >= {Level.WARNING: 1, Level.ERROR: 2}[alarm.level]
    for agent in view.agents:
        own = [alarm for alarm in alarms(view) if agent.id in alarm.agents]
        stale = agent.lost or agent.phase is None
        assert (level(found[f"drone_{agent.id}"]) == 0) == (not own and not stale)
        assert (level(found[f"drone_{agent.id}"]) == 3) == stale
    pairs = {pair.key: pair.value for each in told.status for pair in each.values}
    assert pairs["mission"] == view.plan.name
    assert all(pairs.values())


def level(told: Any) -> int:
    """A `byte`, which one of the readers gives as such."""
    return told.level if isinstance(told.level, int) else told.level[0]
