"""Pairs are apart, speeds are kept, and so are fence and zones."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.agent.agent import STATUS_EVERY_S
from swarm_ctl.core.agent.landing import WANDERS_M
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.messages import CommandKind, Phase
from swarm_ctl.core.model.plan import Fence, Policy, Zone
from swarm_ctl.core.model.vehicle import OVER_M
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.safety.surroundings import Outline
from swarm_ctl.fuzz.invariants.losses import ACTS_S
from swarm_ctl.fuzz.invariants.seen import FLIES, FREE_M, Seen

_OUT_M: Final = 2.0
_OUT_S: Final = 2.0
"""Beyond the fence for longer and farther, a policy has to have acted."""
LEAVES_S: Final = 8.0
_LEAVES: Final = 10.0
"""A zone that is added over a vehicle is left in so long, and so many times its way out at top
speed: it leaves at a fifth of that at least, and others are in its way."""
_FASTER: Final = 1.25
_FASTER_MPS: Final = 0.5
_CLIMBS: Final = 1.5
"""Autopilots overshoot a setpoint by so much: 1.11 and 1.20 of the limits were the most in 120
flights."""
_CLEAR: Final = 1.1
"""In r_in: what is left in fair weather (docs/understand/safety-evidence.md)."""
BRAKES_S: Final = 2.5
"""... or has braked for so long by its words, which come at 2 Hz."""


def pairs_are_apart(seen: Seen) -> Iterator[str]:
    """By the truth, and by what both told where that was off."""
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
        found = closest(seen, a, b, counts, autopilots=not close, spared_m=spared_m)
        if found is not None and found[0] < least_m:
            near_m, time_s = found
            under = f"{_CLEAR} times r_in" if seen.fair else "r_in"
            yield (
                f"agents {a} and {b} were {near_m:.2f} m apart at {time_s:.1f} s, all that is off"
                f" counted, under {under}, {least_m:.2f} m"
            )


def _lands_unheard(seen: Seen, agent: int) -> npt.NDArray[np.bool_]:
    """(T,): while its vehicle is without an agent, or with a new one that has not taken it over."""
    time_s, found = seen.truth.time_s, np.zeros(len(seen.truth.time_s), dtype=np.bool_)
    for each in seen.of("kill", "stop"):
        if agent in (each.kill or each.stop or ()):
            again = (b.at_s for b in seen.of("restart") if agent in (b.restart or ()))
            begins_s = min((at_s for at_s in again if at_s > each.at_s), default=math.inf)
            said = (s for s in seen.statuses[agent] if s.time_s > begins_s)
            ends = [s.time_s for s in said if s.step > 0][:1]
            ends += [each.until_s] if each.for_s else []
            found |= (time_s > each.at_s) & (time_s < min(ends, default=math.inf) + BRAKES_S)
    return found


def closest(
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


def speeds_are_kept(seen: Seen) -> Iterator[str]:
    """While it follows an agent's setpoints, and has had time to brake from what it did before;
    wind and an estimate that is off add to it."""
    truth, limits = seen.truth, seen.plan.limits
    more_mps = _FASTER_MPS + 0.5 * seen.wind_mps + seen.misjudged_m
    for agent in set(seen.ids) - seen.elsewhen:
        hands_s = min(seen.taken[agent], seen.lies[agent], seen.first(agent, "kill", "stop"))
        flown = _flown_by_agents(seen, agent)
        since_s = np.maximum.accumulate(np.where(flown, -math.inf, truth.time_s))
        counts = (truth.time_s - since_s > BRAKES_S) & (truth.time_s < hands_s)
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


def fence_is_kept(seen: Seen) -> Iterator[str]:
    """Or its policy acts."""
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


def zones_are_kept(seen: Seen) -> Iterator[str]:
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
            leaves_s = max(leaves_s, LEAVES_S + _LEAVES * way_m / plan.limits.speed_mps)
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
