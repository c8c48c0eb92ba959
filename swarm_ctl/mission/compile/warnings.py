"""What a mission may do, but an operator should know before it flies."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.plan import Compensation, FormStep, Plan, Policy
from swarm_ctl.mission.compile import envelope
from swarm_ctl.mission.compile.checks import Findings
from swarm_ctl.mission.compile.fleet import fleet_of
from swarm_ctl.mission.input.document import Finding, Place
from swarm_ctl.mission.input.schema import MissionFile

_SMALLEST_R_IN_M = 1.0
_WEAK_R_OUT = 3.0
"""Units. At 7, random missions went under r_in that did not at 1.5."""
_UNSAFE_RATE = 1.0
"""kappa * h up to which no problem was seen in thousands of missions without filter or release."""
_PLAIN_RATE = 0.05
"""kappa * h of the plain law that left no pair of a laggy swarm under r_in in trials; four times as
much did."""


def warnings(mission: MissionFile, plan: Plan) -> list[Finding]:
    """Every warning; `allowed` is empty, since what they warn of is allowed."""
    return [finding for function in _WARNINGS for finding in function(mission, plan)]


def _close_starts(_mission: MissionFile, plan: Plan) -> Findings:
    r_out, unit = plan.law.r_out, plan.unit_m
    for a, b in itertools.combinations(plan.agents, 2):
        apart = math.dist(a.start, b.start)
        if apart < r_out:
            what = (
                f"agents {a.id} and {b.id} start {apart * unit:.4g} m apart,"
                f" inside each other's avoidance region (r_out, {r_out * unit:.4g} m)"
            )
            yield Finding(("agents",), what, "")


def _stretched_links(_mission: MissionFile, plan: Plan) -> Findings:
    links = [agent.neighbours for agent in plan.agents]
    ids = [agent.id for agent in plan.agents]
    for k, step in enumerate(plan.steps):
        if not isinstance(step, FormStep):
            continue
        links = list(step.neighbours or links)
        slots = dict(zip(ids, step.slots, strict=True))
        for i, j in graph.edges(dict(zip(ids, links, strict=True))):
            length = math.dist(slots[i], slots[j])
            if length > plan.law.r:
                what = (
                    f"{step.shape} stretches the link {i}-{j} to {length:.4g} units,"
                    f" beyond the interaction range r = {plan.law.r:g}"
                )
                yield Finding(("steps", k, "form", "shape"), what, "")


def _small_r_in(_mission: MissionFile, plan: Plan) -> Findings:
    r_in_m = plan.law.r_in * plan.unit_m
    if r_in_m < _SMALLEST_R_IN_M:
        what = f"{r_in_m:.2g} m: vehicles and GPS errors are larger than that"
        yield Finding(("law", "r_in"), what, "")


def _weak_avoidance(_mission: MissionFile, plan: Plan) -> Findings:
    if plan.law.r_out > _WEAK_R_OUT:
        what = (
            f"{plan.law.r_out:.3g} units: the law's repulsion is weak at radii so far above the"
            " paper's 1.5; a larger unit_m, or lengths: metres without a unit_m, makes it strong"
        )
        yield Finding(("law", "r_out"), what, "")


def _fast_gain(_mission: MissionFile, plan: Plan) -> Findings:
    rate = plan.kappa * plan.law.h
    if plan.compensation is Compensation.NONE and rate > _PLAIN_RATE + 1e-9:
        what = (
            f"none, with kappa * h = {rate:.3g}: on vehicles with dead time and lag the plain law"
            " brings pairs under r_in; stop_point does not, nor does kappa * h up to"
            f" {_PLAIN_RATE:g}"
        )
        yield Finding(("law", "compensation"), what, "")
    guarded = plan.safety.filter and plan.safety.release
    if plan.compensation is Compensation.STOP_POINT and not guarded and rate > _UNSAFE_RATE + 1e-9:
        more = "" if plan.safety.filter else ", or come under r_in"
        what = (
            f"kappa * h = {rate:.3g}: above {_UNSAFE_RATE:g} the agents block each other more"
            f" often{more}"
        )
        yield Finding(("law", "h"), what, "")


def _outside_the_envelope(_mission: MissionFile, plan: Plan) -> Findings:
    if plan.safety.filter:
        yield from envelope.outside(plan)
    elif plan.compensation is Compensation.STOP_POINT:
        what = "off: what docs/pages/safety.md says of distances does not hold for this mission"
        yield Finding(("safety", "filter"), what, "")


def _spare_fleet(mission: MissionFile, _plan: Plan) -> Findings:
    flying = {agent.id for agent in mission.agents}
    for k, entry in enumerate(mission.fleet.agents if mission.fleet else ()):
        if entry.id not in flying:
            yield Finding(("fleet", "agents", k), f"agent {entry.id} is not in this mission", "")


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
            yield Finding(("simulation", *place), what, "")


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
        yield Finding(("fleet",) if mission.fleet else ("agents",), what, "")


def _unknown_wind(mission: MissionFile, _plan: Plan) -> Findings:
    """A limit that the mission states, and that may not act."""
    stated = {"wind", "wind_limit_mps"} & mission.policies.model_fields_set
    if stated and mission.policies.wind is not Policy.CONTINUE:
        what = (
            "acts only on vehicles that estimate the wind (ArduCopter with EK3_DRAG_BCOEF_X and _Y,"
            " PX4 with EKF2_DRAG_CTRL; as delivered neither does); max_tilt_deg"
            f" ({mission.policies.max_tilt_deg:g}) acts on all"
        )
        yield Finding(("policies", max(stated)), what, "")


def _unused_shapes(mission: MissionFile, _plan: Plan) -> Findings:
    used = {step.form.shape for step in mission.steps if step.form}
    for name in mission.shapes:
        if name not in used:
            yield Finding(("shapes", name), "no step forms it", "")


_WARNINGS: tuple[Callable[[MissionFile, Plan], Findings], ...] = (
    _close_starts,
    _stretched_links,
    _small_r_in,
    _weak_avoidance,
    _fast_gain,
    _outside_the_envelope,
    _spare_fleet,
    _real_vehicles,
    _shared_ids,
    _unknown_wind,
    _unused_shapes,
)
