"""What the sections of a mission file must be together. Each check is a pure function that yields
every mistake it finds.

`_CHECKS` names the sections that a check reads: a mission with one broken section still gets all
checks that do not read it. What shows only in the plan is in `plan_checks.py`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from swarm_ctl import law_loader
from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import apart_in_height, distances
from swarm_ctl.core.model.plan import EVERYONE
from swarm_ctl.core.safety.fence import area, crossing_edges, inside
from swarm_ctl.core.swarm.hearing import SMALL_SWARM
from swarm_ctl.errors import InputError
from swarm_ctl.mission.checks import zone_checks
from swarm_ctl.mission.fleet.fleet_checks import check_fleet, check_hosts, check_trust
from swarm_ctl.mission.geometry.shapes import slot_count, slots_of, ups_of
from swarm_ctl.mission.input.document import (
    ROUNDING,
    Findings,
    Mistake,
    Place,
    bad_links,
    listed,
    named_parts,
    too_short,
    twice,
)
from swarm_ctl.mission.input.near_matches import did_you_mean
from swarm_ctl.mission.input.units import enough, metres, said
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.shape_sections import OffsetsShape, RingShape, Shape, StarShape
from swarm_ctl.mission.sections.simulation_section import overlaps
from swarm_ctl.mission.steps.barrier import BarrierSection
from swarm_ctl.mission.steps.follow import target_findings
from swarm_ctl.mission.steps.form import FormSection
from swarm_ctl.mission.steps.move import MAX_DISTANCE_M
from swarm_ctl.mission.steps.table import KINDS, LAST, WrittenStep
from swarm_ctl.mission.written_steps import REST, written_steps


def check(mission: MissionFile, broken: frozenset[str] = frozenset()) -> list[Mistake]:
    """All mistakes, but for those that need a section in `broken`; lengths are the file's."""
    found = [
        finding
        for needs, function in _CHECKS
        if not broken.intersection(needs.split())
        for finding in function(mission)
    ]
    if broken.isdisjoint({"steps", "groups", "agents"}):
        for group, place, entry in written_steps(mission):
            for needs, check_step in KINDS[entry.kind].checks if entry.kind in KINDS else ():
                if not broken.intersection(needs.split()):
                    seen = group.seen_by(mission)
                    found += check_step(entry.body, (*place, entry.kind), seen)
    return found


# --- law ---


def _radii(mission: MissionFile) -> Findings:
    law = mission.law
    for inner, outer in (("r_in", "r_out"), ("r_out", "r")):
        small, large = getattr(law, inner), getattr(law, outer)
        if small >= large:
            allowed = f"below law.{outer} = {large:g}"
            yield Mistake(("law", inner), f"{small:g} is not below {outer}", allowed)


def _gains(mission: MissionFile) -> Findings:
    kappa, tick_s = mission.law.kappa, mission.tick_s
    if kappa is not None and kappa * tick_s > 1 + ROUNDING:
        times = f"{kappa:g} * tick_s {tick_s:g} is {kappa * tick_s:g}"
        allowed = f"at most 1 / tick_s = {1 / tick_s:g}"
        yield Mistake(("law", "kappa"), f"{times}: more than one law iteration a tick", allowed)


def _own_law(mission: MissionFile) -> Findings:
    name, given = mission.law.own or "paper", mission.law.parameters
    try:
        law_loader.pinned(name, given)
    except InputError as error:
        what, _, allowed = str(error).partition("; allowed: ")
        of_values = "unknown parameter" in what or any(f": {each} " in what for each in given)
        yield Mistake(("law", "parameters" if of_values else "own"), what, allowed)


# --- origin, agents and their starts ---


def _no_place(mission: MissionFile) -> Findings:
    """A vehicle that knows no position says 0, 0, so none is believed there."""
    origin = mission.origin.planned()
    if origin.lat_deg == 0 == origin.lon_deg:
        what = "0, 0 lies in the Atlantic, and is what a vehicle without a position says"
        yield Mistake(("origin",), what, "the latitude and longitude of the field")


def _agent_ids(mission: MissionFile) -> Findings:
    ids: dict[Place, int] = {
        ("agents", k, "id"): agent.id for k, agent in enumerate(mission.agents)
    }
    yield from twice(ids, "an id of its own for every agent")


def _some_fly(mission: MissionFile) -> Findings:
    if all(agent.waits for agent in mission.agents):
        what = "all agents wait to be launched, and none flies that they could join"
        yield Mistake(("agents",), what, "an agent without waits")


def _start_range(mission: MissionFile) -> Findings:
    for k, agent in enumerate(mission.agents):
        away_m = math.hypot(*agent.start) * metres(mission)
        if away_m > MAX_DISTANCE_M:
            what = f"is {said(away_m, mission)} from the origin"
            yield Mistake(("agents", k, "start"), what, f"at most {said(MAX_DISTANCE_M, mission)}")


def _starts(mission: MissionFile) -> Findings:
    """One finding for each agent: the nearest of those before it."""
    r_in, metre = mission.law.r_in, metres(mission)
    for k, agent in enumerate(mission.agents):
        before = [(math.dist(a.start, agent.start), a.id) for a in mission.agents[:k]]
        apart, other = min(before, default=(math.inf, 0))
        if apart < r_in:
            what = f"agents {other} and {agent.id} start {said(apart * metre, mission)} apart"
            allowed = f"at least law.r_in = {said(r_in * metre, mission)}"
            yield Mistake(("agents", k, "start"), what, allowed)


def _connected(mission: MissionFile) -> Findings:
    if mission.neighbours != "starts":
        return
    starts = {agent.id: agent.start for agent in mission.agents}
    r, metre = mission.law.r, metres(mission)
    parts = graph.components(graph.neighbours(starts, r))
    if len(parts) > 1:
        what = (
            f"the start graph is not connected: with law.r = {said(r * metre, mission)} it falls"
            f" into {named_parts(parts)}"
        )
        needed, i, j = graph.connecting_range(starts)
        wide = f"law.r of {said(needed * metre, mission, least=True)} or more"
        allowed = f"{wide} (agents {i} and {j}), closer starts, or a list of neighbours"
        yield Mistake(("agents",), what, allowed)


def _links(mission: MissionFile) -> Findings:
    ids = sorted(agent.id for agent in mission.agents)
    yield from bad_links(("neighbours",), mission.neighbours, ids)


# --- fleet ---


def _fleet(mission: MissionFile) -> Findings:
    if mission.fleet:
        entries, place = mission.fleet.agents, ("fleet", "agents")
        sysids: dict[Place, int] = {
            (*place, k, "sysid"): entry.vehicle_sysid for k, entry in enumerate(entries)
        }
        yield from twice(sysids, "a sysid of its own for every vehicle")
        carries = mission.fleet.radio_bytes_per_s
        yield from check_fleet(entries, place, radio=carries is not None)
        yield from check_trust(mission.fleet, ("fleet",))
        yield from check_hosts(mission.fleet, ("fleet",))


def _links_of_fleet(mission: MissionFile) -> Findings:
    """All agents are linked to each other, or all to routers: in a large swarm, and in one that
    names a router."""
    fleet = mission.fleet
    if fleet is None:
        return
    named = bool(fleet.router) or any(entry.router for entry in fleet.agents)
    large = len(mission.agents) > SMALL_SWARM
    for k, entry in enumerate(fleet.agents):
        place = ("fleet", "agents", k)
        if (named or large) and entry.mesh:
            what = "the agent does not listen: it is a client of its host's router"
            yield Mistake((*place, "mesh"), what, "router: where the router listens")
        elif named and not (entry.router or fleet.router or large):
            what = f"agent {entry.id} has no router, and other agents have"
            yield Mistake(place, what, "router: of each agent, or none, or one of the fleet")


def _fleet_has_all(mission: MissionFile) -> Findings:
    there = {entry.id for entry in mission.fleet.agents} if mission.fleet else set()
    for k, agent in enumerate(mission.agents):
        place = ("agents", k, "id")
        if mission.fleet is None and agent.id > 250:
            what = f"agent {agent.id} can't use its id as its vehicle's sysid"
            yield Mistake(place, what, "an id up to 250, or a fleet section that gives sysids")
        elif mission.fleet and agent.id not in there:
            what = f"agent {agent.id} has no entry in the fleet"
            yield Mistake(place, what, f"one of {listed(there)}")


# --- simulation ---


def _faults(mission: MissionFile) -> Findings:
    place: Place = ("simulation", "faults")
    ids = sorted(agent.id for agent in mission.agents)
    for k, fault in enumerate(mission.simulation.faults):
        if not fault.set.given() and fault.pilot is None:
            allowed = "one SIM_* parameter at least, or a pilot"
            yield Mistake((*place, k, "set"), "sets nothing", allowed)
        if fault.pilot is not None and fault.for_s is not None:
            yield Mistake((*place, k, "for_s"), "a pilot gives nothing back", "no for_s")
        for j, agent in enumerate(fault.agents or ()):
            if agent not in ids:
                what = f"agent {agent} is not in this mission"
                yield Mistake((*place, k, "agents", j), what, f"one of {listed(ids)}")
    for i, k, name in overlaps(mission.simulation.faults):
        first = mission.simulation.faults[i]
        until = first.at_s + (first.for_s or 0.0)
        what = f"{name} is set while faults#{i + 1} lasts, which resets it at its end"
        yield Mistake((*place, k, "at_s"), what, f"{until:g} or later, or other agents")


# --- shapes ---


def _shapes(mission: MissionFile) -> Findings:
    for name, shape in mission.shapes.items():
        place = ("shapes", name)
        if isinstance(shape, RingShape) and (shape.side is None) == (shape.radius is None):
            given = "neither side nor radius" if shape.side is None else "both side and radius"
            yield Mistake(place, f"has {given}", "one of side, radius")
        else:
            yield from _slot_distances(mission, place, shape)


def _slot_distances(mission: MissionFile, place: Place, shape: Shape) -> Findings:
    """Slots are r_out apart, or a layer, in each step that forms the shape; of as many agents as
    the largest group that forms it has."""
    forms, sizes = list[FormSection](), list[int]()
    for group, _, entry in written_steps(mission):
        if isinstance(entry.body, FormSection) and entry.body.shape == place[-1]:
            forms.append(entry.body)
            sizes.append(len(group.ids))
    size = max(sizes, default=0) or len(mission.agents)  # an undeclared group has no agents
    ups_m = ups_of(shape, size)
    between, r_out = distances(slots_of(shape, size)), mission.law.r_out
    if len(ups_m) != len(between):
        what, allowed = f"{len(ups_m)} heights for {len(between)} slots", "one for each slot"
        yield Mistake((*place, "up_m"), what, allowed)
        return
    layer_m = mission.wake.spacing_m(mission.vehicle.limits)
    over = [apart_in_height(form.in_layers(ups_m, layer_m), layer_m) for form in forms]
    between[np.all(over or [apart_in_height(ups_m, layer_m)], axis=0)] = math.inf
    high = f", or {layer_m:g} m in height" if any(ups_m) or any(f.layers for f in forms) else ""
    metre = metres(mission)
    close = sorted(
        (float(between[i, j]), i, j)
        for i, j in itertools.combinations(range(len(between)), 2)
        if between[i, j] <= r_out + ROUNDING
    )
    if close:
        apart, i, j = close[0]
        more = f" (and {len(close) - 1} more pairs)" if len(close) > 1 else ""
        where = (*place, "offsets", j) if isinstance(shape, OffsetsShape) else place
        pair = f"slots {i + 1} and {j + 1} of {len(between)}"
        what = f"{pair} are {said(apart * metre, mission)} apart{more}"
        wide = _wide(shape, r_out / apart) if apart else ""
        least = said(r_out * metre, mission)
        yield Mistake(where, what, f"more than law.r_out = {least}{wide}{high}")


def _wide(shape: Shape, times: float) -> str:
    """The length that spreads a shape's slots `times` as wide; '' where it has none, or two."""
    sizes = ("side", "radius", "spacing", "height")
    given = {name: value for name in sizes if (value := getattr(shape, name, None)) is not None}
    if len(given) != 1 or isinstance(shape, StarShape):
        return ""
    ((name, value),) = given.items()
    return f": {name} above {enough(value * times)}"


def _slot_counts(mission: MissionFile) -> Findings:
    bodies = ((len(group.ids), entry.body) for group, _, entry in written_steps(mission))
    formed = {(body.shape_formed, need): None for need, body in bodies if body and need}
    for name, need in formed:
        if name is None or name not in mission.shapes:
            continue
        shape = mission.shapes[name]
        have = slot_count(shape, need)
        if have != need:
            place = ("shapes", name, "offsets" if isinstance(shape, OffsetsShape) else "count")
            few = "too few" if have < need else "too many"
            yield Mistake(place, f"{have} slots for {need} agents: {few}", f"{need} slots")


# --- steps ---


def _steps(mission: MissionFile) -> Findings:
    last, entries = len(mission.steps) - 1, mission.steps
    for k, entry in enumerate(entries):
        formed = any(e.body and e.body.shape_formed for e in entries[_joined(mission, k) : k])
        if entry.split is None or not entry.kind:
            yield from _in_order(("steps", k), entry, first=k == 0, last=k == last, formed=formed)
            continue
        if k == 0:
            yield Mistake(("steps", k), "split before takeoff", "takeoff as the first step")
        for name, steps in entry.split.items():
            own = formed
            for j, step in enumerate(steps):
                place = ("steps", k, "split", name, j)
                end = j == len(steps) - 1
                yield from _in_order(place, step, first=False, last=end, formed=own)
                own = own or bool(step.body and step.body.shape_formed)
    if entries[last].split is None and entries[last].kind not in {*LAST, ""}:
        what = f"the mission ends with {entries[last].kind}"
        yield Mistake(("steps", last), what, "land or return as the last step")


def _joined(mission: MissionFile, k: int) -> int:
    """Where the steps begin that the swarm has flown as one up to the k-th."""
    return max((j + 1 for j in range(k) if mission.steps[j].split is not None), default=0)


def _in_order(
    place: Place, step: WrittenStep, *, first: bool, last: bool, formed: bool
) -> Findings:
    kind = step.kind
    if kind not in KINDS:
        one = ", ".join([*KINDS, *(["split"] if len(place) == 2 else [])])
        yield Mistake(place, "is not one step", f"exactly one of {one}")
        return
    if first and not KINDS[kind].opens:
        yield Mistake(place, f"{kind} before takeoff", "takeoff as the first step")
    elif not first and KINDS[kind].opens:
        yield Mistake(place, f"{kind} in the air", f"{kind} as the first step only")
    if not last and kind in LAST:
        yield Mistake(place, f"steps after {kind}", f"{kind} as the last step only")
    if KINDS[kind].keeps_formation and not formed:
        yield Mistake(place, f"{kind} without a formation to keep", "a form step before it")


def _groups(mission: MissionFile) -> Findings:
    ids = sorted(agent.id for agent in mission.agents)
    for name, members in mission.groups.items():
        place = ("groups", name)
        if name in (EVERYONE, REST):
            yield Mistake(place, f"{name} is a group of every mission", "another name")
        elif name.replace("-", "").isdecimal():
            what = f"@{name} names agents by their ids"
            yield Mistake(place, what, "another name, with a letter in it")
        yield from twice({(*place, k): i for k, i in enumerate(members)}, "each agent once")
        for k, agent in enumerate(members):
            if agent not in ids:
                what = f"there is no agent {agent}"
                yield Mistake((*place, k), what, f"one of {listed(ids)}")


def _splits(mission: MissionFile) -> Findings:
    everyone = {agent.id for agent in mission.agents}
    known, flying = sorted(mission.groups), everyone
    for k, entry in enumerate(mission.steps):
        place, taken, here = ("steps", k, "split"), dict[int, str](), flying
        if not flying:
            yield Mistake(("steps", k), "steps after all have landed", "no step after it")
            return
        for name, steps in (entry.split or {}).items():
            if name not in mission.groups:
                allowed = (
                    f"one of {', '.join(known)}" if known else "a name from the section groups"
                )
                hint = did_you_mean(name, known)
                yield Mistake((*place, name), f"there is no group {name!r}{hint}", allowed)
            members = mission.groups.get(name, ())
            twice_in = [i for i in members if i in taken]
            if twice_in:
                other = taken[twice_in[0]]
                what = f"agent {twice_in[0]} is in {other}, too"
                yield Mistake((*place, name), what, "groups of a split that share no agent")
            gone = [i for i in members if i in everyone and i not in here]
            if gone:
                what = f"agent {gone[0]} has landed in an earlier split"
                yield Mistake((*place, name), what, f"some of {listed(here)}")
            taken |= dict.fromkeys(members, name)
            if set(members) >= here:
                what = f"{name} is the whole swarm"
                yield Mistake((*place, name), what, "the steps without a split, or more groups")
            if steps[-1].kind in LAST:
                flying = flying - set(members)
    if mission.steps[-1].split is not None and flying:
        what = f"the mission ends with a split, and agents {listed(flying)} fly on"
        yield Mistake(("steps", len(mission.steps) - 1), what, "land or return as the last step")


def _barriers(mission: MissionFile) -> Findings:
    """Each is in a split, for two groups at least, and all come to them in one order."""
    split_of = dict[str, int]()
    for k, entry in enumerate(mission.steps):
        if isinstance(entry.body, BarrierSection):
            yield Mistake(("steps", k), "a barrier of the whole swarm", "a barrier in a split")
        own = {
            name: [
                (j, s.body.name) for j, s in enumerate(steps) if isinstance(s.body, BarrierSection)
            ]
            for name, steps in (entry.split or {}).items()
        }
        for name, barriers in own.items():
            for j, barrier in barriers:
                place = ("steps", k, "split", name, j, "barrier", "name")
                others = [b for other in own if other != name for _, b in own[other]]
                if barrier not in others:
                    named = ", ".join(sorted(set(others))) or "one that another group has, too"
                    yield Mistake(place, f"no other group has a barrier {barrier!r}", named)
                if split_of.setdefault(barrier, k) != k:
                    what = f"barrier {barrier!r} is in an earlier split, too"
                    yield Mistake(place, what, "a name of its own")
                if [b for _, b in barriers].index(barrier) < [i for i, _ in barriers].index(j):
                    yield Mistake(place, f"barrier {barrier!r} twice", "a name of its own")
        yield from _dead_lock(k, {name: [b for _, b in found] for name, found in own.items()})


def _dead_lock(k: int, own: dict[str, list[str]]) -> Findings:
    """Groups that come to their barriers in an order in which each waits for another for ever."""
    left = {name: list(barriers) for name, barriers in own.items()}
    while any(left.values()):
        passed = next(
            (
                b[0]
                for b in left.values()
                if b and all(b[0] not in other[1:] for other in left.values())
            ),
            None,
        )
        if passed is None:
            waits = ", ".join(f"{name} at {b[0]}" for name, b in left.items() if b)
            what = f"groups wait for each other for ever: {waits}"
            yield Mistake(("steps", k, "split"), what, "barriers in one order in all groups")
            return
        for barriers in left.values():
            if barriers and barriers[0] == passed:
                barriers.pop(0)


def _timeouts(mission: MissionFile) -> Findings:
    for group, place, entry in written_steps(mission):
        if entry.kind in KINDS:
            body: Any = entry.body
            needed_s = KINDS[entry.kind].needed_s(body, group.seen_by(mission))
            yield from too_short((*place, entry.kind), body.timeout_s, needed_s)


# --- fence ---


def _polygon(mission: MissionFile) -> Findings:
    polygon = mission.fence.polygon or ()
    if crossing := crossing_edges(polygon):
        what = f"the edges after corners {crossing[0] + 1} and {crossing[1] + 1} cross"
        yield Mistake(("fence", "polygon"), what, "corners in order along the fence")
    elif polygon and area(polygon) * metres(mission) ** 2 < 1.0:
        yield Mistake(("fence", "polygon"), "has no area", "corners around a field")


def _starts_fenced(mission: MissionFile) -> Findings:
    sound = not list(_polygon(mission))
    for k, agent in enumerate(mission.agents):
        if sound and not inside(mission.fence.polygon or (), agent.start):
            allowed = "a start inside fence.polygon"
            yield Mistake(("agents", k, "start"), "is outside the geofence", allowed)


_CHECKS: tuple[tuple[str, Callable[[MissionFile], Findings]], ...] = (
    ("law", _radii),
    ("law tick_s", _gains),
    ("law", _own_law),
    ("origin", _no_place),
    ("agents", _agent_ids),
    ("agents", _some_fly),
    ("agents lengths unit_m", _start_range),
    ("agents law lengths unit_m", _starts),
    ("agents law lengths unit_m neighbours", _connected),
    ("fleet", _fleet),
    ("fence lengths unit_m", _polygon),
    ("fence agents lengths unit_m", _starts_fenced),
    ("zones lengths unit_m", zone_checks.each_alone),
    ("targets agents", target_findings),
    ("agents fleet", _fleet_has_all),
    ("agents fleet", _links_of_fleet),
    ("agents simulation", _faults),
    ("groups agents", _groups),
    ("shapes agents law lengths unit_m wake vehicle steps groups", _shapes),
    ("shapes agents steps groups", _slot_counts),
    ("steps", _steps),
    ("steps groups agents", _splits),
    ("steps", _barriers),
    ("steps vehicle groups agents", _timeouts),
    ("neighbours agents", _links),
)
