"""Nothing moves that was not ordered, and what was ordered is done."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.agent.landing import BESIDE, STANDING_WANDERS_M, WANDERS_M
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import CommandKind, Outcome, Phase
from swarm_ctl.core.model.vehicle import MISPLACED_M
from swarm_ctl.fuzz.invariants.losses import ACTS_S
from swarm_ctl.fuzz.invariants.places import BRAKES_S, LEAVES_S
from swarm_ctl.fuzz.invariants.seen import FLIES, Seen
from swarm_ctl.runfolder.truth import EventKind
from swarm_ctl.virtual.scenario_flight import GivenOrder

_MOVES_M: Final = 1.0
"""On the ground, disarmed."""
_BOUNCES_S: Final = 3.0
"""In gusts a vehicle may touch the ground again as it takes off."""
_BOUNCES_M: Final = 0.1
"""One that holds as low as that does so for as long as it holds."""
_TOUCHES_MPS: Final = 0.3
"""A landing is no slower than this, in the mean."""
_STANDS_MPS: Final = 1.0
"""Who begins to land is slower than this, in still air ..."""
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


def nothing_moves_unordered(seen: Seen) -> Iterator[str]:
    """In the air or on the ground."""
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
            again = at > min(lift for lift in lifts if lift > began_s) + _BOUNCES_S
            if again and _rises_m(seen, agent, at) > _BOUNCES_M:
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


def _rises_m(seen: Seen, agent: int, lift_s: float) -> float:
    """How high it comes between this lift-off and the next touchdown, over where it stood."""
    down_s = (at for at in seen.events(agent, EventKind.TOUCHDOWN) if at > lift_s)
    time_s, height_m = seen.truth.time_s, -seen.track(agent)[:, 2]
    aloft = height_m[(time_s >= lift_s) & (time_s <= next(down_s, math.inf))]
    return float(aloft.max() - aloft[0]) if len(aloft) else 0.0


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
        if not begins or kills or status.time_s > until_s or before.time_s - flew_s > BRAKES_S:
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
        until_s = min([*ends, seen.taken[agent], each.at_s + _ALONE_S + LEAVES_S])
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


def orders_are_obeyed(seen: Seen) -> Iterator[str]:
    """Each that an agent accepted, until the next one."""
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
    most_m = (
        MISPLACED_M + 1.0 + 0.5 * seen.wind_mps
    )  # simulated gusts carry a landing vehicle along
    return f"it came down {off_m:.1f} m from its start" if off_m > most_m else ""


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
