"""What is wrong with zones: each alone, and against starts, places and ways."""

from __future__ import annotations

import itertools
import math

from swarm_ctl.core.agent.return_to_launch import highest_m, return_height_m
from swarm_ctl.core.kernel.decide import NearWall
from swarm_ctl.core.kernel.walls import FENCE
from swarm_ctl.core.model.plan import Plan, PlannedStep, Point
from swarm_ctl.core.safety.among_zones import AmongZones
from swarm_ctl.core.safety.fence import area, crossing_edges
from swarm_ctl.core.safety.surroundings import Surroundings
from swarm_ctl.mission.input.document import Findings, Mistake, Place
from swarm_ctl.mission.input.units import metres
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.mission_sections import ZoneSection
from swarm_ctl.mission.steps.table import kind_of


def each_alone(mission: MissionFile) -> Findings:
    """Each zone by itself, and against those before it."""
    seen = dict[tuple[object, ...], str]()
    for name, zone in mission.zones.items():
        place, polygon = ("zones", name), zone.polygon or ()
        circle = zone.circle is not None, zone.radius is not None
        if bool(polygon) == any(circle):
            given = "both polygon and circle" if polygon else "neither polygon nor circle"
            yield Mistake(place, f"has {given}", "polygon, or circle and radius")
        elif any(circle) and not all(circle):
            missing = "radius" if circle[0] else "circle"
            yield Mistake((*place, missing), "is missing", "circle and radius")
        elif crossing := crossing_edges(polygon):
            what = f"the edges after corners {crossing[0] + 1} and {crossing[1] + 1} cross"
            yield Mistake((*place, "polygon"), what, "corners in order around the zone")
        elif polygon and area(polygon) * metres(mission) ** 2 < 0.01:
            yield Mistake((*place, "polygon"), "has no area", "corners around a place")
        low, high = zone.floor_m, zone.ceiling_m
        if low is not None and high is not None and high <= low:
            what = f"{high:g} m is not above floor_m"
            yield Mistake((*place, "ceiling_m"), what, f"above {low:g}")
        same = seen.setdefault(_where(zone), name)
        if same != name:
            yield Mistake(place, f"is where zone {same} is", "each zone once")


def _where(zone: ZoneSection) -> tuple[object, ...]:
    return zone.polygon, zone.circle, zone.radius, zone.floor_m, zone.ceiling_m


def filtered(plan: Plan) -> Findings:
    """Zones are kept out of by the filter alone."""
    if plan.zones and not plan.safety.filter:
        what = "no vehicle keeps out of them without the filter"
        yield Mistake(("zones",), what, "safety.filter: true, or no zones")


def starts(plan: Plan) -> list[Mistake]:
    """Starts that are in a zone which reaches so low, or so near to one that a vehicle there could
    not stay. A vehicle climbs from its start, and a return lands there."""
    around, found = Surroundings.of(plan), list[Mistake]()
    for k, agent in enumerate(plan.agents):
        at = (agent.start[0] * plan.unit_m, agent.start[1] * plan.unit_m)
        near = _too_near(around, at, 0.0, highest_m(plan, agent.id))
        if near is not None and (near.wall.about != FENCE or near.wall.gap > 0.0):
            what = f"agent {agent.id} starts {_says(around, near)}"
            found.append(Mistake(("agents", k, "start"), what, _needs(near)))
    return found


def on_its_way(at: PlannedStep, place: Place) -> list[Mistake]:
    """The first agent whose planned place after a step, or whose way there, is in a zone, or so
    near to one, or to the fence, that it could not stay there."""
    plan, step, before = at.plan, at.step, at.before
    ends_m, around = at.after.places_m(), Surroundings.of(plan)
    spans_m = list(zip(before.heights_m, at.after.heights_m, strict=True))
    if step.lands_in_place or ends_m != before.places_m():
        for agent, end, (from_m, to_m) in zip(at.group.agents, ends_m, spans_m, strict=True):
            heights_m = (0.0, from_m) if step.lands_in_place else (to_m, to_m)
            near = _too_near(around, end, *heights_m)
            if near is not None and (near.wall.about != FENCE or near.wall.gap > 0.0):
                does = "would land" if step.lands_in_place else "would be"
                what = f"agent {agent.id} {does} {_says(around, near)} at {_point(end)}"
                return [Mistake(place, what, _needs(near))]
    return _cut_ways(at, place)


def _cut_ways(at: PlannedStep, place: Place) -> list[Mistake]:
    plan, step, before = at.plan, at.step, at.before
    ways = kind_of(step).ways_m(step, at)
    if step.new_shape is not None:
        ways = list(zip(before.places_m(), at.after.places_m(), strict=True))
    if step.file is not None:
        ways = [(before.centre_m, *step.way_m)] * len(at.group.agents)
    spans_m = zip(before.heights_m, at.after.heights_m, strict=True)
    for agent, way, (from_m, to_m) in zip(at.group.agents, ways, spans_m, strict=False):
        height_m = return_height_m(plan, agent.id) if step.goes_home else to_m
        among = AmongZones.of(plan, (min(from_m, height_m), max(from_m, height_m)))
        cut = among.cut(way)
        if not cut or ((step.file or not step.path) and among.leads(way)):
            continue
        if step.way_m:
            return [_hindered(at, place, among, cut)]
        what = f"agent {agent.id} has no way past zone {cut} to {_point(way[-1])}"
        return [Mistake(place, what, "a wider gap, or another place")]
    return []


def _hindered(at: PlannedStep, place: Place, among: AmongZones, cut: str) -> Mistake:
    """Why the formation has no way past a zone: the widest gap is too narrow, or the way begins or
    ends where the formation has no room."""
    centre_m, many = (at.before.centre_m, *at.step.way_m), len(at.group.agents) > 1
    for a, b in itertools.pairwise(centre_m):
        lacks_m = among.lacks_m(a, b, many=many)
        if lacks_m == 0.0:
            continue
        whom = "vehicles in file" if many else "a vehicle"
        what = f"there is no way past zone {cut}: "
        narrow = f"the widest gap is {_up(lacks_m or 0.0)} m too narrow for {whom}"
        what += "there is no gap" if lacks_m is None else narrow
        two, one = map(_up, among.needed_m(many=many))
        gap = f"a gap of {two} m between zones, {one} m between a zone and the fence"
        return Mistake(place, what, f"{gap}; or another way")
    radius_m = at.before.radius_m
    near = [end for end in (centre_m[0], centre_m[-1]) if not among.roomy(cut, end, radius_m)]
    if near:
        does = "begins" if near[0] == centre_m[0] else "ends"
        what = f"the way of the formation {does} too near to zone {cut}"
        allowed = f"its centre at least {_up(among.off_m(cut, radius_m))} m away"
        return Mistake(place, what, allowed)
    what = f"the formation has no way past zone {cut} to {_point(centre_m[-1])}"
    return Mistake(place, what, "a wider gap, or another place")


def _up(length_m: float) -> str:
    """To a tenth of a metre, rounded up."""
    return f"{math.ceil(10.0 * length_m - 1e-6) / 10.0:.1f}"


def _too_near(around: Surroundings, at: Point, low_m: float, high_m: float) -> NearWall | None:
    """The wall from which a vehicle at this point would be kept off the most."""
    near = around.near(complex(*at), low_m, high_m)
    return min((each for each in near if _room_m(each) < 0.0), key=_room_m, default=None)


def _room_m(near: NearWall) -> float:
    return near.wall.gap - near.margins.keep


def _says(around: Surroundings, near: NearWall) -> str:
    """`in zone oak`, `1.2 m from zone oak`."""
    name, gap_m = around.name(near.wall.about), near.wall.gap
    return f"{gap_m:.2f} m from {name}" if gap_m > 0.0 else f"in {name}"


def _needs(near: NearWall) -> str:
    """What would be allowed."""
    least = math.ceil(100.0 * near.margins.keep) / 100.0
    return f"at least {least:g} m {'inside' if near.wall.about == FENCE else 'away'}"


def _point(at: Point) -> str:
    return f"{at[0]:.1f} m north, {at[1]:.1f} m east of the origin"
