"""What a mission may do, but an operator should know before it flies."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable
from typing import Final

from swarm_ctl.core.kernel.constraints import margins_of
from swarm_ctl.core.kernel.heights import in_wake, wake_mps
from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.fleet import SigningPolicy, VehicleKind
from swarm_ctl.core.model.plan import Compensation, Plan, PlannedStep, Point, Policy
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.route import flight_s
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.targets import CLEAR_M, TargetPlan
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.swarm.radio import LEAST_HZ, budget
from swarm_ctl.law_loader import own_law
from swarm_ctl.mission.checks import envelope
from swarm_ctl.mission.checks.group_checks import crowded
from swarm_ctl.mission.fleet.build_fleet import fleet_of
from swarm_ctl.mission.fleet.exposure import exposures
from swarm_ctl.mission.geometry.shapes import slot_count
from swarm_ctl.mission.input.document import ROUNDING, Findings, Mistake, Place
from swarm_ctl.mission.input.units import said
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.simulation_section import SimParameters
from swarm_ctl.mission.steps.table import KINDS, kind_of, place_of
from swarm_ctl.mission.written_steps import written_steps

_SMALLEST_R_IN_M = 1.0
_WEAK_R_OUT = 3.0
"""Units. At 7, random missions went under r_in that did not at 1.5."""
_UNSAFE_RATE = 1.0
"""kappa * h up to which no problem was seen in thousands of missions without filter or release."""
CLIMB_ROOM_M: Final = 2.0
CLIMB_WIND_MPS: Final = 4.0
"""Drawn take-offs with so much room beyond r_in kept r_in in so much wind
(`tests/scenarios/test_take_off.py`)."""
_LONG_FLIGHT_S: Final = 900.0
_FAR_M: Final = 500.0
_SLOW_MPS: Final = 0.3
_LOW_M: Final = 2.0
_LOOKS: Final = 500
"""At a target that is played, at most."""
_MOST_RESERVE: Final = 50.0
_PLAIN_RATE = 0.05
"""kappa * h of the plain law that left no pair of a laggy swarm under r_in in trials; four times as
much did."""


def warnings(mission: MissionFile, plan: Plan) -> list[Mistake]:
    """Every warning; `allowed` is empty, since what they warn of is allowed."""
    return [finding for function in _WARNINGS for finding in function(mission, plan)]


def _close_starts(mission: MissionFile, plan: Plan) -> Findings:
    """One warning, of the closest pair."""
    r_out, unit = plan.law.r_out, plan.unit_m
    pairs = itertools.combinations(plan.agents, 2)
    apart = sorted((math.dist(a.start, b.start), a.id, b.id) for a, b in pairs)
    close = [pair for pair in apart if pair[0] < r_out - ROUNDING]
    if close:
        nearest, i, j = close[0]
        room = (nearest - plan.law.r_in) * unit >= CLIMB_ROOM_M - ROUNDING
        when = f" of more than {CLIMB_WIND_MPS:g} m/s" if room else ", and as they land there"
        more = f" (and {len(close) - 1} more pairs)" if len(close) > 1 else ""
        what = (
            f"agents {i} and {j} start {said(nearest * unit, mission)} apart{more},"
            f" inside each other's avoidance region (law.r_out, {said(r_out * unit, mission)}):"
            f" they may come under law.r_in as they take off in wind{when}"
        )
        yield Mistake(("agents",), what, "")


def _stretched_links(mission: MissionFile, plan: Plan) -> Findings:
    """One warning for each shape, with what would be enough."""
    r, links = plan.law.r, {agent.id: agent.neighbours for agent in plan.agents}
    for at in plan.all_steps():
        form, ids = at.step.new_shape, at.group.ids
        if at.number == at.group.before + 1:
            links |= {agent.id: agent.neighbours for agent in at.group.agents}
        if form is None:
            continue
        if form.neighbours:
            links |= dict(zip(ids, form.neighbours, strict=True))
        slots = dict(zip(ids, form.slots, strict=True))
        chosen = {i: links[i] for i in ids}
        lengths = sorted((math.dist(slots[i], slots[j]), i, j) for i, j in graph.edges(chosen))
        beyond = [link for link in lengths if link[0] > r + ROUNDING]
        if not beyond:
            continue
        longest, i, j = beyond[-1]
        many = f"{len(beyond)} links, the longest" if len(beyond) > 1 else "the link"
        length = said(longest * plan.unit_m, mission, least=True)
        what = (
            f"{form.shape} stretches {many} {i}-{j} to {length}, beyond"
            f" law.r = {said(r * plan.unit_m, mission)}; r of {length} is enough"
        )
        if _rechosen_fit(at.before, slots, r):
            what += ", or neighbours: rechoose in this step"
        yield Mistake((*place_of(at), "shape"), what, "")


def _rechosen_fit(before: PlannedFormation, slots: dict[int, Point], r: float) -> bool:
    """Whether the links that `rechoose` gives are connected, and no longer than r in the shape."""
    rechosen = graph.neighbours(dict(zip(slots, before.offsets, strict=True)), r)
    fit = all(math.dist(slots[i], slots[j]) <= r + ROUNDING for i, j in graph.edges(rechosen))
    return fit and len(graph.components(rechosen)) == 1


# --- slips: sound for a parser, and for no pilot ---


def _long_flight(_mission: MissionFile, plan: Plan) -> Findings:
    times = [(kind_of(at.step).least_s(at.step, at), at) for at in plan.all_steps()]
    whole_s = flight_s(plan, [least_s for least_s, _ in times])
    if whole_s > _LONG_FLIGHT_S:
        longest_s, longest = max(times, key=lambda each: each[0])
        what = (
            f"takes {longest_s:.0f} s at least, of a flight of {whole_s:.0f} s: most"
            f" batteries end after about {_LONG_FLIGHT_S:g} s"
        )
        yield Mistake(place_of(longest), what, "")


def _far_away(mission: MissionFile, plan: Plan) -> Findings:
    """A fence that is not drawn grows with the mission, so it stops no slip."""
    if mission.fence.polygon is not None:
        return
    for at in plan.all_steps():
        starts = [plan.agent(agent).start for agent in at.group.ids]
        home = PlannedFormation.at_start(starts, plan.unit_m).centre_m
        away_m = max((math.dist(home, point) for point in at.step.way_m), default=0.0)
        if away_m > _FAR_M:
            what = (
                f"goes {said(away_m, mission)} from the starts, out of a pilot's sight; the"
                " geofence grows with it: draw one in fence.polygon"
            )
            yield Mistake(place_of(at), what, "")


def _slow(_mission: MissionFile, plan: Plan) -> Findings:
    for at in plan.all_steps():
        if (path := at.step.path) is not None and path.speed_mps < _SLOW_MPS:
            what = f"{path.speed_mps:g} m/s is less than a GPS position drifts"
            yield Mistake((*place_of(at), "speed_mps"), what, "")
    if plan.limits.speed_mps < _SLOW_MPS:
        what = f"{plan.limits.speed_mps:g} m/s is less than a GPS position drifts"
        yield Mistake(("vehicle", "limits", "speed_mps"), what, "")


def _low(_mission: MissionFile, plan: Plan) -> Findings:
    for at in plan.all_steps():
        if (up_m := at.step.climbs_to_m) is not None and up_m < _LOW_M:
            low = f"{up_m:g} m"
            what = f"{low}: rotors blow back from the ground, and height estimates err"
            yield Mistake((*place_of(at), "height_m"), what, "")


def _loose_tolerance(mission: MissionFile, plan: Plan) -> Findings:
    """Formed before it is flown."""
    for at in plan.all_steps():
        if (form := at.step.new_shape) is not None:
            apart = smallest_distance(form.slots, form.ups_m, plan.slot_layer_m)
            apart_m = apart * plan.unit_m
            if apart_m / 2 < form.tolerance_m:
                what = (
                    f"{form.tolerance_m:g} m is more than half of what {form.shape}'s slots are"
                    f" apart ({said(apart_m, mission)}): it counts as formed when it is not"
                )
                yield Mistake((*place_of(at), "tolerance_m"), what, "")


def _wakes(_mission: MissionFile, plan: Plan) -> Findings:
    """Each pair of which one hovers in the wake of the other, as the slots are planned."""
    wake = plan.wake
    for at in plan.all_steps():
        form = at.step.new_shape
        if form is None or wake is None:
            continue
        places, heights = at.after.places_m(), at.after.heights_m
        of = list(zip(at.group.ids, places, heights, strict=True))
        for (i, at_i, high_i), (j, at_j, high_j) in itertools.permutations(of, 2):
            below_m, beside_m = high_i - high_j, math.dist(at_i, at_j)
            if in_wake(beside_m, below_m, wake.rotor_distance_m):
                what = (
                    f"in {form.shape} agent {j} hovers in the wake of agent {i}, {below_m:.1f} m"
                    f" below it: the air goes down at up to {wake_mps(wake.mass_kg, below_m):.1f}"
                    " m/s there"
                )
                yield Mistake((*place_of(at), "shape"), what, "")


def _crowded_groups(mission: MissionFile, plan: Plan) -> Findings:
    r_out = said(plan.law.r_out * plan.unit_m, mission)
    for at, agent, other, apart_m in crowded(plan):
        apart = said(apart_m, mission)
        what = (
            f"agent {agent} is to be {apart} from agent {other}, which stays: so far inside its"
            f" avoidance region (law.r_out, {r_out}) it may not come to its place"
        )
        yield Mistake(place_of(at), what, "")


def _grounded_groups(mission: MissionFile, plan: Plan) -> Findings:
    """The steps of such a group are not flown, and the mission is completed all the same."""
    waiting = {agent.id for agent in plan.agents if agent.waits}
    for name, members in mission.groups.items():
        if waiting.issuperset(members):
            what = "each of its agents waits on the ground: an order `launch` has to send them up"
            yield Mistake(("groups", name), what, "")


def _limits_at_once(_mission: MissionFile, plan: Plan) -> Findings:
    """A policy that acts in a flight without any trouble."""
    policies, speed_mps = plan.policies, plan.limits.speed_mps
    if policies.max_speed_mps <= speed_mps and policies.too_fast is not Policy.CONTINUE:
        what = (
            f"{policies.max_speed_mps:g} m/s is not above vehicle.limits.speed_mps ="
            f" {speed_mps:g}: {policies.too_fast} in ordinary flight"
        )
        yield Mistake(("policies", "max_speed_mps"), what, "")
    if policies.battery_reserve_percent > _MOST_RESERVE and (
        policies.battery_low is not Policy.CONTINUE
    ):
        what = (
            f"{policies.battery_reserve_percent:g} %: {policies.battery_low} with more than half"
            " of the battery left"
        )
        yield Mistake(("policies", "battery_reserve_percent"), what, "")


def _targets(_mission: MissionFile, plan: Plan) -> Findings:
    """Those that places of the formation are too near to; of those that are played, the ones that
    it can't keep up with, or may not follow."""
    of = {target.name: target for target in plan.targets}
    for at in plan.all_steps():
        step = at.step.follows
        if step is None:
            continue
        target = of[step.target]
        if what := _too_near(target, step, at):
            yield Mistake((*place_of(at), "target"), what, "")
        if not target.way_m:
            continue
        if target.speed_mps > step.speed_mps:
            what = (
                f"{target.name} is played at {target.speed_mps:g} m/s, and the formation flies at"
                f" most {step.speed_mps:g} m/s: it falls behind"
            )
            yield Mistake((*place_of(at), "target"), what, "")
        if what := _outside_with(target, step, at):
            yield Mistake((*place_of(at), "target"), f"{what}: the formation waits inside", "")


def _too_near(target: TargetPlan, step: FollowStep, at: PlannedStep) -> str:
    """Which place of the formation its agent keeps off, since it keeps clear of the target; ''."""
    above_m, formation, plan = step.above_m, at.before, at.plan
    if above_m is None and (target.height_m is not None or target.way_m):
        above_m = formation.height_m - (target.height_m or 0.0)
    if above_m is None or target.agent:
        return ""
    margins = margins_of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m)
    near_m, offset = margins.keep_out + margins.zone, complex(*step.offset_m)
    for place, up_m in zip(formation.places_m((0.0, 0.0)), formation.heights_m, strict=True):
        slot, over_m = complex(*place), above_m + up_m - formation.height_m
        room_m = abs(abs(slot) - abs(offset)) if step.in_course else abs(slot + offset)
        if room_m < near_m and abs(over_m) <= CLEAR_M:
            where = "on some course, " * step.in_course
            where += f"{room_m:.1f} m beside {target.name} and {abs(over_m):.1f} m"
            where += " above it" if over_m >= 0.0 else " below it"
            return (
                f"a place of the formation is {where}: its agent keeps clear of it, so the shape is"
                f" not kept; allowed: {near_m:.1f} m beside it, or more than {CLEAR_M:g} m above or"
                " below it"
            )
    return ""


def _outside_with(target: TargetPlan, step: FollowStep, at: PlannedStep) -> str:
    """How a played target, or a place about it, leaves the fence first; ''."""
    polygon = at.plan.fence.polygon_m if at.plan.fence is not None else ()
    every_s, offset, course = max(0.5, step.duration_s / _LOOKS), complex(*step.offset_m), 1 + 0j
    for k in range(math.ceil(step.duration_s / every_s) if polygon else 0):
        place, (north_mps, east_mps) = target.played(k * every_s)
        if step.until_m is not None and math.dist(place, step.until_m) <= step.until_within_m:
            return ""
        if speed := math.hypot(north_mps, east_mps):
            course = complex(north_mps, east_mps) / speed
        when, spot = (
            f"leaves the fence after {k * every_s:.0f} s",
            f"({place[0]:.0f}, {place[1]:.0f}) m",
        )
        if not inside(polygon, place):
            return f"{target.name} {when}, at {spot}"
        centre = complex(*place) + offset * (course if step.in_course else 1.0)
        around = at.before.places_m((centre.real, centre.imag))
        if not all(inside(polygon, each) for each in around):
            return f"a place of the formation {when}, with {target.name} at {spot}"
    return ""


def _doubtful_steps(mission: MissionFile, _plan: Plan) -> Findings:
    for _, place, entry in written_steps(mission):
        yield from KINDS[entry.kind].doubtful(entry.body, (*place, entry.kind))


def _small_r_in(_mission: MissionFile, plan: Plan) -> Findings:
    r_in_m = plan.law.r_in * plan.unit_m
    if r_in_m < _SMALLEST_R_IN_M:
        what = f"{r_in_m:.2g} m: vehicles and GPS errors are larger than that"
        yield Mistake(("law", "r_in"), what, "")


def _weak_avoidance(_mission: MissionFile, plan: Plan) -> Findings:
    if plan.law.r_out > _WEAK_R_OUT:
        what = (
            f"{plan.law.r_out:.3g} units: the law's repulsion is weak at radii so far above the"
            " paper's 1.5; a larger unit_m, or lengths: metres without a unit_m, makes it strong"
        )
        yield Mistake(("law", "r_out"), what, "")


def _law_for_tests(mission: MissionFile, _plan: Plan) -> Findings:
    name = mission.law.own
    if name not in (None, "paper") and own_law(name).for_tests:
        what = f"the law {name} is for tests: it forms no shape, and what keeps vehicles apart is"
        yield Mistake(("law", "own"), f"{what} the filter alone", "")


def _fast_gain(_mission: MissionFile, plan: Plan) -> Findings:
    rate = plan.kappa * plan.law.h
    if plan.compensation is Compensation.NONE and rate > _PLAIN_RATE + 1e-9:
        what = (
            f"none, with kappa * h = {rate:.3g}: on vehicles with dead time and lag the plain law"
            " brings pairs under r_in; stop_point does not, nor does kappa * h up to"
            f" {_PLAIN_RATE:g}"
        )
        yield Mistake(("law", "compensation"), what, "")
    guarded = plan.safety.filter and plan.safety.release
    if plan.compensation is Compensation.STOP_POINT and not guarded and rate > _UNSAFE_RATE + 1e-9:
        more = "" if plan.safety.filter else ", or come under r_in"
        what = (
            f"kappa * h = {rate:.3g}: above {_UNSAFE_RATE:g} the agents block each other more"
            f" often{more}"
        )
        yield Mistake(("law", "h"), what, "")


def _outside_the_envelope(_mission: MissionFile, plan: Plan) -> Findings:
    if plan.safety.filter:
        yield from envelope.outside(plan)
    elif plan.compensation is Compensation.STOP_POINT:
        what = (
            "off: what docs/understand/safety-evidence.md says of distances does not hold"
            " for this mission"
        )
        yield Mistake(("safety", "filter"), what, "")


def _spare_fleet(mission: MissionFile, _plan: Plan) -> Findings:
    flying = {agent.id for agent in mission.agents}
    for k, entry in enumerate(mission.fleet.agents if mission.fleet else ()):
        if entry.id not in flying:
            yield Mistake(("fleet", "agents", k), f"agent {entry.id} is not in this mission", "")


def _real_vehicles(mission: MissionFile, _plan: Plan) -> Findings:
    """Weather and faults change simulated vehicles only."""
    entries, section = mission.fleet.agents if mission.fleet else (), mission.simulation
    flying = {agent.id for agent in mission.agents}
    real = {e.id for e in entries if e.endpoint or e.kind is not VehicleKind.SIMULATED} & flying
    spared: dict[Place, set[int]] = {("parameters",): real if section.parameters.given() else set()}
    for k, fault in enumerate(section.faults):
        spared["faults", k] = real & set(fault.agents or real)
    for place, ids in spared.items():
        if ids:
            named = ", ".join(map(str, sorted(ids)))
            what = f"ignored by agents with a vehicle of their own: {named}"
            yield Mistake(("simulation", *place), what, "")


def _gusts(mission: MissionFile, plan: Plan) -> Findings:
    """Those that are simulated; of others nothing is known."""
    section, most_mps = mission.simulation, envelope.most_gusts_mps(plan)
    sets: list[tuple[Place, SimParameters]] = [(("parameters",), section.parameters)]
    sets += [(("faults", k, "set"), fault.set) for k, fault in enumerate(section.faults)]
    for place, given in sets:
        gusts_mps = given.SIM_WIND_GUST or 0.0
        if plan.safety.filter and gusts_mps > most_mps + ROUNDING:
            what = (
                f"gusts of {gusts_mps:g} m/s may bring pairs under r_in; r_in and r_out leave room"
                f" for {math.floor(most_mps * 100) / 100:g} m/s"
            )
            yield Mistake(("simulation", *place, "SIM_WIND_GUST"), what, "")


def _px4s_in_small_units(mission: MissionFile, plan: Plan) -> Findings:
    """Drawn and real ones came under r_in there (`PX4_ROOM_M`); why is not known for sure."""
    room_m, least_m = envelope.room_m(plan), envelope.PX4_ROOM_M
    px4s = any(agent.autopilot == "px4" for agent in fleet_of(mission).agents)
    if px4s and plan.safety.filter and room_m < least_m - ROUNDING:
        what = (
            "PX4s that pass each other may come under r_in, which leaves them"
            f" {room_m:.3g} m to r_out; {least_m:g} m are enough"
        )
        yield Mistake(("law", "r_in"), what, "")


def _open_to_others(mission: MissionFile, _plan: Plan) -> Findings:
    fleet = fleet_of(mission)
    exposed = exposures(fleet)
    if exposed:
        more = f" (and {len(exposed) - 1} more)" if len(exposed) > 1 else ""
        what = f"{exposed[0]}{more}, and there are no keys: run refuses it; swarm-ctl trust new"
        what += " --fleet FILE makes them, and trust: FOLDER in the fleet names them"
        if fleet.trust is not None:
            what = f"{exposed[0]}{more}, with signing: off: run refuses it; signing: required"
        yield Mistake(("fleet", "agents"), what, "")


def _shared_ids(mission: MissionFile, _plan: Plan) -> Findings:
    """Two agents of one id on one radio: the one's heartbeats keep the other's vehicle up."""
    entries = fleet_of(mission).agents
    used = Counter(entry.agent_sysid for entry in entries)
    several = sum(times for times in used.values() if times > 1)
    if several:
        what = (
            f"the MAVLink system ids do not suffice: {several} agents share theirs. On a radio that"
            " two of them share, the one keeps the other's ArduCopter up when that agent is dead"
        )
        yield Mistake(("fleet",) if mission.fleet else ("agents",), what, "")


def _narrow_radios(mission: MissionFile, _plan: Plan) -> Findings:
    """A radio that does not carry what its vehicles need."""
    fleet = fleet_of(mission)
    signed = fleet.signing is SigningPolicy.REQUIRED
    for endpoint, agents in fleet.radios().items():
        gets = {a: budget(a.radio, a.autopilot, signed=signed) for a in agents if a.radio}
        worst = min(gets.values(), key=lambda each: each.hz)
        radio = next(iter(gets)).radio
        if radio is not None and not all(each.carried for each in gets.values()):
            what = (
                f"{endpoint} carries {radio.bytes_per_s} bytes/s; its {len(agents)} vehicles need"
                f" {worst.needed_bytes_per_s:.0f} for {LEAST_HZ:g} setpoints and positions a second"
                f" each{', signed' if signed else ''}: with fewer, a lost frame stops a vehicle."
                " A faster radio, or fewer vehicles behind it"
            )
            yield Mistake(("fleet", "agents"), what, "")


def _unknown_wind(mission: MissionFile, plan: Plan) -> Findings:
    """A limit that the mission states, and that may not act."""
    stated = {"wind", "wind_limit_mps"} & mission.policies.model_fields_set
    if stated and plan.policies.wind is not Policy.CONTINUE:
        what = (
            "acts only on vehicles that estimate the wind (ArduCopter with EK3_DRAG_BCOEF_X and _Y,"
            " PX4 with EKF2_DRAG_CTRL; as delivered neither does); max_tilt_deg"
            f" ({plan.policies.max_tilt_deg:g}) acts on all"
        )
        yield Mistake(("policies", max(stated)), what, "")


def _unused_shapes(mission: MissionFile, plan: Plan) -> Findings:
    bodies = (entry.body for _, _, entry in written_steps(mission))
    used = {body.shape_formed for body in bodies if body}
    agents, ordered = len(plan.agents), {shape.name for shape in plan.shapes}
    for name, shape in mission.shapes.items():
        if name not in used:
            have = slot_count(shape, agents)
            unfit = f", and no order can: it has {have} slots for {agents} agents"
            what = f"no step forms it{'' if name in ordered else unfit}"
            yield Mistake(("shapes", name), what, "")


_WARNINGS: tuple[Callable[[MissionFile, Plan], Findings], ...] = (
    _close_starts,
    _stretched_links,
    _small_r_in,
    _weak_avoidance,
    _law_for_tests,
    _fast_gain,
    _outside_the_envelope,
    _spare_fleet,
    _real_vehicles,
    _gusts,
    _px4s_in_small_units,
    _shared_ids,
    _narrow_radios,
    _open_to_others,
    _unknown_wind,
    _unused_shapes,
    _long_flight,
    _far_away,
    _slow,
    _low,
    _loose_tolerance,
    _wakes,
    _crowded_groups,
    _grounded_groups,
    _limits_at_once,
    _targets,
    _doubtful_steps,
)
