"""What a mission's fields must be together. Each check is a pure function that yields every mistake
it finds.

`CHECKS` names the sections a check reads, so that a mission with one broken section still gets all
the others checked.
"""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import distances
from swarm_ctl.core.safety.fence import area, crossing_edges, inside
from swarm_ctl.mission.compile.planned_states import Stand, course
from swarm_ctl.mission.geometry.shapes import slots_of
from swarm_ctl.mission.input.document import Place, dotted
from swarm_ctl.mission.input.schema import (
    FleetEntry,
    Form,
    MissionFile,
    Move,
    Offsets,
    Ring,
    Rotate,
    Scale,
    Shape,
    Takeoff,
)
from swarm_ctl.mission.input.simulation_section import overlaps

MAX_DISTANCE_M = 5000.0
"""From the origin: further out the common frame's flat horizon is metres off the earth's."""
_ROUNDING = 1e-9
_DOWN_MPS = 1.5
"""No firmware as delivered comes down faster (WPNAV_SPEED_DN, MPC_Z_V_AUTO_DN)."""


class Finding(NamedTuple):
    """A mistake: where in the mission, what is wrong, what would be allowed."""

    place: Place
    what: str
    allowed: str


Findings: TypeAlias = Iterator[Finding]


def check(mission: MissionFile, broken: frozenset[str] = frozenset()) -> list[Finding]:
    """Everything that is wrong with a mission, but for what needs a section that is itself
    `broken`."""
    found = [
        finding
        for needs, function in CHECKS
        if not broken.intersection(needs.split())
        for finding in function(mission)
    ]
    if found or broken:
        return found  # where the swarm will be can only be told of a mission that is sound so far
    stands = course(mission)
    return [finding for function in COURSE_CHECKS for finding in function(mission, stands)]


# --- law ---


def _radii(mission: MissionFile) -> Findings:
    law = mission.law
    if law.r_in >= law.r_out:
        yield Finding(
            ("law", "r_in"), f"{law.r_in:g} is not below r_out", f"below law.r_out = {law.r_out:g}"
        )
    if law.r_out >= law.r:
        yield Finding(("law", "r_out"), f"{law.r_out:g} is not below r", f"below law.r = {law.r:g}")


def _gains(mission: MissionFile) -> Findings:
    kappa, tick_s = mission.law.kappa, mission.tick_s
    if kappa is not None and kappa * tick_s > 1 + _ROUNDING:
        what = f"{kappa:g} * tick_s {tick_s:g} is {kappa * tick_s:g}: more than one law iteration a tick"
        yield Finding(("law", "kappa"), what, f"at most 1 / tick_s = {1 / tick_s:g}")


# --- agents and their starts ---


def _agent_ids(mission: MissionFile) -> Findings:
    ids: dict[Place, int] = {
        ("agents", k, "id"): agent.id for k, agent in enumerate(mission.agents)
    }
    yield from _twice(ids, "an id of its own for every agent")


def _start_range(mission: MissionFile) -> Findings:
    for k, agent in enumerate(mission.agents):
        away_m = math.hypot(*agent.start) * mission.unit_m
        if away_m > MAX_DISTANCE_M:
            what = f"is {away_m:.0f} m from the origin"
            yield Finding(
                ("agents", k, "start"),
                what,
                f"at most {MAX_DISTANCE_M:g} m (unit_m {mission.unit_m:g})",
            )


def _starts(mission: MissionFile) -> Findings:
    r_in = mission.law.r_in
    for (_, a), (k, b) in itertools.combinations(enumerate(mission.agents), 2):
        apart = math.dist(a.start, b.start)
        if apart < r_in:
            what = f"agents {a.id} and {b.id} start {_length(mission, apart)} apart"
            yield Finding(
                ("agents", k, "start"), what, f"at least law.r_in = {_length(mission, r_in)}"
            )


def _connected(mission: MissionFile) -> Findings:
    if mission.neighbours != "starts":
        return
    starts = {agent.id: agent.start for agent in mission.agents}
    parts = graph.components(graph.neighbours(starts, mission.law.r))
    if len(parts) > 1:
        named = _named(parts)
        gap, i, j = min(
            (math.dist(starts[i], starts[j]), i, j)
            for one, other in itertools.combinations(parts, 2)
            for i in one
            for j in other
        )
        yield Finding(
            ("agents",),
            f"the start graph is not connected: it falls into {named}; "
            f"the smallest gap is {_length(mission, gap)}, agents {i} and {j}",
            f"every part within law.r = {_length(mission, mission.law.r)} of another",
        )


def _links(mission: MissionFile) -> Findings:
    given: list[tuple[Place, object]] = [(("neighbours",), mission.neighbours)]
    given += [((*place, "neighbours"), form.neighbours) for place, form in forms(mission)]
    ids = sorted(agent.id for agent in mission.agents)
    for place, links in given:
        if not isinstance(links, tuple):
            continue
        for k, (i, j) in enumerate(links):
            if i not in ids or j not in ids or i == j:
                yield Finding(
                    (*place, k),
                    f"[{i}, {j}] is no link",
                    "two different ids of " + ", ".join(map(str, ids)),
                )
        parts = graph.components(graph.of_links(ids, links))
        if len(parts) > 1:
            yield Finding(
                place,
                f"the graph is not connected: it falls into {_named(parts)}",
                "links between them",
            )


def _named(parts: tuple[tuple[int, ...], ...]) -> str:
    return " and ".join("{" + ", ".join(map(str, part)) + "}" for part in parts)


# --- fleet ---


def _fleet(mission: MissionFile) -> Findings:
    return fleet(mission.fleet.agents, ("fleet", "agents")) if mission.fleet else iter(())


def fleet(entries: Sequence[FleetEntry], place: Place) -> Findings:
    """What is wrong with the entries of a fleet, which stand at `place`."""
    yield from _twice(
        {(*place, k, "id"): e.id for k, e in enumerate(entries)}, "one entry for each agent"
    )
    sysids = {(*place, k, "sysid"): sysid_of(e) for k, e in enumerate(entries)}
    yield from _twice(sysids, "a sysid of its own for every vehicle")
    endpoints = {(*place, k, "endpoint"): e.endpoint for k, e in enumerate(entries)}
    yield from _twice(endpoints, "an endpoint of its own for every vehicle")
    yield from _twice(
        {(*place, k, "mesh"): e.mesh for k, e in enumerate(entries)}, "a mesh endpoint of its own"
    )
    for k, entry in enumerate(entries):
        if entry.sysid is None and entry.id > 250:
            yield Finding(
                (*place, k), f"sysid is missing, and id {entry.id} is none", "sysid: 1 to 250"
            )
        yield from _ports((*place, k), entry)


def _ports(place: Place, entry: FleetEntry) -> Findings:
    for name, value in (("endpoint", entry.endpoint), ("mesh", entry.mesh)):
        port = value.rpartition(":")[2] if value and not value.startswith("serial:") else "1"
        if not 1 <= int(port) <= 65535:
            yield Finding((*place, name), f"port {port} is out of range", "a port from 1 to 65535")


def _fleet_has_all(mission: MissionFile) -> Findings:
    if mission.fleet is None:
        for k, agent in enumerate(mission.agents):
            if agent.id > 250:
                what = f"agent {agent.id} can't use its id as its vehicle's sysid"
                yield Finding(
                    ("agents", k, "id"),
                    what,
                    "an id up to 250, or a fleet section that gives sysids",
                )
        return
    there = {entry.id for entry in mission.fleet.agents}
    for k, agent in enumerate(mission.agents):
        if agent.id not in there:
            what = f"agent {agent.id} has no entry in the fleet"
            yield Finding(("agents", k, "id"), what, "one of " + ", ".join(map(str, sorted(there))))


def sysid_of(entry: FleetEntry) -> int:
    """The vehicle's system id: the agent's own where the file gives none."""
    return entry.id if entry.sysid is None else entry.sysid


# --- simulation ---


def _faults(mission: MissionFile) -> Findings:
    place: Place = ("simulation", "faults")
    ids = sorted(agent.id for agent in mission.agents)
    for k, fault in enumerate(mission.simulation.faults):
        if not fault.set.given():
            yield Finding((*place, k, "set"), "sets nothing", "one SIM_* parameter at least")
        for j, agent in enumerate(fault.agents or ()):
            if agent not in ids:
                what = f"agent {agent} is not in this mission"
                yield Finding((*place, k, "agents", j), what, "one of " + ", ".join(map(str, ids)))
    for i, k, name in overlaps(mission.simulation.faults):
        first = mission.simulation.faults[i]
        until = first.at_s + (first.for_s or 0.0)
        what = f"{name} is set while faults[{i}] lasts, which then takes it back"
        yield Finding((*place, k, "at_s"), what, f"{until:g} or later, or other agents")


# --- shapes ---


def _shapes(mission: MissionFile) -> Findings:
    for name, shape in mission.shapes.items():
        place = ("shapes", name)
        if isinstance(shape, Ring) and (shape.side is None) == (shape.radius is None):
            what = (
                "has neither side nor radius" if shape.side is None else "has both side and radius"
            )
            yield Finding(place, what, "one of side, radius")
        else:
            yield from _slot_distances(mission, place, shape)


def _slot_distances(mission: MissionFile, place: Place, shape: Shape) -> Findings:
    between = distances(slots_of(shape, len(mission.agents)))
    close = sorted(
        (float(between[i, j]), i, j)
        for i, j in itertools.combinations(range(len(between)), 2)
        if between[i, j] <= mission.law.r_out + _ROUNDING
    )
    if close:
        apart, i, j = close[0]
        more = f" (and {len(close) - 1} more pairs)" if len(close) > 1 else ""
        where = (*place, "offsets", j) if isinstance(shape, Offsets) else place
        what = (
            f"slots {i + 1} and {j + 1} of {len(between)} are {_length(mission, apart)} apart{more}"
        )
        yield Finding(where, what, f"more than law.r_out = {_length(mission, mission.law.r_out)}")


def _slot_counts(mission: MissionFile) -> Findings:
    need = len(mission.agents)
    for name in dict.fromkeys(
        form.shape for _, form in forms(mission) if form.shape in mission.shapes
    ):
        shape = mission.shapes[name]
        have = (
            len(shape.offsets)
            if isinstance(shape, Offsets)
            else getattr(shape, "count", None) or need
        )
        if have != need:
            field = "offsets" if isinstance(shape, Offsets) else "count"
            few = "too few" if have < need else "too many"
            yield Finding(
                ("shapes", name, field), f"{have} slots for {need} agents: {few}", f"{need} slots"
            )


# --- steps ---


def forms(mission: MissionFile) -> list[tuple[Place, Form]]:
    """The form steps and their places."""
    return [(("steps", k, "form"), step.form) for k, step in enumerate(mission.steps) if step.form]


def _kinds(mission: MissionFile) -> list[str]:
    """Each step's kind; '' where it has none or several."""
    given = [sorted(step.model_fields_set) for step in mission.steps]
    return [kinds[0].rstrip("_") if len(kinds) == 1 else "" for kinds in given]


def _steps(mission: MissionFile) -> Findings:
    kinds = _kinds(mission)
    last = len(kinds) - 1
    for k, kind in enumerate(kinds):
        place = ("steps", k)
        if not kind:
            yield Finding(place, "is not one step", f"exactly one of {', '.join(_KINDS)}")
        elif k == 0 and kind != "takeoff":
            yield Finding(place, f"{kind} before takeoff", "takeoff as the first step")
        elif k > 0 and kind == "takeoff":
            yield Finding(place, "takeoff in the air", "takeoff as the first step only")
        if k < last and kind in _LAST:
            yield Finding(place, f"steps after {kind}", f"{kind} as the last step only")
        if kind in _KEEPING and "form" not in kinds[:k]:
            yield Finding(place, f"{kind} without a formation to keep", "a form step before it")
    if kinds[last] not in {*_LAST, ""}:
        yield Finding(
            ("steps", last),
            f"the mission ends with {kinds[last]}",
            "land or return as the last step",
        )


_KINDS = ("takeoff", "form", "hold", "move", "rotate", "scale", "return", "land")
_KEEPING = ("hold", "move", "rotate", "scale")
_LAST = ("land", "return")


def _moves(mission: MissionFile) -> Findings:
    for k, step in enumerate(mission.steps):
        travel = step.move or step.rotate or step.scale
        if travel is None:
            continue
        place: Place = ("steps", k, _kinds(mission)[k])
        if isinstance(travel, Move):
            given = [name for name in ("to", "along", "by") if getattr(travel, name) is not None]
            if len(given) != 1:
                yield Finding(
                    place, f"has {' and '.join(given) or 'no way to go'}", "one of to, along, by"
                )
        limit = mission.vehicle.limits.speed_mps
        if travel.speed_mps is not None and travel.speed_mps > limit:
            what = f"{travel.speed_mps:g} m/s is faster than the vehicles may fly"
            yield Finding(
                (*place, "speed_mps"), what, f"at most vehicle.limits.speed_mps = {limit:g}"
            )


def travel_mps(mission: MissionFile, travel: Move | Rotate | Scale) -> float:
    """How fast the fastest agent goes: as given, or half of what it may."""
    return travel.speed_mps or mission.vehicle.limits.speed_mps / 2


# --- where it will be ---


def way_m(mission: MissionFile, before: Stand, after: Stand) -> float:
    """How far the outermost agent goes in a move, rotate or scale step [m]."""
    points = (before.centre, *after.waypoints)
    way = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    way += abs(after.angle_rad - before.angle_rad) * before.radius + abs(
        after.radius - before.radius
    )
    return way * mission.unit_m


def form_graph(
    mission: MissionFile, form: Form, before: Stand
) -> dict[int, tuple[int, ...]] | None:
    """N_i from a form step on; None: as before."""
    if form.neighbours == "keep":
        return None
    if form.neighbours == "rechoose":
        return graph.neighbours(dict(zip(before.ids, before.offsets, strict=True)), mission.law.r)
    return graph.of_links(before.ids, form.neighbours)


def _rechosen(mission: MissionFile, stands: list[Stand]) -> Findings:
    for k, (step, before) in enumerate(zip(mission.steps, stands[:-1], strict=True)):
        links = form_graph(mission, step.form, before) if step.form else None
        parts = graph.components(links) if links else ()
        if len(parts) > 1:
            what = f"the shape before is not connected: it falls into {_named(parts)}"
            yield Finding(
                ("steps", k, "form", "neighbours"),
                what,
                f"every part within law.r = {mission.law.r:g}",
            )


def _narrow(mission: MissionFile, stands: list[Stand]) -> Findings:
    for k, (step, after) in enumerate(zip(mission.steps, stands[1:], strict=True)):
        if step.scale and len(after.ids) > 1:
            between = distances(after.offsets)
            apart = float(between[~np.eye(len(between), dtype=bool)].min())
            if apart <= mission.law.r_out + _ROUNDING:
                allowed = (
                    f"more than law.r_out = {_length(mission, mission.law.r_out)} between slots"
                )
                what = f"{step.scale.factor:g} brings slots to {_length(mission, apart)}"
                yield Finding(("steps", k, "scale", "factor"), what, allowed)


def _fenced(mission: MissionFile, stands: list[Stand]) -> Findings:
    polygon, ceiling = mission.fence.polygon or (), mission.fence.height_m
    for k, agent in enumerate(mission.agents):
        if not inside(polygon, agent.start):
            yield Finding(
                ("agents", k, "start"), "is outside the geofence", "a start inside fence.polygon"
            )
    for k, (step, after) in enumerate(zip(mission.steps, stands[1:], strict=True)):
        place: Place = ("steps", k, _kinds(mission)[k])
        if step.takeoff and after.height_m > ceiling:
            what = f"{after.height_m:g} m is above the geofence"
            yield Finding((*place, "height_m"), what, f"at most fence.height_m = {ceiling:g}")
        for centre in after.waypoints:
            away_m = math.hypot(*centre) * mission.unit_m
            out = [
                i
                for i, at in zip(after.ids, _at(centre, after), strict=True)
                if not inside(polygon, at)
            ]
            if out:
                what = (
                    f"at {centre[0]:g}, {centre[1]:g} agent {out[0]} would be outside the geofence"
                )
                yield Finding(place, what, "a way inside fence.polygon")
            elif away_m > MAX_DISTANCE_M:
                yield Finding(
                    place, f"goes {away_m:.0f} m from the origin", f"at most {MAX_DISTANCE_M:g} m"
                )


def _travel_timeouts(mission: MissionFile, stands: list[Stand]) -> Findings:
    for k, (step, before, after) in enumerate(
        zip(mission.steps, stands[:-1], stands[1:], strict=True)
    ):
        travel = step.move or step.rotate or step.scale
        if travel and travel.timeout_s is not None:
            needed_s = way_m(mission, before, after) / travel_mps(mission, travel) + travel.settle_s
            yield from _longer(("steps", k, _kinds(mission)[k]), travel.timeout_s, needed_s)


def _polygon(mission: MissionFile) -> Findings:
    polygon = mission.fence.polygon or ()
    crossing = crossing_edges(polygon)
    if crossing:
        i, j = crossing
        what = f"the edges after corners {i + 1} and {j + 1} cross"
        yield Finding(("fence", "polygon"), what, "corners in order, as one walks along the fence")
    elif polygon and area(polygon) * mission.unit_m**2 < 1.0:
        yield Finding(("fence", "polygon"), "has no area", "corners around a field")


def _at(centre: tuple[float, float], stand: Stand) -> list[tuple[float, float]]:
    return [(centre[0] + n, centre[1] + e) for n, e in stand.offsets]


def _form_shapes(mission: MissionFile) -> Findings:
    known = sorted(mission.shapes)
    for place, form in forms(mission):
        if form.shape not in mission.shapes:
            close = difflib.get_close_matches(form.shape, known, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            allowed = (
                "one of " + ", ".join(known) if known else "a shape named in the section shapes"
            )
            yield Finding((*place, "shape"), f"there is no shape {form.shape!r}{hint}", allowed)


def _timeouts(mission: MissionFile) -> Findings:
    for k, step in enumerate(mission.steps):
        if step.takeoff and step.takeoff.timeout_s is not None:
            yield from _longer(
                ("steps", k, "takeoff"), step.takeoff.timeout_s, climb_s(mission, step.takeoff)
            )
        if step.form:
            yield from _longer(("steps", k, "form"), step.form.timeout_s, step.form.settle_s)
        if step.hold and step.hold.timeout_s is not None:
            yield from _longer(("steps", k, "hold"), step.hold.timeout_s, step.hold.duration_s)
        down, first = step.land or step.return_, mission.steps[0].takeoff
        if down and down.timeout_s is not None and first:
            place: Place = ("steps", k, "land" if step.land else "return")
            yield from _longer(place, down.timeout_s, first.height_m / _DOWN_MPS)


def climb_s(mission: MissionFile, takeoff: Takeoff) -> float:
    """The least time a take-off needs."""
    return takeoff.height_m / mission.vehicle.limits.climb_mps


def _longer(place: Place, timeout_s: float, needed_s: float) -> Findings:
    if timeout_s <= needed_s:
        what = f"{timeout_s:g} s is over before the {place[-1]} step can be done"
        yield Finding((*place, "timeout_s"), what, f"above {needed_s:g}")


# --- helpers ---


def _twice(values: Mapping[Place, object], allowed: str) -> Findings:
    first: dict[object, Place] = {}
    for place, value in values.items():
        if value is None:
            continue
        if value in first:
            yield Finding(place, f"{value} is taken by {dotted(first[value][:-1])}", allowed)
        first.setdefault(value, place)


def _length(mission: MissionFile, units: float) -> str:
    return f"{units:.4g} units ({units * mission.unit_m:.4g} m)"


CHECKS: tuple[tuple[str, Callable[[MissionFile], Findings]], ...] = (
    ("law", _radii),
    ("law tick_s", _gains),
    ("agents", _agent_ids),
    ("agents unit_m", _start_range),
    ("agents law unit_m", _starts),
    ("agents law unit_m neighbours", _connected),
    ("fleet", _fleet),
    ("fence lengths unit_m", _polygon),
    ("agents fleet", _fleet_has_all),
    ("agents simulation", _faults),
    ("shapes agents law unit_m", _shapes),
    ("shapes agents steps", _slot_counts),
    ("steps", _steps),
    ("steps shapes", _form_shapes),
    ("steps vehicle", _timeouts),
    ("steps vehicle", _moves),
    ("neighbours steps agents", _links),
)
COURSE_CHECKS: tuple[Callable[[MissionFile, list[Stand]], Findings], ...] = (
    _rechosen,
    _narrow,
    _fenced,
    _travel_timeouts,
)
