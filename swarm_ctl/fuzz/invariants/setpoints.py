"""What agents tell their vehicles, held against what docs/understand/safety-evidence.md says of the
keep-out: an agent takes half of the room to one that gives way, and all of it, but no more, to
where a silent one may have flown.

It finds a filter that does otherwise long before a pair is near.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.kernel.constraints import RATE, cap, margins_of
from swarm_ctl.core.model.messages import AgentState, CommandKind
from swarm_ctl.core.model.timeouts import FRESH_S, SILENT_FLIES_S
from swarm_ctl.fuzz.invariants.seen import FLIES, Seen
from swarm_ctl.virtual.scenario_flight import GivenOrder

_OVER_MPS: Final = 0.3
"""Over what is allowed, in two states one after the other: 0.15 m/s was the most in 40 flights."""
_LOST_S: Final = 0.3
"""Where states are lost, the newest one that was heard is so much older."""
_GROWS_S: Final = 3.0
"""A keep-out grows with the age of the news for so long."""
_LOOKS_S: Final = 8.0
"""Of one that fell silent: later its vehicle stands, or lands."""
_STILL_MPS: Final = 0.05
"""A formation that is slower stands."""
_HELD: Final = 0.25
"""One that makes less than this share of its formation's way is held up: half of what the filter
asks for."""


class _Told(NamedTuple):
    """One agent's states, in the order of time; horizontal vectors are north + 1j * east."""

    time_s: npt.NDArray[np.float64]
    stop_point_m: npt.NDArray[np.complex128]
    setpoint_mps: npt.NDArray[np.complex128]
    shared_mps: npt.NDArray[np.complex128]
    """(3, T), the velocity of its formation's frame, by this state, the one before and the next."""
    low_m: npt.NDArray[np.float64]
    """The lower one of its height and the height that it flies to; -inf where heights part
    nobody."""
    high_m: npt.NDArray[np.float64]
    flies: npt.NDArray[np.bool_]
    """By its own setpoints: it gives way."""


def rooms_are_shared(seen: Seen) -> Iterator[str]:
    """All of this module. A cut makes agents silent to some alone."""
    if not (seen.plan.safety.filter and seen.good_mesh):
        return
    if seen.of("part", "clock"):
        return
    told = {agent: _told(seen, agent) for agent in seen.ids}
    for own in seen.ids:
        yield from _hurries_past_others(seen, own, told)
    for own, other in itertools.permutations(seen.ids, 2):
        yield from _takes_more_than_half(seen, own, told[own], other, told[other])
        yield from _flies_where_a_silent_one_may_be(seen, own, told[own], other, told[other])


def _told(seen: Seen, agent: int) -> _Told:
    states = seen.states[agent]
    expelled_s = min((o.at_s for o in seen.flown.orders if _expels(o, agent)), default=math.inf)
    until_s = min(seen.taken[agent], seen.lies[agent], expelled_s)
    time_s = np.array([s.time_s for s in states])
    flies = [
        s.phase in FLIES and s.airborne and s.setpoint_mps != (0.0, 0.0) and s.time_s < until_s
        for s in states
    ]
    spans = [
        (-math.inf, math.inf)
        if s.goal_height_m is None
        else sorted((-s.position_ned_m[2], s.goal_height_m))
        for s in states
    ]
    return _Told(
        time_s=time_s,
        stop_point_m=np.array([complex(*s.stop_point_m) for s in states]),
        setpoint_mps=np.array([complex(*s.setpoint_mps) for s in states]),
        shared_mps=_shared_mps(states, time_s),
        low_m=np.array([low for low, _ in spans]),
        high_m=np.array([high for _, high in spans]),
        flies=np.array(flies, dtype=np.bool_),
    )


def _shared_mps(
    states: list[AgentState], time_s: npt.NDArray[np.float64]
) -> npt.NDArray[np.complex128]:
    """By the frame that it tells: one that is taken up anew jumps, for one state alone."""
    found = np.zeros((3, len(states)), dtype=np.complex128)
    if len(states) < 2:
        return found
    points = [complex(*s.frame.point_m) if s.frame else math.nan for s in states]
    moved_mps = np.nan_to_num(np.diff(np.array(points, dtype=np.complex128)) / np.diff(time_s))
    found[0, 1:], found[1, 2:], found[2, :-1] = moved_mps, moved_mps[:-1], moved_mps
    return found


def _held_up(mine: _Told, setpoint_mps: npt.NDArray[np.complex128]) -> npt.NDArray[np.bool_]:
    """(T,): the own formation stands, or who is told to fly this does not fly along with it."""
    shared_mps = mine.shared_mps
    stays = (setpoint_mps * shared_mps.conj()).real < _HELD * np.abs(shared_mps) ** 2
    held: npt.NDArray[np.bool_] = np.logical_and.reduce((np.abs(shared_mps) < _STILL_MPS) | stays)
    return held


def _expels(order: GivenOrder, agent: int) -> bool:
    """From then on the others listen to this agent no more."""
    command = order.sent.command if order.sent is not None else None
    return command is not None and command.kind == CommandKind.EXPEL and agent in command.about


class _Known(NamedTuple):
    """Of another agent, for each state of the own one."""

    apart: npt.NDArray[np.complex128]
    """The own stop point less its."""
    counts: npt.NDArray[np.bool_]
    """It is known to give way, and heights do not part the two."""
    held: npt.NDArray[np.bool_]
    """It is known not to fly along with a formation that moves."""


def _known(seen: Seen, mine: _Told, theirs: _Told) -> Iterator[_Known]:
    """By each state of the other one that may have been the newest which was heard."""
    if len(theirs.time_s) < 2:
        return
    plan, mesh = seen.plan, seen.flown.scenario.mesh
    late_s = mesh.delay_s + mesh.jitter_s + (_LOST_S if mesh.loss else 0.0)
    for late in range(1, 2 + math.ceil(late_s / plan.tick_s)):
        at = np.searchsorted(theirs.time_s, mine.time_s - (late - 0.5) * plan.tick_s) - 1
        at = np.maximum(at, 0)
        age_s = mine.time_s - theirs.time_s[at]
        above_m = np.maximum(mine.low_m - theirs.high_m[at], theirs.low_m[at] - mine.high_m)
        counts = theirs.flies[at] & (age_s > 0.0) & (age_s < FRESH_S) & (above_m < plan.layer_m)
        held = _held_up(mine, theirs.setpoint_mps[at])
        yield _Known(mine.stop_point_m - theirs.stop_point_m[at], counts, held)


def _hurries_past_others(seen: Seen, own: int, told: dict[int, _Told]) -> Iterator[str]:
    """Near another one that gives way, an agent is no faster than `cap` allows for a response that
    is known for sure, or than a keep-out asks for. Until one is silent, or lies: what is kept clear
    for that one asks for more."""
    plan, mine = seen.plan, told[own]
    others = set(seen.ids) - {own}
    gone = "kill", "stop", "restart"
    until_s = min(
        (min(seen.taken[each], seen.lies[each], seen.first(each, *gone)) for each in others),
        default=math.inf,
    )
    response = seen.flown.mission.fleet.agent(own).response or plan.response
    margins = margins_of(plan.law, response, plan.limits.speed_mps, plan.unit_m)
    most_mps = np.full(len(mine.time_s), margins.speed)
    asked_mps = np.zeros(len(mine.time_s))
    for other in others:
        slowest_mps = np.full(len(mine.time_s), -np.inf)
        for known in _known(seen, mine, told[other]):
            room = np.abs(known.apart) - margins.keep_out
            allowed = np.array([cap(each, 0.0, margins) for each in room.tolist()])
            slowest_mps = np.maximum(slowest_mps, np.where(known.counts, allowed, np.inf))
            asked_mps = np.maximum(asked_mps, np.where(known.counts, -RATE * room, 0.0))
        if np.isfinite(slowest_mps).any():
            most_mps = np.minimum(most_mps, slowest_mps)
    asked_mps = np.minimum(asked_mps, margins.speed)
    over_mps = np.abs(mine.setpoint_mps) - np.maximum(most_mps, asked_mps)
    stands = (np.abs(mine.shared_mps) < _STILL_MPS).all(axis=0)
    at_s = _first(mine, over_mps, (mine.time_s < until_s) & stands & ~_gave_way(seen, own, mine))
    if at_s is not None:
        yield f"agent {own} was too fast for the room to others at {at_s:.1f} s"


def _takes_more_than_half(
    seen: Seen, own: int, mine: _Told, other: int, theirs: _Told
) -> Iterator[str]:
    """By the place of the other one that it may have known and that leaves it the most. In a
    formation that moves, of those alone that are held up: the others fly along. To one whose word
    it does not believe it may take all of it: that one is not counted on to keep its half."""
    plan = seen.plan
    margins = margins_of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m)
    over_mps = np.full(len(mine.time_s), np.inf)
    doubts = _doubts(seen, own, mine, other)
    share = np.where(doubts, 1.0, 0.5)
    for apart, counts, held in _known(seen, mine, theirs):
        allowed = share * RATE * (np.abs(apart) - margins.keep_out)
        closing = -(apart * mine.setpoint_mps.conj()).real / np.maximum(np.abs(apart), 1e-9)
        most = np.maximum(allowed, -0.5 * margins.speed)
        over_mps = np.minimum(over_mps, np.where(counts & held, closing - most, -np.inf))
    over_mps[np.isposinf(over_mps)] = -np.inf  # it told nothing
    at_s = _first(mine, over_mps, ~_gave_way(seen, own, mine))
    if at_s is not None:
        part = "all" if doubts[np.searchsorted(mine.time_s, at_s)] else "half"
        yield f"agent {own} took more than {part} of the room to agent {other} at {at_s:.1f} s"


def _flies_where_a_silent_one_may_be(
    seen: Seen, own: int, mine: _Told, other: int, theirs: _Told
) -> Iterator[str]:
    """For a second it may have flown on as it was told."""
    plan = seen.plan
    margins = margins_of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m)
    for each in seen.of("kill", "stop"):
        at = int(np.searchsorted(theirs.time_s, each.at_s + 1e-6)) - 1
        if other not in (each.kill or each.stop or ()) or at < 0 or not theirs.flies[at]:
            continue
        last_s, setpoint = float(theirs.time_s[at]), complex(theirs.setpoint_mps[at])
        again_s = float(theirs.time_s[at + 1]) if at + 1 < len(theirs.time_s) else math.inf
        age_s = mine.time_s - last_s
        mesh = seen.flown.scenario.mesh
        looks = (age_s > FRESH_S + mesh.delay_s + mesh.jitter_s + 0.2) & (age_s < _LOOKS_S)
        looks &= mine.time_s < again_s
        apart = mine.stop_point_m - complex(theirs.stop_point_m[at])
        along_s = (apart * setpoint.conjugate()).real / abs(setpoint) ** 2
        apart = apart - setpoint * np.clip(along_s, 0.0, SILENT_FLIES_S)
        room = np.abs(apart) - margins.keep_out - margins.growth * np.minimum(age_s, _GROWS_S)
        closing = -(apart * mine.setpoint_mps.conj()).real / np.maximum(np.abs(apart), 1e-9)
        over_mps = closing - np.maximum(RATE * room, -0.5 * margins.speed)
        at_s = _first(mine, over_mps, looks & ~_gave_way(seen, own, mine))
        if at_s is not None:
            yield (
                f"agent {own} flew at {at_s:.1f} s where agent {other} may have been, which was"
                f" silent since {each.at_s:g} s"
            )


def _first(
    mine: _Told, over_mps: npt.NDArray[np.float64], counts: npt.NDArray[np.bool_]
) -> float | None:
    """When two states one after the other were over what is allowed."""
    over = mine.flies & counts & (over_mps > _OVER_MPS)
    twice = np.flatnonzero(over[1:] & over[:-1])
    return float(mine.time_s[twice[0]]) if len(twice) else None


def _doubts(seen: Seen, own: int, mine: _Told, other: int) -> npt.NDArray[np.bool_]:
    """(T,): while it does not believe the other one."""
    found = np.zeros(len(mine.time_s), dtype=np.bool_)
    for before, after in itertools.pairwise(seen.statuses[own]):
        if other in before.doubted or other in after.doubted:
            found |= (mine.time_s >= before.time_s) & (mine.time_s <= after.time_s)
    return found


def _gave_way(seen: Seen, agent: int, mine: _Told) -> npt.NDArray[np.bool_]:
    """While its keep-outs excluded each other, and all gave way a little."""
    found = np.zeros(len(mine.time_s), dtype=np.bool_)
    for before, after in itertools.pairwise(seen.statuses[agent]):
        if after.safety.yielded != before.safety.yielded:
            found |= (mine.time_s >= before.time_s - 0.1) & (mine.time_s <= after.time_s + 0.1)
    return found
