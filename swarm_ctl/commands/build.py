"""Makes the mesh's `Command` of an operator's order.

What `form`, `move` and `tune` ask for is decided here, once for all agents, so that no two of them
can differ.
"""

from __future__ import annotations

import difflib
import math
import uuid
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl import slot_assignment
from swarm_ctl.commands.parse import BY_NAME, COURSE, Order, rezoned, tuned
from swarm_ctl.core.kernel.walls import FENCE
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.messages import ABOUT, ENDING, Command, CommandKind, Gains, Tuning
from swarm_ctl.core.model.plan import Geodetic, GroupPlan, Plan, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.among_zones import AmongZones
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.safety.surroundings import Surroundings
from swarm_ctl.core.swarm.gain_update import ASKS, LEAD_S, limits, planned
from swarm_ctl.errors import InputError

_TOLERANCE_M: Final = 0.5
_SETTLE_S: Final = 5.0
_NO_END_S: Final = 1e9
_AGREE: Final = "in a moment they may agree; `zone plan` gives all of them the mission's own"
_ONE_CLOCK_S: Final = 1.0
"""Clocks that are less apart are told as one: a command may be 15 s old."""


@dataclass(frozen=True, slots=True)
class AgentNow:
    """What the sender knows of one agent of the plan."""

    id: int
    stop_point_m: Point | None
    """Where it would come to rest, (north, east) of the origin; None: it was never heard."""
    lost: bool = False
    """It was heard, but not of late."""
    flies: bool = True
    """It is heard and controls its vehicle."""
    gains: Gains | None = None
    """The law it flies; None: it has not told yet."""
    zones: tuple[Zone, ...] | None = None
    """The zones it keeps out of; None: the plan's, or it has not told yet."""
    clock_ahead_s: float | None = None
    """Its clock less the sender's, 0 where they may be one; None: not known."""
    shows_ahead_s: float = 0.0
    """By its newest state alone, its clock less the sender's."""
    left: bool = False
    """It has left the formation (`AgentState.left`)."""
    ends: bool = False
    """By an order that ends its flight: it is on its way down, or there."""
    down: bool = False
    """Its flight is over."""
    step: int | None = None
    """That it is in; None: as `SwarmNow.step`."""


@dataclass(frozen=True, slots=True)
class SwarmNow:
    """What the sender knows of the swarm. `time_s` is on its own mission clock."""

    plan: Plan
    time_s: float
    step: int
    """The furthest step any agent is in."""
    agents: tuple[AgentNow, ...]
    speedup: float = 1.0

    @property
    def zones(self) -> tuple[Zone, ...]:
        """In force, by the agents that fly; InputError where they have different ones."""
        found = {agent.zones for agent in self.agents if agent.flies and agent.gains is not None}
        if len(found) > 1:
            unlike = f"agents have different zones ({_zones_of(self)})"
            raise InputError(f"{unlike}; nothing was sent: {_AGREE}")
        told = next(iter(found), None)
        return self.plan.zones if told is None else told

    @property
    def airspace(self) -> Plan:
        """The plan, with the zones in force."""
        return replace(self.plan, zones=self.zones)

    @property
    def formation(self) -> list[AgentNow]:
        """The agents that have not left it."""
        return [agent for agent in self.agents if not agent.left]

    @property
    def groups(self) -> list[GroupPlan]:
        """Those that fly now: of each agent of the formation, by its step."""
        steps = [
            (agent.id, self.step if agent.step is None else agent.step)
            for agent in self.formation
            if not agent.down
        ]
        return [
            group
            for group in self.plan.groups
            if any(step in group.told_steps and i in group.members for i, step in steps)
        ]

    def flown_by(self, order: Order) -> GroupPlan:
        """The one group that an order to a formation is for; InputError where it is for none, or
        for several, or for some of its agents."""
        ids, groups = order.named(self.plan, self.step), self.groups
        if not ids and min(len(groups), len(self.plan.groups)) == 1:
            return (groups or self.plan.groups)[0]
        meant = {agent.id for agent in self.formation}.intersection(ids)
        for group in groups:
            if meant and meant == {a.id for a in self.formation if a.id in group.members}:
                return group
        what = f"{order.kind} is for one group, as a whole"
        if not groups:
            raise InputError(f"{what}, and none flies; nothing was sent")
        flying = ", ".join(f"@{group.name} ({agents_named(group.ids)})" for group in groups)
        now = f"now {'fly' if len(groups) > 1 else 'flies'} {flying}"
        raise InputError(f"{what}; {now}; nothing was sent")

    def meant(self, order: Order) -> tuple[int, ...]:
        """The agents that an order is for: those that it names, of a group those that have not left
        the formation; else all of the formation, and for one that ends the mission, or brings back
        those that are away, all that have not ended. Who is expelled need not answer that. A change
        of law or zones is for each that controls its vehicle, wherever it flies or waits."""
        ids = order.named(self.plan, self.step)
        if order.kind in ABOUT:
            spared = ids if order.kind == CommandKind.EXPEL else ()
            return tuple(a.id for a in self.agents if not a.down and a.id not in spared)
        if order.kind in _TOGETHER and not ids and len(groups := self.groups) == 1:
            ids = groups[0].ids
        gone = {a.id for a in self.agents if a.left and (a.down or order.kind not in ENDING)}
        if order.kind in ASKS:
            gone -= {a.id for a in self.agents if a.flies}
        if order.kind == CommandKind.RETURN:  # who comes down already does no other thing
            gone |= {a.id for a in self.agents if a.ends}
        if order.kind == CommandKind.RESUME:
            gone -= {a.id for a in self.agents if not (a.down or a.ends)}
        asked = ids or tuple(agent.id for agent in self.agents)
        return tuple(i for i in asked if i not in gone or i in order.agents) or ids

    def step_of(self, ids: Collection[int]) -> int:
        """The furthest step of these agents, or of all where none is named."""
        steps = [a.step for a in self.agents if a.id in ids and a.step is not None]
        return max(steps, default=self.step)

    def stop_points_m(self, kind: str, group: GroupPlan) -> dict[int, Point]:
        """Where each agent of the group's formation would come to rest; InputError where one is not
        heard."""
        formation = [agent for agent in self.formation if agent.id in group.members]
        found = {
            a.id: a.stop_point_m for a in formation if a.stop_point_m is not None and not a.lost
        }
        silent = [str(agent.id) for agent in formation if agent.id not in found]
        if silent:
            raise InputError(f"{kind}: agent {', '.join(silent)} is not heard; nothing was sent")
        return found

    def heights_m(self, group: GroupPlan) -> tuple[float, float]:
        """The lowest and the highest at which an agent of the group flies by the plan."""
        stands = group.formations(self.plan.unit_m)
        steps = [self.step if a.step is None else a.step for a in self.agents]
        step = max((k for k in steps if k in group.told_steps), default=group.before)
        return stands[
            min(max(step - group.before, 0 if group.before else 1), len(stands) - 1)
        ].span_m


def _zones_of(swarm: SwarmNow) -> str:
    """`agents 1, 3: oak, pond; agent 2: as planned`."""
    found: dict[tuple[Zone, ...] | None, list[int]] = {}
    for agent in swarm.agents:
        if agent.flies and agent.gains is not None:
            found.setdefault(agent.zones, []).append(agent.id)
    return "; ".join(
        f"{agents_named(ids)}: {'as planned' if zones is None else _listed(zones)}"
        for zones, ids in found.items()
    )


def _listed(zones: Iterable[Zone]) -> str:
    """Their names."""
    return ", ".join(zone.name for zone in zones) or "none"


def build(order: Order, swarm: SwarmNow) -> Command:
    """The command for `order` and the swarm as it is.

    Raises:
        InputError: there is no such command, agent or shape, a number is out of range, or an agent
            is not heard that has to be.
    """
    _check(order, swarm.plan)
    named = order.named(swarm.plan, swarm.step)
    if order.kind in ABOUT and not 0 < len(named) < len(swarm.plan.agents):
        raise InputError(f"{order.kind} is about some agents, not all; nothing was sent")
    ahead_s = ((a.id, round(a.shows_ahead_s, 3)) for a in swarm.agents)
    command = Command(
        uuid.uuid4().hex,
        order.kind,
        named,
        swarm.time_s,
        ahead_s=tuple(pair for pair in ahead_s if abs(pair[1]) > _ONE_CLOCK_S),
    )
    match order.kind:
        case kind if kind in ABOUT:
            return replace(command, agents=(), about=named)
        case CommandKind.NEXT:
            if not named and any(agent.left and not agent.down for agent in swarm.agents):
                # those that are away stay there
                command = replace(command, agents=tuple(agent.id for agent in swarm.formation))
            return replace(command, at_step=order.at_step or swarm.step_of(named))
        case CommandKind.FORM | CommandKind.MOVE | CommandKind.FOLLOW:
            group = swarm.flown_by(order)
            step: AnyOrdered = _TOGETHER[order.kind](order, swarm, group)
            whole = len(group.ids) == len(swarm.plan.agents)
            command = replace(command, agents=() if whole else group.ids)
        case CommandKind.GOTO:
            step = _goto(order, swarm, named)
        case CommandKind.TUNE | CommandKind.ZONE:
            agents, tuning = _tune(order, swarm)
            return replace(command, agents=agents, tuning=tuning, plan_hash=swarm.plan.hash())
        case _:
            return command
    return replace(command, step=step, plan_hash=swarm.plan.hash())


def _check(order: Order, plan: Plan) -> None:
    if order.kind not in BY_NAME:
        raise InputError(f"unknown command {order.kind!r}; allowed: {', '.join(BY_NAME)}")
    known = [agent.id for agent in plan.agents]
    for agent in order.agents:
        if agent not in known:
            raise InputError(f"there is no agent {agent}; allowed: {', '.join(map(str, known))}")


def _form(order: Order, swarm: SwarmNow, group: GroupPlan) -> FormStep:
    """A shape of the plan; each slot goes to an agent that is near."""
    (shape,), plan, points_m = order.arguments, swarm.plan, swarm.stop_points_m("form", group)
    shapes = {each.name: each for each in plan.shapes if len(each.slots) == len(group.ids)}
    if shape not in shapes:
        close = difflib.get_close_matches(shape, shapes, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        sizes = [str(len(each.slots)) for each in plan.shapes if each.name == shape]
        has = f"shape {shape} has {' or '.join(sizes)} slots, {group.name} {len(group.ids)} agents"
        raise InputError(
            f"{has if sizes else f'there is no shape {shape!r} in this mission{hint}'}; allowed:"
            f" {', '.join(shapes) or 'none'}"
        )
    # The agents that have left take the slots that no other wants.
    points = np.full((len(group.agents), 2), np.nan)
    for place, agent in enumerate(group.agents):
        if agent.id in points_m:
            points[place] = np.array(points_m[agent.id]) / plan.unit_m
    wanted = shapes[shape]
    if wanted.ups_m:
        level = np.zeros(len(points))  # all heights cost each agent as much
        found, ups = slot_assignment.nearest_with_heights(points, wanted.slots, level, wanted.ups_m)
        dealt, ups_m = slot_assignment.rounded(found), tuple(ups)
    else:
        dealt, ups_m = slot_assignment.rounded(slot_assignment.nearest(points, wanted.slots)), ()
    chosen = np.array(dealt)
    if smallest_distance(chosen, ups_m, plan.slot_layer_m) <= plan.law.r_out:
        raise InputError(
            f"slots of {shape} are closer than r_out, {plan.law.r_out * plan.unit_m:g} m"
        )
    centre = np.mean(list(points_m.values()), axis=0)
    offsets = (chosen - chosen.mean(axis=0)) * plan.unit_m
    places_m = {i: centre + at for i, at in zip(group.ids, offsets, strict=True)}
    _fenced(f"form {shape}", swarm, group, places_m)
    return FormStep(shape, dealt, _TOLERANCE_M, _SETTLE_S, _NO_END_S, ups_m=ups_m)


def _move(order: Order, swarm: SwarmNow, group: GroupPlan) -> MoveStep:
    """The formation's centre to a point, or by so much from where it is."""
    north, east, *speeds = map(float, order.arguments)
    points_m = swarm.stop_points_m("move", group)
    centre = np.mean(list(points_m.values()), axis=0)
    if order.by:
        north, east = north + float(centre[0]), east + float(centre[1])
    if not (math.isfinite(north) and math.isfinite(east)):
        raise InputError(
            f"move to ({north:g}, {east:g}) m; allowed: finite numbers of metres, north and east"
        )
    most = swarm.plan.limits.speed_mps
    speed = speeds[0] if speeds else most / 2
    if not 0 < speed <= most:
        raise InputError(f"move at {speed:g} m/s; allowed: above 0, at most {most:g} m/s")
    shift = np.array((north, east)) - centre
    if swarm.plan.fence is None or inside(swarm.plan.fence.polygon_m, (north, east)):
        # a centre outside is refused by the agents themselves
        _fenced("move", swarm, group, {i: np.array(at) + shift for i, at in points_m.items()})
    waypoints_m, opens_m = _way_round(swarm, group, list(points_m.values()), (north, east))
    ends = _TOLERANCE_M, _SETTLE_S, _NO_END_S
    return MoveStep(waypoints_m, speed, *ends, opens_m=opens_m)


def _follow(order: Order, swarm: SwarmNow, _: GroupPlan) -> FollowStep:
    """The formation with a target, until another order."""
    name, *rest = order.arguments
    plan = swarm.plan
    known = [target.name for target in plan.targets]
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        allowed = ", ".join(known) or "none: give the mission `targets`"
        raise InputError(f"there is no target {name!r} in this mission{hint}; allowed: {allowed}")
    north, east = [float(word) for word in rest if word != COURSE] or (0.0, 0.0)
    return FollowStep(
        name,
        (north, east),
        in_course=COURSE in rest,
        speed_mps=plan.limits.speed_mps,
        duration_s=_NO_END_S,
        timeout_s=_NO_END_S,
    )


AnyOrdered: TypeAlias = FormStep | MoveStep | FollowStep | GotoStep
_TOGETHER: Final[
    dict[str, Callable[[Order, SwarmNow, GroupPlan], FormStep | MoveStep | FollowStep]]
] = {CommandKind.FORM: _form, CommandKind.MOVE: _move, CommandKind.FOLLOW: _follow}


def _goto(order: Order, swarm: SwarmNow, named: tuple[int, ...]) -> GotoStep:
    """Some agents to a point, as they are to each other: their mean there, or the only one."""
    plan, first = swarm.plan, order.arguments[0]
    if "," in first:
        lat, lon = map(float, first.split(","))
        if not (abs(lat) <= 89.0 and abs(lon) <= 180.0):
            allowed = "latitude,longitude in degrees, up to 89 and 180"
            raise InputError(f"goto {first}: is nowhere on earth; allowed: {allowed}")
        at = ned_from_geodetic(Geodetic(lat, lon, plan.origin.alt_m), plan.origin)
        to_m, speeds = (at[0], at[1]), order.arguments[1:]
    else:
        north, east, *rest = order.arguments
        to_m, speeds = (float(north), float(east)), tuple(rest)
    most = plan.limits.speed_mps
    speed = float(speeds[0]) if speeds else most / 2
    if not 0 < speed <= most:
        raise InputError(f"goto at {speed:g} m/s; allowed: above 0, at most {most:g} m/s")
    if not named or len(named) == len(plan.agents):
        raise InputError("goto is for some agents, not all; for all: move; nothing was sent")
    found = {a.id: a.stop_point_m for a in swarm.agents if a.id in named and not a.lost}
    silent = [str(i) for i in named if found.get(i) is None]
    if silent:
        raise InputError(f"goto: agent {', '.join(silent)} is not heard; nothing was sent")
    points_m = {i: np.array(point) for i, point in found.items()}
    shift = np.array(to_m) - np.mean(list(points_m.values()), axis=0)
    places_m = {i: point + shift for i, point in points_m.items()}
    group = next((g for g in swarm.groups if named[0] in g.members), plan.groups[0])
    _fenced("goto", swarm, group, places_m)
    return GotoStep(
        tuple((i, (float(at[0]), float(at[1]))) for i, at in places_m.items()), speed, _NO_END_S
    )


def _way_round(
    swarm: SwarmNow, group: GroupPlan, points_m: list[Point], to_m: Point
) -> tuple[tuple[Point, ...], float | None]:
    """Round zones, as a mission's `move` goes; InputError where there is no way."""
    plan, unit = swarm.airspace, swarm.plan.unit_m
    slots = tuple((north / unit, east / unit) for north, east in points_m)
    before = PlannedFormation.at_start(slots, unit)
    among = AmongZones.of(plan, swarm.heights_m(group))
    waypoints_m, opens_m = among.round(before, [to_m])
    way = (before.centre_m, *waypoints_m)
    ways = [way] if opens_m is not None else zip(*map(before.places_m, way), strict=True)
    cut = next((cut for each in ways if (cut := among.cut(each))), "")
    if cut and not (opens_m is not None and among.leads(way)):
        raise InputError(
            f"move: there is no way past zone {cut} to {to_m[0]:.1f} m north, {to_m[1]:.1f} m east"
            " of the origin; allowed: a place to which a way leads"
        )
    return waypoints_m, opens_m


def _fenced(
    kind: str, swarm: SwarmNow, group: GroupPlan, places_m: Mapping[int, NDArray[np.float64]]
) -> None:
    """InputError where an order would bring an agent out of the geofence, or into a zone."""
    plan, heights_m = swarm.airspace, swarm.heights_m(group)
    polygon = plan.fence.polygon_m if plan.fence else ()
    around = Surroundings.of(plan)
    for agent, at in places_m.items():
        if not inside(polygon, (float(at[0]), float(at[1]))):
            raise InputError(
                f"{kind}: agent {agent} would be outside the geofence, {at[0]:.1f} m north,"
                f" {at[1]:.1f} m east of the origin; allowed: places inside fence.polygon"
            )
        for wall, margins in around.near(complex(at[0], at[1]), *heights_m):
            if wall.about != FENCE and wall.gap < margins.keep:
                raise InputError(
                    f"{kind}: agent {agent} would be in {around.name(wall.about)}, or nearer to it"
                    f" than {margins.keep:g} m, {at[0]:.1f} m north, {at[1]:.1f} m east of the"
                    " origin; allowed: places outside of zones"
                )


def _tune(order: Order, swarm: SwarmNow) -> tuple[tuple[int, ...], Tuning]:
    """The agents asked, and the change. Every agent that controls a vehicle is asked."""
    plan = swarm.plan
    unheard = [agent.id for agent in swarm.formation if agent.stop_point_m is None]
    if unheard:
        raise InputError(f"{order.kind}: {agents_named(unheard)} is not heard; nothing was sent")
    asked = [agent for agent in swarm.agents if agent.flies]
    if not asked:
        raise InputError(f"{order.kind}: no agent flies any more; nothing was sent")
    laws = {agent.gains for agent in asked if agent.gains is not None}
    resets = order.kind == CommandKind.ZONE and order.arguments == ("plan",)
    if order.kind == CommandKind.ZONE and len(laws) != 1 and not resets:
        what = "agents fly different laws; `tune` them first" if laws else "no agent tells its law"
        raise InputError(f"zone: {what}; nothing was sent")
    names = set(limits(plan))
    named = {word.partition("=")[0] for word in order.arguments}
    if (
        order.kind == CommandKind.TUNE
        and len(laws) != 1
        and "plan" not in named
        and not names <= named
    ):
        what = "agents fly different laws" if laws else "no agent has told its law yet"
        raise InputError(
            f"tune: {what}; name all of {', '.join(sorted(names))}, or say `tune plan`"
        )
    same = len(laws) == 1
    gains = next(iter(laws)) if same else planned(plan)
    zones = plan.zones if resets else swarm.zones
    if order.arguments == ("list",):
        raise InputError(f"zones: {_listed(zones)}")
    if order.kind == CommandKind.ZONE:
        zones = rezoned(order.arguments, zones, plan)
    else:
        gains = tuned(order.arguments, gains, plan)
    at_s = swarm.time_s + LEAD_S * max(1.0, swarm.speedup)
    ahead_s = tuple((agent.id, agent.clock_ahead_s) for agent in asked if agent.clock_ahead_s)
    told = None if zones == plan.zones and order.kind != CommandKind.ZONE else zones
    return tuple(agent.id for agent in asked), Tuning(gains, at_s, ahead_s, told)
