"""The swarm in ROS 2's messages. Pure.

As REP 103 and 105 have it: metres, east-north-up, in the frame `map`, whose origin is the
mission's. Each drone has a frame `drone_N`. What the swarm does not tell is said to be unknown, not
made up: of a drone's rotation nothing is known here, so its frame has the axes of `map`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Duration as Duration
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticStatus as Diagnosis
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__KeyValue as KeyValue
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point3
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__PoseWithCovariance as CovaryingPose,
)
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Quaternion as Quaternion
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Transform as Transform
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__TransformStamped as StampedTransform,
)
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Twist as Twist
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__TwistWithCovariance as CovaryingTwist,
)
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Odometry as Odometry
from rosbags.typesys.stores.ros2_jazzy import rosgraph_msgs__msg__Clock as Clock
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__CompressedImage as Image
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__NavSatFix as NavSatFix
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__NavSatStatus as NavSatStatus
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__ColorRGBA as Color
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
from rosbags.typesys.stores.ros2_jazzy import tf2_msgs__msg__TFMessage as Transforms
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__Marker as Marker
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MeshFile as MeshFile

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Vector3 as Ned
from swarm_ctl.station.picture.alarms import Alarm, Level, alarms
from swarm_ctl.station.picture.view import AgentView, SwarmView

MAP: Final = "map"
NANO: Final = 1_000_000_000
_LAST_S: Final = 2**31 - 1
_NO_TURN: Final = Quaternion(0.0, 0.0, 0.0, 1.0)
_ANY_TURN: Final = math.pi**2
"""The variance [rad^2] of an angle of which nothing is known."""
_OK, _WARN, _ERROR, _STALE = range(4)
_LEVELS: Final = {Level.WELL: _OK, Level.WAITING: _OK, Level.WARNING: _WARN, Level.ERROR: _ERROR}
_CYAN: Final = Color(0.1, 0.55, 0.95, 1.0)
_ORANGE: Final = Color(0.95, 0.6, 0.1, 1.0)
_GREY: Final = Color(0.5, 0.5, 0.5, 1.0)
_WHITE: Final = Color(1.0, 1.0, 1.0, 1.0)
_DISC: Final = Color(0.9, 0.2, 0.2, 0.25)
_GREEN: Final = Color(0.2, 0.8, 0.4, 0.8)
_LINK: Final = Color(0.4, 0.6, 0.8, 0.6)
_RED: Final = Color(0.9, 0.2, 0.2, 0.9)
_PINK: Final = Color(0.9, 0.3, 0.9, 1.0)
_NO_TEXTURE: Final = Image(Header(Time(0, 0), ""), "", np.zeros(0, np.uint8))
_NO_MESH: Final = MeshFile("", np.zeros(0, np.uint8))


def drone(agent: int) -> str:
    """A drone's frame, and its part of a topic's name."""
    return f"drone_{agent}"


def time_of(unix_ns: int) -> Time:
    """Within what the message can hold."""
    sec, nanosec = divmod(max(0, unix_ns), NANO)
    return Time(min(sec, _LAST_S), nanosec)


def clock(ns: int) -> Clock:
    """Simulated time."""
    return Clock(time_of(ns))


def pose(state: AgentState, at: Time) -> PoseStamped:
    """Where a drone is."""
    return PoseStamped(Header(at, MAP), _pose(state.position_ned_m))


def odometry(state: AgentState, accuracy_m: float | None, at: Time) -> Odometry:
    """Where a drone is and how it moves; the speed in its own frame, which has the axes of `map`.
    `accuracy_m`: of its position, by its autopilot; None: not known, which zeros stand for."""
    east, north, up = _enu(state.velocity_ned_mps)
    twist = Twist(Vector3(east, north, up), Vector3(0.0, 0.0, 0.0))
    return Odometry(
        Header(at, MAP),
        drone(state.agent),
        CovaryingPose(_pose(state.position_ned_m), _covariance(accuracy_m)),
        CovaryingTwist(twist, np.zeros(36)),
    )


def fix(state: AgentState, accuracy_m: float | None, origin: Geodetic, at: Time) -> NavSatFix:
    """A drone on the globe. Its height above the ellipsoid is not known: autopilots tell that above
    the sea."""
    place = geodetic_from_ned(state.position_ned_m, origin)
    square = 0.0 if accuracy_m is None else accuracy_m**2
    return NavSatFix(
        header=Header(at, drone(state.agent)),
        status=NavSatStatus(NavSatStatus.STATUS_FIX, NavSatStatus.SERVICE_GPS),
        latitude=place.lat_deg,
        longitude=place.lon_deg,
        altitude=math.nan,
        position_covariance=np.array([square, 0.0, 0.0, 0.0, square, 0.0, 0.0, 0.0, square]),
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_UNKNOWN
        if accuracy_m is None
        else NavSatFix.COVARIANCE_TYPE_APPROXIMATED,
    )


def transforms(states: Iterable[tuple[AgentState, Time]]) -> Transforms:
    """From `map` to each drone's frame."""
    return Transforms(
        [
            StampedTransform(
                Header(at, MAP),
                drone(state.agent),
                Transform(Vector3(*_enu(state.position_ned_m)), _NO_TURN),
            )
            for state, at in states
        ]
    )


def markers(
    view: SwarmView, at: Time, lifetime_s: float, drones: Collection[int], own: int | None = None
) -> MarkerArray:
    """The swarm as RViz draws it: these drones with names, keep-out discs (`r_in`) and slots; links
    between neighbours, zones and targets, unless it is the picture of an agent's `own` part. A
    marker is gone `lifetime_s` after the last that was sent of it."""
    look = _Look(at, lifetime_s, 0.25 * view.plan.law.r_in * view.plan.unit_m)
    states = {agent.id: agent.state for agent in view.agents if agent.state is not None}
    told = [agent for agent in view.agents if agent.id in drones]
    found = [*_drones(view, told, look), *_slots(told, look)]
    if own is None:
        found += [*_links(view, states, look), *_zones(view, look), *_targets(view, look)]
    return MarkerArray(found)


class _Look(NamedTuple):
    """What all markers have in common."""

    at: Time
    lifetime_s: float
    size_m: float
    """A quarter of `r_in`."""

    def marker(
        self,
        name: str,
        number: int,
        kind: int,
        scale_m: tuple[float, float, float],
        color: Color,
        *,
        place: Pose | None = None,
        points: Sequence[Point3] = (),
        text: str = "",
    ) -> Marker:
        """In `map`."""
        nanoseconds = round(self.lifetime_s * NANO)
        return Marker(
            header=Header(self.at, MAP),
            ns=name,
            id=number,
            type=kind,
            action=Marker.ADD,
            pose=place or Pose(Point3(0.0, 0.0, 0.0), _NO_TURN),
            scale=Vector3(*scale_m),
            color=color,
            lifetime=Duration(*divmod(nanoseconds, NANO)),
            frame_locked=False,
            points=[*points],
            colors=[],
            texture_resource="",
            texture=_NO_TEXTURE,
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=_NO_MESH,
            mesh_use_embedded_materials=False,
        )


def _drones(view: SwarmView, agents: Sequence[AgentView], look: _Look) -> Iterator[Marker]:
    r_in = 4 * look.size_m
    for agent in agents:
        if agent.state is None:
            continue
        north, east, down = agent.state.position_ned_m
        place = _pose((north, east, down))
        ball = (look.size_m, look.size_m, 0.5 * look.size_m)
        yield look.marker("drones", agent.id, Marker.SPHERE, ball, _color(agent), place=place)
        disc = (2 * r_in, 2 * r_in, 0.04 * r_in)
        yield look.marker("keep_out", agent.id, Marker.CYLINDER, disc, _DISC, place=place)
        above = _pose((north, east, down - look.size_m))
        letters = (0.0, 0.0, look.size_m)
        group = view.group_now(agent.id) if len(view.plan.groups) > 1 else None
        name = str(agent.id) if group is None else f"{agent.id} {group.name}"
        yield look.marker(
            "names", agent.id, Marker.TEXT_VIEW_FACING, letters, _WHITE, place=above, text=name
        )


def _slots(agents: Sequence[AgentView], look: _Look) -> Iterator[Marker]:
    """Where each drone belongs, at its own height."""
    for agent in agents:
        if agent.target_m is not None and agent.state is not None:
            place = _pose((*agent.target_m, agent.state.position_ned_m[2]))
            ball = (look.size_m, look.size_m, look.size_m)
            yield look.marker("slots", agent.id, Marker.SPHERE, ball, _GREEN, place=place)


def _links(view: SwarmView, states: dict[int, AgentState], look: _Look) -> Iterator[Marker]:
    ends = [i for edge in view.edges if {edge.a, edge.b} <= states.keys() for i in (edge.a, edge.b)]
    if ends:  # RViz complains of a list without points
        points = [_point(states[i].position_ned_m) for i in ends]
        thin = (0.1 * look.size_m, 0.0, 0.0)
        yield look.marker("links", 0, Marker.LINE_LIST, thin, _LINK, points=points)


def _zones(view: SwarmView, look: _Look) -> Iterator[Marker]:
    """The outline of each zone at its floor, and at its ceiling where it has one."""
    number = 0
    for zone in view.zones:
        around = (*zone.outline_m, zone.outline_m[0])
        for height_m in sorted({zone.floor_m or 0.0, zone.ceiling_m or 0.0}):
            points = [_point((*corner, -height_m)) for corner in around]
            thick = (0.2 * look.size_m, 0.0, 0.0)
            yield look.marker("zones", number, Marker.LINE_STRIP, thick, _RED, points=points)
            number += 1


def _targets(view: SwarmView, look: _Look) -> Iterator[Marker]:
    for number, target in enumerate(view.targets):
        color = _PINK if target.fresh else _GREY
        up_m, size_m = target.up_m or 0.0, 2 * look.size_m
        place, above = _pose((*target.at_m, -up_m)), _pose((*target.at_m, -up_m - size_m))
        ball, letters = (size_m, size_m, size_m), (0.0, 0.0, look.size_m)
        yield look.marker("targets", 2 * number, Marker.SPHERE, ball, color, place=place)
        yield look.marker(
            "targets",
            2 * number + 1,
            Marker.TEXT_VIEW_FACING,
            letters,
            _WHITE,
            place=above,
            text=target.name,
        )


def _color(agent: AgentView) -> Color:
    """Grey where it is silent, orange where it acts on a failsafe."""
    if agent.lost:
        return _GREY
    return _ORANGE if agent.status is not None and agent.status.action is not None else _CYAN


def diagnostics(view: SwarmView, at: Time, own: int | None = None) -> Diagnostics:
    """The alarms that stand, of each drone and of the swarm, with the figures that matter most; or
    those that an agent sees at its `own` drone, under a name of their own."""
    standing = alarms(view)
    if own is not None:
        (agent,) = (agent for agent in view.agents if agent.id == own)
        alone = [alarm for alarm in standing if own in alarm.agents]
        return Diagnostics(Header(at, ""), [_drone(view, agent, alone, f"agent {own}")])
    whole = [alarm for alarm in standing if not alarm.agents]
    found = [_swarm(view, whole, len(standing))]
    for agent in view.agents:
        told = [alarm for alarm in standing if agent.id in alarm.agents]
        found.append(_drone(view, agent, told, f"drone {agent.id}"))
    return Diagnostics(Header(at, ""), found)


def _swarm(view: SwarmView, own: Sequence[Alarm], count: int) -> Diagnosis:
    near = [agent.nearest_m for agent in view.agents if agent.live and agent.nearest_m is not None]
    values = {
        "mission": view.plan.name,
        "step": f"{view.step}: {view.group.step_name(view.step)}",
        "error_m": _figure(view.error_m),
        "nearest_m": _figure(min(near, default=None)),
        "alarms": str(count),
    }
    level, message = _told(own, f"{len(near)} in the air")
    return _diagnosis("swarm", view.plan.name, level, message, values)


def _drone(view: SwarmView, agent: AgentView, own: Sequence[Alarm], part: str) -> Diagnosis:
    status, phase = agent.status, agent.phase
    values = {
        "phase": "" if phase is None else phase.name.lower(),
        "step": view.step_name(agent),
        "mode": "" if status is None else status.mode,
        "reason": "" if status is None else status.reason,
        "battery_percent": _figure(None if status is None else status.battery_percent),
        "error_m": _figure(agent.error_m),
        "nearest_m": _figure(agent.nearest_m),
        "silence_s": _figure(agent.silence_s),
    }
    level, message = _told(own, values["phase"] or "not heard yet")
    if agent.lost or phase is None:
        level = _STALE
    return _diagnosis(part, drone(agent.id), level, message, values)


def _diagnosis(
    part: str, hardware: str, level: int, message: str, values: dict[str, str]
) -> Diagnosis:
    pairs = [KeyValue(key, value) for key, value in values.items() if value]
    return Diagnosis(level, f"swarm_ctl: {part}", message, hardware, pairs)


def _told(own: Sequence[Alarm], well: str) -> tuple[int, str]:
    """The worst level, and all words, the worst first."""
    if not own:
        return _OK, well
    return max(_LEVELS[alarm.level] for alarm in own), "; ".join(alarm.words for alarm in own)


def _figure(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.2f}"


def _enu(ned: Ned) -> tuple[float, float, float]:
    north, east, down = ned
    return float(east), float(north), -float(down)


def _point(ned: Ned) -> Point3:
    return Point3(*_enu(ned))


def _pose(ned: Ned) -> Pose:
    return Pose(_point(ned), _NO_TURN)


def _covariance(accuracy_m: float | None) -> np.ndarray:
    """Of x, y, z and three angles, row by row."""
    if accuracy_m is None:
        return np.zeros(36)
    return np.diag([accuracy_m**2] * 3 + [_ANY_TURN] * 3).ravel()
