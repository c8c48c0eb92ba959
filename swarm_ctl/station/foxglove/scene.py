"""A view as a 3-D scene. The frame `map` is the mission's common frame, turned to east, north, up;
each vehicle has a frame of its own, `agent_1` and so on, which `/tf` moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import Point
from swarm_ctl.core.model.vehicle import Vector3 as Ned
from swarm_ctl.station.foxglove.messages import (
    LINE_LIST,
    LINE_STRIP,
    ArrowPrimitive,
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    LinePrimitive,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Time,
    Vector3,
)
from swarm_ctl.station.picture.view import AgentView, SwarmView

FRAME: Final = "map"
_FLIES: Final = Color(0.1, 0.55, 0.95, 1.0)
_ACTS: Final = Color(0.95, 0.6, 0.1, 1.0)
_SILENT: Final = Color(0.5, 0.5, 0.5, 1.0)
_DISC: Final = Color(0.9, 0.2, 0.2, 0.25)
_SLOT: Final = Color(0.2, 0.8, 0.4, 0.8)
_LINK: Final = Color(0.4, 0.6, 0.8, 0.6)
_SETPOINT: Final = Color(0.95, 0.85, 0.2, 1.0)
_ZONE: Final = Color(0.9, 0.2, 0.2, 0.9)
_TARGET: Final = Color(0.9, 0.3, 0.9, 1.0)
_WHITE: Final = Color(1.0, 1.0, 1.0, 1.0)
_TRAIL_POINTS: Final = 40
_HERE: Final = Pose()
_THIN: Final = 0.04
"""Of `r_in`: the height of a disc."""


def frame_of(agent: int) -> str:
    """The vehicle's frame."""
    return f"agent_{agent}"


def color_of(agent: AgentView) -> Color:
    """Grey where it is silent, orange where it acts on a failsafe."""
    if agent.lost:
        return _SILENT
    return _ACTS if agent.status is not None and agent.status.action is not None else _FLIES


def east_north_up(ned: Ned) -> Vector3:
    """The same vector as Foxglove has it; centimetres are enough for the eye."""
    north, east, down = ned
    return Vector3(round(east, 2), round(north, 2), round(-down, 2))


def transforms(view: SwarmView, now: Time) -> FrameTransforms:
    """The frames of all vehicles that were ever heard."""
    return FrameTransforms(
        tuple(
            FrameTransform(now, FRAME, frame_of(state.agent), east_north_up(state.position_ned_m))
            for state in _states(view)
        )
    )


def vehicles(view: SwarmView, now: Time) -> SceneUpdate:
    """Each vehicle with its label and its keep-out disc (`r_in`), in its own frame: it moves with
    `transforms`."""
    r_in = view.plan.law.r_in * view.plan.unit_m
    disc = CylinderPrimitive(_HERE, Vector3(2 * r_in, 2 * r_in, _THIN * r_in), 1.0, 1.0, _DISC)
    body, above = Vector3(0.3 * r_in, 0.3 * r_in, 0.12 * r_in), Pose(Vector3(z=0.4 * r_in))
    return SceneUpdate(
        tuple(
            SceneEntity(
                now,
                frame_of(agent.id),
                f"vehicle {agent.id}",
                cubes=(CubePrimitive(_HERE, body, color_of(agent)),),
                cylinders=(disc,),
                texts=(TextPrimitive(above, True, 14.0, True, _WHITE, _label(agent, view)),),
            )
            for agent in view.agents
            if agent.state is not None
        )
    )


def _label(agent: AgentView, view: SwarmView) -> str:
    """Its id, and in a mission with groups the name of its own."""
    group = view.group_now(agent.id) if len(view.plan.groups) > 1 else None
    return str(agent.id) if group is None else f"{agent.id} {group.name}"


def formation(view: SwarmView, now: Time) -> SceneUpdate:
    """Slots, neighbour links, setpoints of the moment, zones and targets, in the common frame."""
    size = 0.25 * view.plan.law.r_in * view.plan.unit_m
    ball = Vector3(size, size, size)
    states = {state.agent: state for state in _states(view)}
    slots = tuple(
        SpherePrimitive(Pose(_at(agent.target_m, states[agent.id])), ball, _SLOT)
        for agent in view.agents
        if agent.target_m is not None and agent.id in states
    )
    ends = (i for edge in view.edges if {edge.a, edge.b} <= states.keys() for i in (edge.a, edge.b))
    links = tuple(east_north_up(states[i].position_ned_m) for i in ends)
    line = LinePrimitive(LINE_LIST, _HERE, 1.0, True, links, _LINK)
    return SceneUpdate(
        (
            SceneEntity(now, FRAME, "slots", spheres=slots),
            SceneEntity(now, FRAME, "links", lines=(line,) if links else ()),
            SceneEntity(now, FRAME, "setpoints", arrows=tuple(_arrows(view, size))),
            SceneEntity(now, FRAME, "zones", lines=tuple(_walls(view))),
            *_targets(view, now, size),
        )
    )


def trails(view: SwarmView, now: Time) -> SceneUpdate:
    """Where the vehicles came from."""
    lines = tuple(
        LinePrimitive(
            LINE_STRIP,
            _HERE,
            1.5,
            True,
            tuple(east_north_up(point) for point in points[-_TRAIL_POINTS:]),
            _FLIES,
        )
        for state in _states(view)
        if len(points := view.histories.trails.get(state.agent, ())) > 1
    )
    return SceneUpdate((SceneEntity(now, FRAME, "trails", lines=lines),))


def _states(view: SwarmView) -> Iterator[AgentState]:
    return (agent.state for agent in view.agents if agent.state is not None)


def _at(point: Point, state: AgentState) -> Vector3:
    return east_north_up((*point, state.position_ned_m[2]))


def _walls(view: SwarmView) -> Iterator[LinePrimitive]:
    """The outline of each zone at its floor, and at its ceiling where it has one."""
    for zone in view.zones:
        for height_m in {zone.floor_m or 0.0, zone.ceiling_m or 0.0}:
            around = (*zone.outline_m, zone.outline_m[0])
            points = tuple(east_north_up((*corner, -height_m)) for corner in around)
            yield LinePrimitive(LINE_STRIP, _HERE, 2.0, True, points, _ZONE)


def _targets(view: SwarmView, now: Time, size: float) -> Iterator[SceneEntity]:
    """Each target as a ball with its name, the age of its news and how far the formation is off."""
    ball = Vector3(2 * size, 2 * size, 2 * size)
    for target in view.targets:
        colour = _TARGET if target.fresh else _SILENT
        up_m = target.up_m or 0.0
        told = f"{target.name} {target.age_s:.1f} s"
        told += f", {target.off_m:.1f} m off" if target.off_m is not None else ""
        above = Pose(east_north_up((*target.at_m, -up_m - 2 * size)))
        yield SceneEntity(
            now,
            FRAME,
            f"target {target.name}",
            spheres=(SpherePrimitive(Pose(east_north_up((*target.at_m, -up_m))), ball, colour),),
            texts=(TextPrimitive(above, True, 14.0, True, _WHITE, told),),
        )


def _arrows(view: SwarmView, size: float) -> Iterator[ArrowPrimitive]:
    """A second of flight at the commanded velocity, of each vehicle that is heard and has one."""
    for agent in view.agents:
        if agent.state is None or not agent.live:
            continue
        north, east = agent.state.setpoint_mps
        if (speed := math.hypot(north, east)) > 0.05:
            half = 0.5 * math.atan2(north, east)
            turned = Quaternion(z=round(math.sin(half), 4), w=round(math.cos(half), 4))
            pose = Pose(east_north_up(agent.state.position_ned_m), turned)
            head = min(size, 0.4 * speed)
            yield ArrowPrimitive(
                pose, round(speed - head, 2), 0.25 * size, head, 0.6 * size, _SETPOINT
            )
