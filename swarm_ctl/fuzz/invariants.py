"""What must hold in every flight of a scenario, by the simulator's truth.

Each check is a sentence of docs/do/fuzz.md. It looks at the vehicles, not at what agents say of
them; where it needs an agent's word (that an order was taken, why a mission broke off), the word is
held against the truth. What a scenario takes out of the swarm's hands (a pilot, a vehicle that
tells a wrong place, an agent that lies) is left out for as long as that lasts, and no longer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.agent.agent import STATUS_EVERY_S
from swarm_ctl.core.agent.landing import BESIDE, STANDING_WANDERS_M, WANDERS_M
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import AgentState, CommandKind, Outcome, Phase, StepOutcome
from swarm_ctl.core.model.plan import Fence, Policy, Zone
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import MISPLACED_M, OVER_M
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.safety.surroundings import Outline
from swarm_ctl.fuzz.losses import ACTS_S, policies_act
from swarm_ctl.fuzz.seen import FLIES, FREE_M, Seen
from swarm_ctl.fuzz.setpoints import rooms_are_shared
from swarm_ctl.mission.checks.group_checks import crowded
from swarm_ctl.mission.compile.forecast import forecast
from swarm_ctl.report.judge.summary import StepVerdict
from swarm_ctl.runfolder.truth import EventKind
from swarm_ctl.virtual.scenario_flight import FlownScenario, GivenOrder

_OUT_M: Final = 2.0
_OUT_S: Final = 2.0
"""Beyond the fence for longer and farther, a policy has to have acted."""
_LEAVES_S: Final = 8.0
_LEAVES: Final = 10.0
"""A zone that is added over a vehicle is left in so long, and so many times its way out at top
speed: it leaves at a fifth of that at least, and others are in its way."""
_MOVES_M: Final = 1.0
"""On the ground, disarmed."""
_BOUNCES_S: Final = 3.0
"""In gusts a vehicle may touch the ground again as it takes off."""
_TOUCHES_MPS: Final = 0.3
"""A landing is no slower than this, in the mean."""
_FASTER: Final = 1.25
_FASTER_MPS: Final = 0.5
_CLIMBS: Final = 1.5
"""Autopilots overshoot a setpoint by so much: 1.11 and 1.20 of the limits were the most in 120
flights."""
_CLEAR: Final = 1.1
"""In r_in: what is left in fair weather (docs/understand/safety-evidence.md)."""
_AGE_S: Final = 1.0
"""The age of a link is off by a status, and by what the mesh delays."""
_COUNTED: Final = 200
"""States are enough to know the share that is lost, within ..."""
_LOSS: Final = 0.05
_DUE: Final = 20
_LEAST_LOST: Final = 0.25
"""Where so many states are lost in the mean, fewer than this share never are."""
_STANDS_MPS: Final = 1.0
"""Who begins to land is slower than this, in still air ..."""
_BRAKES_S: Final = 2.5
"""... or has braked for so long by its words, which come at 2 Hz."""
_ROOM_S: Final = 8.0
"""Who has no room to land looks for it at least so long."""
_TOLD_S: Final = 2.0
"""What an agent has told for so long, the others know."""
_OLD_S: Final = 0.8
"""What it knows of others is older by less."""
_SHORT_M: Final = 0.05
_SHORT_S: Final = 0.3
"""By so much a status is older than what brought it about."""
_ALONE_S: Final = 4.5
"""A vehicle follows its last setpoint for a second at most, and then it brakes."""
_BATTERY_S: Final = 600.0
"""A full one lasts so long."""
_FAIR: Final = 1.5
_FAIR_S: Final = 8.0
"""A step in fair weather takes at most so many times its forecast, and so much more."""
_FAIR_SHARE: Final = 0.8
"""There pairs come no nearer than this share of the forecast: 0.86 was the least in 40 flights."""


class Invariant(StrEnum):
    """One that a flight may break."""

    ENDS = "it ends within its bound"
    DOWN = "all are down and disarmed in the end"
    APART = "no pair is under r_in"
    ROOM = "no agent takes more than its share of the room to another one"
    FENCED = "nobody is out of the fence without its policy acting"
    ZONED = "no vehicle is in a zone"
    SLOW = "no vehicle is faster than it may be"
    ORDERED = "nothing moves that was not ordered"
    TOGETHER = "no agent goes on before the others are done"
    OBEYS = "an order that was accepted is carried out"
    ACTS = "what is lost makes its policy act"
    HEARD = "what an agent says of its links is so"
    VERDICT = "verdict, cause and truth agree"
    FORECAST = "the forecast holds in fair weather"
    RAISES = "no error is raised"
    SAME = "the same seed has the same bytes"
    ALIKE = "processes in lockstep fly what the virtual clock flies"


@dataclass(frozen=True, slots=True)
class Broken:
    """An invariant that did not hold, and how."""

    invariant: Invariant
    text: str


def broken(flown: FlownScenario) -> list[Broken]:
    """All that did not hold in this flight. The last three are for whoever flies it."""
    seen = Seen(flown)
    return [Broken(invariant, text) for invariant, check in CHECKS.items() for text in check(seen)]


def _ends(seen: Seen) -> Iterator[str]:
    up = [agent for agent in seen.flown.up if not math.isfinite(seen.taken[agent])]
    if up:
        yield f"{agents_named(up)} had not ended by {seen.flown.bound_s:.0f} s"


def _down(seen: Seen) -> Iterator[str]:
    truth = seen.truth
    if not len(truth.time_s):
        yield "there is no truth of it"
        return
    for agent in seen.ids:
        k = seen.column[agent]
        if not (truth.armed[-1, k] or truth.airborne[-1, k]) or math.isfinite(seen.taken[agent]):
            continue
        how = "in the air" if truth.airborne[-1, k] else "armed"
        yield f"the vehicle of agent {agent} was {how} at the end, {truth.time_s[-1]:.1f} s"
    for agent in sorted(set(seen.ids) - seen.elsewhen):
        last, k = seen.statuses[agent][-1:], seen.column[agent]
        yield from _ends_up(seen, agent)
        results = last[0].steps[1:] if last else ()
        for planned, step in zip(seen.route(agent).steps, results, strict=False):
            if not planned.goes_down or step.result is not StepOutcome.DONE or step.end_s is None:
                continue
            at = int(np.searchsorted(truth.time_s, step.end_s))
            on = at < len(truth.time_s) and (truth.armed | truth.airborne)[at, k]
            if on and step.end_s < min(seen.taken[agent], seen.lies[agent]):
                how = "in the air" if truth.airborne[at, k] else "armed"
                yield f"agent {agent} was done with `{step.name}` at {step.end_s:.1f} s, {how}"


def _ends_up(seen: Seen, agent: int) -> Iterator[str]:
    """An agent goes on until its vehicle is down and disarmed, or it says why not."""
    last, truth = seen.statuses[agent][-1:], seen.truth
    if not last or last[0].phase is not Phase.ENDED or last[0].cause in _OTHER_HANDS:
        return
    at_s = last[0].time_s
    at = min(int(np.searchsorted(truth.time_s, at_s + 0.2)), len(truth.time_s) - 1)
    if at_s < min(seen.taken[agent], seen.lies[agent]) and truth.armed[at, seen.column[agent]]:
        yield f"agent {agent} ended at {at_s:.1f} s, and its vehicle was armed"


_OTHER_HANDS: Final = (Cause.PILOT, Cause.VEHICLE, Cause.VEHICLE_LINK)


def _apart(seen: Seen) -> Iterator[str]:
    if not (seen.enveloped and seen.good_mesh):
        return
    close = seen.apart_at_start < seen.r_in_m + FREE_M
    least_m = seen.r_in_m * (_CLEAR if seen.fair else 1.0)
    for a, b in itertools.combinations(seen.ids, 2):
        until_s = min(seen.taken[a], seen.taken[b], seen.lies[a], seen.lies[b])
        if seen.plan.wake is not None:  # what falls, falls past those below
            kills = (*seen.orders(a, CommandKind.KILL), *seen.orders(b, CommandKind.KILL))
            until_s = min([until_s, *(order.at_s for order in kills)])
        spared_m = np.zeros(len(seen.truth.time_s))
        if seen.misjudged_m:
            spared_m += np.maximum(0.0, seen.off_m(a) + seen.off_m(b) - seen.spared_m)
        for dead, other in ((a, b), (b, a)):
            # beside a landing that looks for nobody another one's landing drifts
            alone = _lands_unheard(seen, dead) & ~_flown_by_agents(seen, other, FLIES)
            spared_m = np.maximum(spared_m, np.where(alone, min(WANDERS_M, 0.5 * least_m), 0.0))
        counts = seen.truth.time_s < until_s
        found = _closest(seen, a, b, counts, autopilots=not close, spared_m=spared_m)
        if found is not None and found[0] < least_m:
            near_m, time_s = found
            under = f"{_CLEAR} times r_in" if seen.fair else "r_in"
            yield (
                f"agents {a} and {b} were {near_m:.2f} m apart at {time_s:.1f} s, all that is off"
                f" counted, under {under}, {least_m:.2f} m"
            )


def _lands_unheard(seen: Seen, agent: int) -> npt.NDArray[np.bool_]:
    """(T,): while its vehicle is without an agent."""
    time_s, found = seen.truth.time_s, np.zeros(len(seen.truth.time_s), dtype=np.bool_)
    for each in seen.of("kill", "stop"):
        if agent in (each.kill or each.stop or ()):
            again = (b.at_s for b in seen.of("restart") if agent in (b.restart or ()))
            ends = [at_s for at_s in again if at_s > each.at_s]
            ends += [each.until_s] if each.for_s else []
            found |= (time_s > each.at_s) & (time_s < min(ends, default=math.inf) + _BRAKES_S)
    return found


def _closest(
    seen: Seen,
    a: int,
    b: int,
    when: npt.NDArray[np.bool_] | None,
    *,
    autopilots: bool,
    spared_m: npt.NDArray[np.float64] | float = 0.0,
) -> tuple[float, float] | None:
    """Of a pair while `when` holds (None: always): how close [m] and when; what is spared at a time
    is added. Both in the air; and
    with `autopilots` also where one stands, up to `OVER_M` below. Without, only where agents fly
    both."""
    truth, one, other = seen.truth, seen.track(a), seen.track(b)
    up = seen.airborne(a) & seen.airborne(b)
    counts = np.ones(len(truth.time_s), dtype=np.bool_) if when is None else when
    if autopilots:
        level = np.abs(one[:, 2] - other[:, 2]) <= OVER_M
        counts = counts & (up | ((seen.airborne(a) | seen.airborne(b)) & level))
    else:
        counts = counts & up & _flown_by_agents(seen, a) & _flown_by_agents(seen, b)
    if not counts.any():
        return None
    gap = np.linalg.norm(one[:, :2] - other[:, :2], axis=1) + spared_m
    counts = counts & (np.abs(one[:, 2] - other[:, 2]) < seen.plan.layer_m)
    gap[~counts] = np.inf
    at = int(gap.argmin())
    return (float(gap[at]), float(truth.time_s[at])) if math.isfinite(gap[at]) else None


def _flown_by_agents(
    seen: Seen, agent: int, phases: tuple[Phase, ...] = (Phase.FLY, Phase.HOLD)
) -> npt.NDArray[np.bool_]:
    """(T,): while its vehicle follows setpoints, by its phases."""
    time_s, found = seen.truth.time_s, np.zeros(len(seen.truth.time_s), dtype=np.bool_)
    said = seen.statuses[agent]
    for status, later in itertools.pairwise(said):
        if status.phase in phases and later.phase in phases:
            found |= (time_s >= status.time_s) & (time_s <= later.time_s)
    return found


def _slow(seen: Seen) -> Iterator[str]:
    """While it follows an agent's setpoints, and has had time to brake from what it did before;
    wind and an estimate that is off add to it."""
    truth, limits = seen.truth, seen.plan.limits
    more_mps = _FASTER_MPS + 0.5 * seen.wind_mps + seen.misjudged_m
    for agent in set(seen.ids) - seen.elsewhen:
        hands_s = min(seen.taken[agent], seen.lies[agent], seen.first(agent, "kill", "stop"))
        flown = _flown_by_agents(seen, agent)
        since_s = np.maximum.accumulate(np.where(flown, -math.inf, truth.time_s))
        counts = (truth.time_s - since_s > _BRAKES_S) & (truth.time_s < hands_s)
        if counts.sum() < 2:
            continue
        down_mps = np.gradient(seen.track(agent)[:, 2], truth.time_s)
        for what, speed_mps, most_mps in (
            ("flew", seen.speed_mps(agent), _FASTER * limits.speed_mps),
            ("climbed", -down_mps, _CLIMBS * limits.climb_mps),
            ("sank", down_mps, _CLIMBS * limits.descent_mps),
        ):
            fastest_mps = float(speed_mps[counts].max())
            if fastest_mps > most_mps + more_mps:
                at_s = float(truth.time_s[counts][int(speed_mps[counts].argmax())])
                yield f"agent {agent} {what} at {fastest_mps:.1f} m/s, {at_s:.1f} s"


def _fenced(seen: Seen) -> Iterator[str]:
    fence, truth, policy = seen.plan.fence, seen.truth, seen.plan.policies.fence
    if fence is None or policy is Policy.CONTINUE:
        return
    for agent in set(seen.ids) - seen.elsewhen:
        dead_s = seen.first(agent, "kill", "stop")
        told = _misled(seen, agent)
        until_s = min(dead_s, seen.taken[agent]) if told is None else min(dead_s, told.until_s)
        track = seen.track(agent) + (0.0 if told is None else told.off_m)
        counts = seen.airborne(agent) & (truth.time_s < until_s)
        if told is not None:
            counts &= (truth.time_s >= told.from_s) & _flown_by_agents(seen, agent)
        out_s = None
        for k in np.flatnonzero(counts).tolist():
            n, e, d = track[k].tolist()
            if not _far_out(fence, n, e, d):
                out_s = None
                continue
            out_s = float(truth.time_s[k]) if out_s is None else out_s
            if truth.time_s[k] - out_s > _OUT_S and not _acts(seen, agent, out_s, policy):
                was = "was" if told is None else "was told to be"
                yield (
                    f"agent {agent} {was} at ({n:.1f}, {e:.1f}), {-d:.1f} m high, out of the fence,"
                    f" from {out_s:.1f} s on, and did not {policy}"
                )
                break


def _far_out(fence: Fence, north: float, east: float, down: float) -> bool:
    """Beyond the fence by more than `_OUT_M`."""
    polygon = np.array(fence.polygon_m)
    middle = polygon.mean(axis=0).tolist() if len(polygon) else (0.0, 0.0)
    way = math.hypot(north - middle[0], east - middle[1]) or 1.0
    back = min(1.0, _OUT_M / way)  # a point that much nearer to the middle
    nearer = (north + (middle[0] - north) * back, east + (middle[1] - east) * back)
    return -down > fence.height_m + _OUT_M or not inside(fence.polygon_m, nearer)


class _Misled(NamedTuple):
    """What a vehicle believes while its GPS has jumped."""

    from_s: float
    until_s: float
    off_m: npt.NDArray[np.float64]
    """(3,), its word less the truth."""


def _misled(seen: Seen, agent: int) -> _Misled | None:
    """Where a jump of its GPS alone takes the agent's vehicle out of the swarm's hands: until then
    it is where it says, and from then on so far beside."""
    taken_s, found = seen.taken[agent], None
    if seen.from_start:
        for from_s, until_s, agents, values, pilot in seen.faults:
            if agent not in agents or until_s <= taken_s:
                continue
            jump = np.array([values.get(f"SIM_GPS_JUMP_{axis}", 0.0) for axis in "NED"])
            if found is None and from_s == taken_s and values and not pilot and jump.any():
                found = _Misled(from_s, until_s, jump)
            elif found is not None:
                found = found._replace(until_s=min(found.until_s, from_s))
    return found


def _zoned(seen: Seen) -> Iterator[str]:
    """By truth, and although its clearance is for errors of its own estimate. Who is in a zone that
    is added in flight, or can't stop before it, has time to leave it; a landing is not broken off.
    """
    truth = seen.truth
    for agent in set(seen.ids) - seen.elsewhen:
        until_s = min(seen.taken[agent], seen.first(agent, "kill", "stop"))
        counts = seen.airborne(agent) & (truth.time_s < until_s)
        track, flown = seen.track(agent), _flown_by_agents(seen, agent, FLIES)
        for zone, since_s, lifted_s in seen.zones(agent) if seen.plan.safety.filter else ():
            low = -math.inf if zone.floor_m is None else zone.floor_m
            high = math.inf if zone.ceiling_m is None else zone.ceiling_m
            free_s = _free_s(seen, agent, zone, since_s)
            there = counts & (-track[:, 2] > low) & (-track[:, 2] < high)
            there &= (truth.time_s >= free_s) & (truth.time_s < lifted_s) & ~seen.blown
            if since_s > 0:  # one that was coming down already goes on
                there &= np.logical_or.accumulate(flown & (truth.time_s >= since_s))
            for k in np.flatnonzero(there).tolist():
                n, e, d = track[k].tolist()
                off_m = 0.0 if flown[k] else WANDERS_M  # an autopilot's landing drifts
                around = ((0.0, 0.0), (off_m, 0.0), (-off_m, 0.0), (0.0, off_m), (0.0, -off_m))
                if all(zone.contains((n + dn, e + de)) for dn, de in around):
                    at = f"({n:.1f}, {e:.1f}), {-d:.1f} m high, {truth.time_s[k]:.1f} s"
                    since = f", which holds since {since_s:.1f} s" if since_s > 0 else ""
                    left = f", and had time to leave it until {free_s:.1f} s"
                    since += left if free_s > since_s else ""
                    yield f"agent {agent} was in zone {zone.name} at {at}{since}"
                    break


def _free_s(seen: Seen, agent: int, zone: Zone, since_s: float) -> float:
    """From when on an agent is out of a zone that holds since then: at once, but for one that is in
    it, or so near that it can't stop before it."""
    truth, plan = seen.truth, seen.plan
    when = np.abs(truth.time_s - since_s) <= 2.0 * STATUS_EVERY_S
    corners = [complex(*corner) for corner in zone.corners_m]
    outline, leaves_s = Outline(corners, zone.radius_m), 0.0
    late_s = plan.response.dead_time_s + plan.response.lag_s + STATUS_EVERY_S
    places, speeds = seen.track(agent)[when, :2].tolist(), seen.speed_mps(agent)[when].tolist()
    for (north, east), v in zip(places, speeds, strict=True):
        gap_m = min(wall.gap for wall in outline.walls(complex(north, east), 0))
        stop_m = v * late_s + v * v / plan.response.acceleration_mps2
        if gap_m < stop_m + zone.clearance_m:
            way_m = max(0.0, stop_m - gap_m) + zone.clearance_m
            leaves_s = max(leaves_s, _LEAVES_S + _LEAVES * way_m / plan.limits.speed_mps)
    return since_s + leaves_s


def _acts(seen: Seen, agent: int, at_s: float, policy: Policy) -> bool:
    """Whether the agent did what this policy says by then, or more, or had ended."""
    said = [s for s in seen.statuses[agent] if at_s - 1.0 <= s.time_s <= at_s + ACTS_S]
    least = FailsafeAction(policy.value).rank
    return not said or any(
        s.phase in (Phase.LAND, Phase.RETURN, Phase.ENDED)
        or (s.action is not None and s.action.rank >= least)
        for s in said
    )


def _ordered(seen: Seen) -> Iterator[str]:
    truth = seen.truth
    for agent in seen.ids:
        steps = enumerate(seen.route(agent).steps, 1)
        up = next((k for k, step in steps if step.climbs_to_m is not None), 1)
        launched = bool(seen.orders(agent, CommandKind.LAUNCH))
        flies_s = math.inf if launched else seen.step_start(agent, up + 1)
        track, taken_s = seen.track(agent), seen.taken[agent]
        lifts = [at for at in seen.events(agent, EventKind.LIFTOFF) if at < taken_s]
        stops = [order.at_s for order in seen.orders(agent, *_STOPS)]
        starts = [each.at_s for each in seen.of("restart") if agent in (each.restart or ())]
        for at in lifts:
            began_s = max((start_s for start_s in starts if start_s < at), default=0.0)
            if at > min(lift for lift in lifts if lift > began_s) + _BOUNCES_S:
                yield f"agent {agent} took off again at {at:.1f} s"
            if at > flies_s + 1.0:
                yield f"agent {agent} took off at {at:.1f} s, the others fly since {flies_s:.1f} s"
            if any(given < at - 2.0 for given in stops):
                yield f"agent {agent} took off at {at:.1f} s, after {min(stops):.1f} s told to land"
        k = seen.column[agent]
        stands = ~truth.armed[:, k] & ~truth.airborne[:, k]
        for run in _runs(stands):
            moved = np.linalg.norm(track[run] - track[run.start], axis=1)
            if len(moved) and moved.max() > _MOVES_M:
                at = float(truth.time_s[run][int(moved.argmax())])
                yield f"agent {agent} moved by {moved.max():.1f} m on the ground by {at:.1f} s"
        yield from _lands_in_flight(seen, agent)
        yield from _lands_beside(seen, agent)
        yield from _flies_alone(seen, agent)
        for order in seen.orders(agent, CommandKind.LAND):
            moved_m = _way_down(seen, agent, order.at_s)
            if seen.calm and moved_m > _may_slide(seen):
                yield f"agent {agent} flew {moved_m:.1f} m after `{order.line}`, {order.at_s:g} s"


_STOPS: Final = (CommandKind.LAND, CommandKind.KILL)


def _runs(stands: npt.NDArray[np.bool_]) -> Iterator[slice]:
    """Stretches of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], stands.astype(int), [0]))))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield slice(begin, end)


def _lands_in_flight(seen: Seen, agent: int) -> Iterator[str]:
    """Who lands stands first, or has braked for as long as an agent waits for that."""
    if agent in seen.elsewhen:
        return
    said, speed_mps = seen.statuses[agent], seen.speed_mps(agent)
    until_s = min(seen.taken[agent], seen.lies[agent], seen.first(agent, "kill", "stop"))
    most_mps = _STANDS_MPS + 0.3 * seen.wind_mps + seen.misjudged_m
    flew_s = -math.inf  # when it last went where its mission, or its way home, told it
    for before, status in itertools.pairwise(said):
        if before.phase in (Phase.FLY, Phase.RETURN):
            flew_s = before.time_s
        begins = status.phase is Phase.LAND and before.phase in FLIES
        kills = status.action is FailsafeAction.KILL or status.time_s - before.time_s > 1.0
        if not begins or kills or status.time_s > until_s or before.time_s - flew_s > _BRAKES_S:
            continue
        when = (seen.truth.time_s >= before.time_s) & (seen.truth.time_s <= status.time_s)
        slowest_mps = float(speed_mps[when & seen.airborne(agent)].min(initial=math.inf))
        if math.isfinite(slowest_mps) and slowest_mps > most_mps:
            yield f"agent {agent} began to land at {status.time_s:.1f} s at {slowest_mps:.1f} m/s"


def _lands_beside(seen: Seen, agent: int) -> Iterator[str]:
    """Who begins to land has the room that both may drift to each other one that flies, and a
    little more than r_in to each that stands, by the stop points that both told, or has tried to
    make it."""
    expels = any(order.line.startswith("expel") for order in seen.flown.orders)
    if seen.plan.wake is not None or not seen.good_mesh or seen.of("part") or expels:
        return
    if agent in seen.elsewhen or not seen.plan.safety.filter:
        return
    gone = "kill", "stop", "restart"
    until_s = min(seen.taken[agent], seen.lies[agent], seen.first(agent, *gone))
    flew_s = -math.inf
    for before, status in itertools.pairwise(seen.statuses[agent]):
        if before.phase is Phase.FLY and before.action is None:
            flew_s = before.time_s
        begins = status.phase is Phase.LAND and before.phase in (Phase.FLY, Phase.HOLD)
        if not begins or status.action is FailsafeAction.KILL or status.time_s > until_s:
            continue
        if status.time_s - flew_s > _ROOM_S or status.time_s - before.time_s > 1.0:
            continue
        drift_m = STANDING_WANDERS_M if status.action is None else WANDERS_M
        beside_m = BESIDE * (seen.plan.law.r_out - seen.plan.law.r_in) * seen.unit_m
        for other in set(seen.ids) - {agent} - seen.elsewhen:
            others_s = min(seen.taken[other], seen.lies[other], seen.first(other, *gone))
            at = np.searchsorted(seen.truth.time_s, [before.time_s, status.time_s])
            flies = bool(seen.airborne(other)[at[0] : at[1] + 1].all())
            if others_s < status.time_s or not (flies or _stands(seen, other, before.time_s)):
                continue
            least_m = seen.r_in_m + (2.0 * drift_m if flies else beside_m) - _SHORT_M
            least_m -= _strays_m(seen, other, before.time_s - _OLD_S, status.time_s)
            own, theirs = (
                {round(s.time_s, 1): complex(*s.stop_point_m) for s in seen.states[each]}
                for each in (agent, other)
            )
            gaps_m = [
                abs(own[when] - theirs[when])
                for when in own.keys() & theirs.keys()
                if before.time_s - _SHORT_S <= when <= status.time_s
            ]
            if gaps_m and max(gaps_m) < least_m:
                yield (
                    f"agent {agent} began to land at {status.time_s:.1f} s, {max(gaps_m):.2f} m"
                    f" beside agent {other}, which {'flew' if flies else 'stood'}"
                )


def _strays_m(seen: Seen, agent: int, from_s: float, to_s: float) -> float:
    """How far apart its told stop points of this time are [m]: another may know any of them."""
    told = np.array(
        [complex(*s.stop_point_m) for s in seen.states[agent] if from_s <= s.time_s <= to_s]
    )
    return float(np.abs(told[:, None] - told).max(initial=0.0))


def _stands(seen: Seen, agent: int, at_s: float) -> bool:
    """It has told for a while that its vehicle stands on the ground."""
    said = [s.down for s in seen.states[agent] if at_s - _TOLD_S <= s.time_s <= at_s]
    return bool(said) and all(said)


def _flies_alone(seen: Seen, agent: int) -> Iterator[str]:
    """A vehicle whose agent is dead or stopped has its own failsafe: it stands, or lands."""
    time_s, speed_mps = seen.truth.time_s, seen.speed_mps(agent)
    most_mps = _STANDS_MPS + 0.5 * seen.wind_mps + seen.misjudged_m
    for each in seen.of("kill", "stop"):
        if agent not in (each.kill or each.stop or ()):
            continue
        said = [s for s in seen.statuses[agent] if s.time_s <= each.at_s][-1:]
        if agent in seen.elsewhen or not said or said[0].phase not in FLIES:
            continue
        back_s = [b.at_s for b in seen.of("restart") if agent in (b.restart or ())]
        ends = [each.until_s] if each.for_s else []
        ends += [at for at in back_s if at > each.at_s]
        until_s = min([*ends, seen.taken[agent], each.at_s + _ALONE_S + _LEAVES_S])
        when = (time_s > each.at_s + _ALONE_S) & (time_s < until_s) & seen.airborne(agent)
        fast_mps = float(speed_mps[when].max(initial=0.0))
        if fast_mps > most_mps:
            gone = f"agent {agent} fell silent at {each.at_s:g} s"
            yield f"{gone}, and {_ALONE_S:g} s later its vehicle flew on at {fast_mps:.1f} m/s"


def _may_slide(seen: Seen) -> float:
    """How far an agent may fly that is told to land [m]: it brakes, and makes room."""
    speed, response = seen.plan.limits.speed_mps, seen.plan.response
    brakes_m = speed * (response.dead_time_s + response.lag_s + 0.5) + speed**2 / 4.0
    return brakes_m + seen.r_in_m + 4.0 + 0.5 * seen.wind_mps


def _way_down(seen: Seen, agent: int, at_s: float) -> float:
    """How far it flew from there to where it came down [m]; 0 where other hands had a part."""
    downs = [at for at in seen.events(agent, EventKind.TOUCHDOWN) if at > at_s]
    until_s = min(seen.taken[agent], seen.first(agent, "kill", "stop"))
    later = [order.at_s for order in seen.orders(agent) if order.at_s > at_s]
    if not downs or downs[0] > min([until_s, *later]) or at_s > seen.home_s(agent):
        return 0.0
    if any(s.action is FailsafeAction.RETURN and s.time_s < at_s + 1 for s in seen.statuses[agent]):
        return 0.0
    begin, end = np.searchsorted(seen.truth.time_s, [at_s, downs[0]]).tolist()
    track = seen.track(agent)
    end = min(end, len(track) - 1)
    return float(math.dist(track[begin, :2], track[end, :2]))


def _obeys(seen: Seen) -> Iterator[str]:
    for agent in seen.ids:
        hands_s = min(
            seen.taken[agent], seen.lies[agent], seen.first(agent, "kill", "stop", "clock")
        )
        given = seen.orders(agent)
        for order, later in itertools.zip_longest(given, given[1:]):
            until_s = min(hands_s, later.at_s if later is not None else math.inf)
            text = _obeyed(seen, agent, order, until_s)
            text = text or _given_back(seen, agent, order, later.at_s if later else math.inf)
            if text:
                yield f"agent {agent} accepted `{order.line}` at {order.at_s:g} s, and {text}"


def _given_back(seen: Seen, agent: int, order: GivenOrder, until_s: float) -> str:
    """What became of the vehicle that an agent takes again from a pilot, or ''."""
    if order.sent is None or order.sent.command.kind != CommandKind.RESUME:
        return ""
    said, at_s = seen.statuses[agent], order.at_s
    before = [s for s in said if s.time_s <= at_s][-1:]
    again = (from_s for from_s, _, agents, _, _ in seen.faults if agent in agents)
    again_s = min((from_s for from_s in again if from_s > at_s), default=math.inf)
    dead_s = seen.first(agent, "kill", "stop", "clock", "says")
    until_s = min(at_s + 2.0 * ACTS_S, again_s, dead_s, until_s)
    after = [s for s in said if at_s + 2.0 < s.time_s < until_s]
    if agent in seen.elsewhen or not before or before[0].phase is not Phase.YIELD or not after:
        return ""
    return "left its vehicle to the pilot" if all(s.phase is Phase.YIELD for s in after) else ""


def _obeyed(seen: Seen, agent: int, order: GivenOrder, until_s: float) -> str:
    """What it did instead, or ''."""
    kind = order.sent.command.kind if order.sent is not None else ""
    late_s = 1.0 + seen.flown.scenario.mesh.delay_s + seen.flown.scenario.mesh.jitter_s
    late_s += 10.0 if seen.flown.scenario.mesh.loss or seen.of("part") else 0.0
    at_s, truth, k = order.at_s, seen.truth, seen.column[agent]
    if kind == CommandKind.KILL:
        armed = truth.armed[(truth.time_s > at_s + late_s + 3.0) & (truth.time_s < until_s), k]
        return "its motors went on" if armed.any() else ""
    if kind in (CommandKind.LAND, CommandKind.RETURN):
        within_s = late_s + _down_within(seen, agent, at_s, home=kind == CommandKind.RETURN)
        flies = truth.airborne[(truth.time_s > at_s + within_s) & (truth.time_s < until_s), k]
        if flies.any():
            return f"it was in the air {within_s:.0f} s later"
        return _came_home(seen, agent, until_s) if kind == CommandKind.RETURN else ""
    holds = kind in (CommandKind.HOLD, CommandKind.EXPEL) and agent not in seen.elsewhen
    if holds and _is_meant(agent, order):
        return _moved_in_hold(seen, agent, at_s + late_s, until_s)
    return ""


def _is_meant(agent: int, order: GivenOrder) -> bool:
    """This agent is to hold, by this order: `expel` makes those hold that it is about."""
    command = order.sent.command if order.sent is not None else None
    return command is not None and (command.kind == CommandKind.HOLD or agent in command.about)


def _down_within(seen: Seen, agent: int, at_s: float, *, home: bool) -> float:
    """The longest that an ordered landing takes [s]."""
    time_s, plan = seen.truth.time_s, seen.plan
    at = min(int(np.searchsorted(time_s, at_s)), len(time_s) - 1)
    north, east, down = seen.track(agent)[at].tolist()
    high_m = max(-down, 0.0) + (len(seen.ids) * plan.policies.return_separation_m if home else 0.0)
    lands_s: float = 20.0 + high_m / min(_TOUCHES_MPS, 0.5 * plan.limits.descent_mps)
    if not home:
        return lands_s
    start = plan.agent(agent).start
    way_m = math.dist((north, east), (start[0] * seen.unit_m, start[1] * seen.unit_m))
    flies_s = 2.0 * way_m / plan.policies.return_speed_mps
    return 2.0 * lands_s + 120.0 * len(seen.ids) + flies_s


def _came_home(seen: Seen, agent: int, until_s: float) -> str:
    last = seen.statuses[agent][-1:]
    if not last or last[0].cause is not Cause.ORDER or last[0].outcome is not Outcome.ABORTED:
        return ""  # it says why it did not
    downs = [at for at in seen.events(agent, EventKind.TOUCHDOWN) if at < until_s]
    if not downs:
        return ""
    start = seen.plan.agent(agent).start
    place = seen.track(agent)[-1, :2]
    off_m = math.dist(place, (start[0] * seen.unit_m, start[1] * seen.unit_m))
    return f"it came down {off_m:.1f} m from its start" if off_m > MISPLACED_M + 1.0 else ""


def _moved_in_hold(seen: Seen, agent: int, at_s: float, until_s: float) -> str:
    """A vehicle that is to hold stays where it is, but for room that it makes for others: until one
    of them is not where it says."""
    held = [s for s in seen.statuses[agent] if at_s + 6.0 < s.time_s < until_s]
    others = [s.time_s for s in held if s.action is not None or s.phase is not Phase.FLY]
    pushed = (min(seen.taken[each], seen.lies[each]) for each in set(seen.ids) - {agent})
    until_s = min([until_s, *others, *pushed, *(s.time_s for s in held[-1:])])
    time_s = seen.truth.time_s
    stretch = (time_s > at_s + 6.0) & (time_s < until_s)
    if stretch.sum() < 2:
        return ""
    places = seen.track(agent)[stretch]
    moved_m = float(np.linalg.norm(places[:, :2] - places[0, :2], axis=1).max())
    rose_m = float(np.abs(places[:, 2] - places[0, 2]).max())
    allowed_m = 2.0 + 1.5 * seen.plan.law.r_out * seen.unit_m
    if moved_m > allowed_m or rose_m > 2.0:
        return f"it moved by {max(moved_m, rose_m):.1f} m while it held"
    return ""


def _heard(seen: Seen) -> Iterator[str]:
    """The age of the link to an agent that is dead or stopped is as long as it has been so; and
    what the mesh loses is counted."""
    mesh = seen.flown.scenario.mesh
    if not seen.good_mesh or not seen.one_clock or seen.of("clock", "says", "part"):
        return
    for each in seen.of("kill", "stop"):
        gone = each.kill or each.stop or ()
        back_s = [b.at_s for b in seen.of("restart") if set(gone) & set(b.restart or ())]
        back_s = [at for at in back_s if at > each.at_s] + ([each.until_s] if each.for_s else [])
        until_s = min(back_s, default=math.inf)
        for agent in set(seen.ids).difference(*(b.kill or b.stop or () for b in seen.of(*_DEAD))):
            for status in seen.statuses[agent]:
                silent_s = status.time_s - each.at_s
                if not silent_s > _AGE_S or status.time_s >= until_s:
                    continue
                for lost in gone:
                    link = status.links.get(lost)
                    if link is None or link.age_s is None or link.age_s > silent_s - _AGE_S:
                        continue
                    yield (
                        f"agent {agent} says at {status.time_s:.1f} s that it heard agent {lost}"
                        f" {link.age_s:.1f} s ago, which was silent since {each.at_s:g} s"
                    )
                    return
    for agent, said in seen.statuses.items() if mesh.loss else ():
        for other, link in (said[-1].links if said else {}).items():
            due = link.received * mesh.loss / (1.0 - mesh.loss)
            if due >= _DUE and link.lost < _LEAST_LOST * due:
                yield (
                    f"agent {agent} says that {link.lost} of agent {other}'s states were lost, and"
                    f" about {due:.0f} were"
                )
    overtakes = mesh.jitter_s >= seen.plan.tick_s  # a state that is overtaken is lost, too
    if mesh.loss and not overtakes and not seen.of("kill", "stop", "restart", "vehicle"):
        for agent, said in seen.statuses.items():
            for other, link in (said[-1].links if said else {}).items():
                share = link.lost / max(1, link.lost + link.received)
                if link.received >= _COUNTED and abs(share - mesh.loss) > _LOSS + 0.5 * mesh.loss:
                    yield f"agent {agent} says that {share:.0%} of agent {other}'s states were lost"


_DEAD: Final = ("kill", "stop", "restart")


def _together(seen: Seen) -> Iterator[str]:
    """By the states of each tick: one begins a step, and another that it hears is not done yet with
    the one before, nor was."""
    if not seen.good_mesh or seen.of("part"):
        return
    sent = [order.sent.command for order in seen.flown.orders if order.sent is not None]
    alone = {agent for command in sent for agent in (*command.about, *command.agents)}
    skipped = [o.at_s for o in seen.flown.orders if o.line.split()[0] in ("next", "resume")]
    free = [
        agent.id
        for agent in seen.plan.agents
        if not agent.waits
        and agent.id not in alone | seen.elsewhen
        and not math.isfinite(seen.first(agent.id, "says", "kill", "stop", "restart"))
    ]
    for agent in free:
        last = seen.statuses[agent][-1:]
        for k, step in enumerate(last[0].steps if last else ()):
            at_s = step.start_s
            if k == 0 or any(abs(at_s - skip_s) < 3.0 for skip_s in skipped):
                continue
            for other, number in seen.routes.awaited(agent, k - 1).items():
                if other == agent or other not in free or seen.timed_out(agent, k - 1):
                    continue
                if _not_done(seen.states[other], number, at_s):
                    yield (
                        f"agent {agent} began step {k} ({step.name}) at {at_s:.1f} s, and agent"
                        f" {other} was not done with step {number}"
                    )


def _not_done(said: list[AgentState], number: int, at_s: float) -> bool:
    """Whether an agent that told this was not done with the step of this number in any of its
    states from the last second before."""
    heard = [s for s in said if at_s - 1.0 <= s.time_s <= at_s + 1e-3]
    return bool(heard) and not any(
        (s.step, s.done) >= (number, True) or _apart_from(s) for s in heard
    )


def _apart_from(state: AgentState) -> bool:
    """The others need not wait for it: it gave up, left, or a pilot has its vehicle."""
    over = (Phase.LAND, Phase.RETURN, Phase.YIELD, Phase.ENDED)
    return state.left is not None or state.phase in over


def _verdict(seen: Seen) -> Iterator[str]:
    flown, summary, truth = seen.flown, seen.flown.summary, seen.truth
    word = f"the verdict is {summary.outcome}"
    if (summary.outcome is Outcome.COMPLETED) != (summary.cause is None):
        yield f"{word}, its cause {summary.cause}"
    if summary.outcome is Outcome.COMPLETED:
        yield from (f"{word}, but {text}" for text in _against_completed(seen))
    elif not summary.reason:
        yield f"{word}, without a reason"
    yield from _who_was_first(seen)
    pairs = {
        (a, b): found[0]
        for a, b in itertools.combinations(seen.ids, 2)
        if (found := _closest(seen, a, b, None, autopilots=True)) is not None
    }
    named_pairs = [set(finding.agents) for finding in summary.findings]
    for (a, b), near_m in pairs.items():
        if near_m < seen.r_in_m - 0.01 and not any({a, b} <= named for named in named_pairs):
            yield f"no finding names agents {a} and {b}, which were {near_m:.2f} m apart"
    least_m = min((_both_up(seen, a, b) for a, b in pairs), default=math.inf)
    told_m = summary.min_distance_m
    if seen.plan.wake is None and (math.inf if told_m is None else told_m) > least_m + 0.05:
        yield f"its smallest distance in the air is {told_m} m, and it was {least_m:.2f} m"
    crashed = {event.sysid for event in truth.events if event.event in _FALLEN}
    named = {agent for finding in summary.findings for agent in finding.agents}
    unsaid = {seen.agent_of[sysid] for sysid in crashed if sysid in seen.agent_of} - named
    if unsaid:
        yield f"no finding names {agents_named(sorted(unsaid))}, which fell or collided"
    if not flown.all_down and summary.outcome is not Outcome.FAILED:
        yield f"{word}, but not all are down"
    yield from _causes(seen)


def _both_up(seen: Seen, a: int, b: int) -> float:
    """The smallest distance of two vehicles while both are in the air [m]."""
    up = seen.airborne(a) & seen.airborne(b)
    apart = np.linalg.norm(seen.track(a)[up, :2] - seen.track(b)[up, :2], axis=1)
    return float(apart.min(initial=math.inf))


_FALLEN: Final = (EventKind.CRASH, EventKind.COLLISION, EventKind.DISARM)


def _against_completed(seen: Seen) -> Iterator[str]:
    """What a completed flight can't have."""
    flown, summary = seen.flown, seen.flown.summary
    left = {each.agent for each in summary.left}
    waited = {
        agent.id
        for agent in seen.plan.agents
        if agent.waits and not seen.events(agent.id, EventKind.LIFTOFF)
    }
    for step in summary.steps:
        of = step.agents or seen.ids
        if (left | waited).issuperset(of):  # ended by the operator, or never launched
            continue
        planned = seen.plan.group_of(of[0], step.step).step(step.step)
        goes_on = planned is not None and planned.on_timeout is Policy.CONTINUE
        late = step.result is StepVerdict.TIMEOUT and not goes_on
        if late or step.result in (StepVerdict.ABORTED, StepVerdict.NOT_REACHED):
            yield f"step {step.step} ({step.name}) is {step.result}"
    for each in summary.agents:
        if each.outcome is not Outcome.COMPLETED and each.agent not in left:
            yield f"agent {each.agent} is {each.outcome}"
    for agent in seen.ids:
        last = seen.statuses[agent][-1:]
        if not last or (last[0].phase is not Phase.ENDED and agent not in seen.elsewhen):
            yield f"agent {agent} did not live to its end"
        if agent in left | waited:
            continue
        count, flew = len(seen.route(agent).steps), len(last[0].steps) - 1 if last else 0
        if flew < count and not _comes_back(seen, agent):
            yield f"agent {agent} flew {flew} of {count} steps"
        if not seen.events(agent, EventKind.LIFTOFF):
            yield f"agent {agent} never flew"
        if seen.route(agent).steps[-1].goes_home:
            north, east = seen.plan.agent(agent).start
            home = (north * seen.unit_m, east * seen.unit_m)
            off_m = math.dist(seen.track(agent)[-1, :2], home)
            if off_m > MISPLACED_M + 1.0:
                yield f"agent {agent} came down {off_m:.1f} m from its start"
    for name, code in (summary.exit_codes or {}).items():
        number = name.removeprefix("agent-")
        gone = number.isdigit() and (int(number) in left or _comes_back(seen, int(number)))
        if code != 0 and name.startswith("agent-") and not gone:
            yield f"{name} exited with {code}"
    if flown.up:
        yield f"{agents_named(flown.up)} had not ended"


_ORDERLY: Final = frozenset({0, 1, 130})
"""Exit codes of processes that ended by themselves."""


class _BrokeOff(NamedTuple):
    """An agent that failed by itself, and not for another one or an order."""

    agent: int
    at_s: float
    cause: Cause
    reason: str


def _broke_off(seen: Seen) -> list[_BrokeOff]:
    """All of them that no order took away before, the first one first."""
    found = []
    for agent in set(seen.ids) - seen.elsewhen:
        last = seen.statuses[agent][-1:]
        own = last and last[0].outcome is Outcome.FAILED and last[0].left is None
        cause = last[0].cause if own else None
        if cause in (None, Cause.PEER, Cause.ORDER, Cause.STARTER):
            continue
        broken = (StepOutcome.ABORTED, StepOutcome.TIMEOUT)
        broke = [s.end_s for s in last[0].steps if s.result in broken and s.end_s is not None]
        if broke:
            found.append(_BrokeOff(agent, min(broke), cause, last[0].reason))
    return sorted(found, key=lambda each: each.at_s)


def _who_was_first(seen: Seen) -> Iterator[str]:
    """An order does not excuse who failed by itself before the first one was given; it does who
    failed after it. Who failed first is the cause."""
    summary, failed = seen.flown.summary, _broke_off(seen)
    ends = (CommandKind.LAND, CommandKind.RETURN, CommandKind.KILL)
    given_s = min(
        (order.at_s for agent in seen.ids for order in seen.orders(agent, *ends)), default=math.inf
    )
    first = failed[0] if failed else None
    if summary.outcome is Outcome.ABORTED and first and first.at_s < given_s - 1.0:
        yield (
            f"the verdict is aborted, but agent {first.agent} had failed at {first.at_s:.1f} s"
            f" ({first.reason})"
        )
    if summary.outcome is not Outcome.FAILED or summary.findings or seen.elsewhen:
        return
    last = [said[-1] for said in seen.statuses.values() if said]
    by_order = [s for s in last if s.outcome is Outcome.ABORTED and s.left is None]
    final = len(last) == len(seen.ids) and all(s.phase is Phase.ENDED for s in last)
    orderly = _ORDERLY.issuperset((summary.exit_codes or {}).values())
    later = any(s.outcome is Outcome.FAILED and s.left is not None for s in last)  # when, is unsaid
    if by_order and final and orderly and not later:
        obeyed = {status.agent for status in by_order}
        own_s = [order.at_s for agent in obeyed for order in seen.orders(agent, *ends)]
        if own_s and (first is None or first.at_s > min(own_s)):
            yield (
                f"the verdict is failed ({summary.reason}), but agents were ordered to end it at"
                f" {min(own_s):.1f} s, before any failed"
            )
    mine = [each for each in failed if each.cause is summary.cause]
    if first and mine and first.at_s < mine[0].at_s - 1.0:
        yield (
            f"the cause is {summary.cause}, of {mine[0].at_s:.1f} s, but agent {first.agent} failed"
            f" at {first.at_s:.1f} s ({first.reason})"
        )


def _comes_back(seen: Seen, agent: int) -> bool:
    return any(agent in (each.restart or ()) for each in seen.of("restart"))


def _causes(seen: Seen) -> Iterator[str]:
    """A cause needs what can bring it about."""
    cause, words = seen.flown.summary.cause, seen.flown.summary.reason
    named = {name for _, _, _, values, _ in seen.faults for name in values} | {*seen.parameters}
    piloted = any(pilot for _, _, _, _, pilot in seen.faults)
    mesh = bool(seen.flown.scenario.mesh.model_dump(exclude_defaults=True))
    can: dict[Cause, bool] = {
        # an agent that lies says that a command holds it
        Cause.ORDER: any(order.sent is not None for order in seen.flown.orders)
        or bool(seen.of("says")),
        Cause.STARTER: False,
        Cause.PILOT: piloted or bool(named) or bool(seen.of("kill", "stop", "restart", "clock")),
        Cause.WIND: seen.wind_mps > 0,
        Cause.BATTERY: any(name.startswith("SIM_BATT") for name in named)
        or seen.flown.end_s > _BATTERY_S,
        Cause.STATION: mesh
        or bool(seen.of("station", "part", "clock", "stop"))
        or bool(seen.flown.scenario.clocks),
        Cause.LINK: mesh
        or bool(named)
        or bool(seen.of("part", "clock", "stop", "says", "restart")),
        Cause.PROCESS: bool(seen.of("kill", "station", "restart")),
        Cause.MACHINE: False,
        Cause.FINDING: bool(seen.flown.summary.findings),
        Cause.FALL: bool(named),
    }
    if cause is not None and not can.get(cause, True):
        yield f"the cause is {cause} ({words}), and nothing of that kind happened"


def _forecast(seen: Seen) -> Iterator[str]:
    if not seen.fair:
        return
    summary = seen.flown.summary
    autopilots = [entry.autopilot for entry in seen.flown.mission.fleet.agents]
    expected = forecast(seen.plan, autopilots)
    if any(step.expected_s is None for step in expected) or any(crowded(seen.plan)):
        return  # `validate` says that it may not get there
    # the judge takes an agent's times for the truth's, so what it finds of other clocks is not held
    # against the flight
    own = [said[-1].outcome for said in seen.statuses.values() if said]
    completed = not seen.one_clock and own.count(Outcome.COMPLETED) == len(seen.ids)
    if summary.outcome is not Outcome.COMPLETED and not completed:
        yield f"{summary.outcome}: {summary.reason}"
        return
    if not seen.timely:
        return
    for at, step in zip(seen.plan.all_steps(), expected, strict=True):
        found = [
            said[-1].steps[at.number]
            for said in map(seen.statuses.__getitem__, at.group.ids)
            if said and len(said[-1].steps) > at.number
        ]
        ends_s = [result.end_s for result in found if result.end_s is not None]
        if not ends_s or step.expected_s is None or at.step.barrier:  # there a group waits
            continue
        start_s, end_s = min(result.start_s for result in found), max(ends_s)
        took_s, most_s = end_s - start_s, _FAIR * step.expected_s + _FAIR_S
        name = f"step {at.number} ({at.name})"
        if took_s > most_s:
            yield f"{name} took {took_s:.1f} s; forecast: {step.expected_s:.1f} s"
        if step.form is None or step.form.smallest_pair is None:
            continue
        near_m = _nearest_between(seen, at.group.ids, start_s, end_s)
        if near_m < _FAIR_SHARE * step.form.smallest_m:
            forecast_m = step.form.smallest_m
            words = f"{near_m:.2f} m apart; forecast: {forecast_m:.2f} m"
            yield f"in {name} a pair was {words}"


def _nearest_between(seen: Seen, ids: tuple[int, ...], from_s: float, to_s: float) -> float:
    """The smallest horizontal distance of two of these agents' vehicles in that time [m], but for
    those that are apart by height."""
    time_s, columns = seen.truth.time_s, [seen.column[agent] for agent in ids]
    places = seen.truth.position_ned_m[(time_s >= from_s) & (time_s <= to_s)][:, columns]
    between = places[:, :, None] - places[:, None]
    apart = np.linalg.norm(between[..., :2], axis=-1)
    apart[np.abs(between[..., 2]) >= seen.plan.layer_m] = np.inf
    apart[:, range(len(ids)), range(len(ids))] = np.inf
    return float(apart.min(initial=np.inf))


CHECKS: Final[dict[Invariant, Callable[[Seen], Iterator[str]]]] = {
    Invariant.ENDS: _ends,
    Invariant.DOWN: _down,
    Invariant.APART: _apart,
    Invariant.ROOM: rooms_are_shared,
    Invariant.FENCED: _fenced,
    Invariant.ZONED: _zoned,
    Invariant.SLOW: _slow,
    Invariant.ORDERED: _ordered,
    Invariant.TOGETHER: _together,
    Invariant.OBEYS: _obeys,
    Invariant.ACTS: policies_act,
    Invariant.HEARD: _heard,
    Invariant.VERDICT: _verdict,
    Invariant.FORECAST: _forecast,
}
"""By the flight's truth."""
