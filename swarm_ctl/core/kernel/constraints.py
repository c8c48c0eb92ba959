"""The constraints between the law's wish and a vehicle, as half-planes of velocities.

For each other aircraft j that may be near, `q` points to the own stop point from the nearest place
that j's may have reached, and `x = |q|`:

    q/x . v >= min(0.5 v_max, -RATE share (x - D_j))               keep-out: `keep_out`
    |v| <= slow + min((v_max - slow) (x - D_j) / zone, sqrt(2 a (x - D_j))),
    |v| <= (spare + x - D_j) / (2 unsure)                          caution near D: `cap`,
                                                 but for what a keep-out asks for
    -q/x . v >= min(0.45 v_max, -0.5 (0.98 r - x) + undone)        guard of a link: `guard`

`core/kernel/program.py` finds the velocity nearest to the wish that satisfies them all. What is
proven, under which assumptions, and what is only measured: `docs/understand/safety-evidence.md`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from swarm_ctl.core.model.plan import LawParameters, Response
from swarm_ctl.core.model.timeouts import FAR_LATE_S, PREDICT_S, SILENT_FLIES_S

RATE: Final = 2.0
"""[1/s] of the room that is left; bears news up to 1 / (e rate) = 0.18 s old. With 3, vehicles that
answered late hit others that fell silent before they knew it (`studies/late-deaths.yaml`)."""
_KEEP_OUT: Final = 0.35
"""D lies so far from r_in to r_out: room for what the stop point does not know. At 0.3, simulated
ArduCopters that crossed came within 0.57 units (r_in 0.5); at 0.4, 90 of 96 such missions had not
formed after 40 s."""
_GROWTH: Final = 0.1
"""D grows with the age of the news, by this share of r_out - r_in per second, for at most
`_GROWS_S`."""
_GROWS_S: Final = 3.0
_ZONE: Final = 0.45
"""Caution reaches so far beyond D at least, in r_out - r_in."""
_PASSING: Final = 1.6
"""Two that pass each other turn less than in a circle: beyond caution, so many times the speed is
flown that the proven bound allows to two that circle there. Two simulated ArduCopters that change
places head-on, in units of 1.5 to 3 m: 1.10 r_in and more; with 1.85 once 0.94. Where caution was
0.45 units wide whatever the speed, 0.67 in units of 1.5 m."""
_PASSED: Final = 0.2
"""Of caution's width: so far beyond D a silent aircraft is passed."""
_STEP: Final = 0.01
_LAG_ERROR: Final = 1.2
"""Vehicles may lag so much more than their model says."""
_SPARE: Final = 1.15
"""By this much the proven bound of two cautious vehicles lies over r_in."""
_TURNS: Final = 0.3
"""A limit `a` of acceleration delays a turn at speed `v` as a further lag of this times `v / a`
would. Without it, vehicles that answer fast and accelerate slowly came within 0.44 units; with it
the swaps of docs/understand/safety-evidence.md form some per cent later."""
_LEFT: Final = 1.1
"""In r_in: what is left between two vehicles whose stop points are off by all that is doubted."""
_UNSURE_S: Final = 2.0
"""Farther out than a vehicle flies in this time, less what D spares, doubt slows no vehicle: twice
the doubt of a vehicle that was never measured, and as much for the difference to a peer's."""
_ESCAPE: Final = 0.5
"""Of the top speed: the most that a keep-out asks for where two are under D."""
_GUARD_RATE: Final = 1.0
"""[1/s]: holds with news up to 1 / (e rate) = 0.37 s old."""
_GUARD_AT: Final = 0.98
"""In r: where the guard ends a link's growth."""
_GUARD_SLOTS: Final = 0.985
_GUARD_TO: Final = 1.2
"""In r: the guard leaves links alone whose slots are farther apart, or that are longer already."""
_GUARD_TIGHT: Final = 0.9
"""In r: links that the shape stretches so far leave no room to go round another agent. A
dead-locked agent drops these link constraints; otherwise two facing columns of twenty, 2.1 units
from row to row, never part."""
_GUARD_PULL: Final = 0.45
"""Of the top speed: the most that the guard of a link that is too long asks for. Less than
`_ESCAPE`: keeping apart comes before keeping together."""
UNTOUCHED: Final = 1e-6
"""A velocity this close to the wish counts as unchanged."""
_ONE_SPOT: Final = 1e-9


class Margins(NamedTuple):
    """The filter's lengths, speeds and acceleration, in one unit of length."""

    keep_out: float
    """D for fresh news."""
    growth: float
    """Of D, per second of age."""
    zone: float
    """Caution begins so far outside D: in little room for the speed, farther."""
    slow: float
    """Speed allowed to two that are at D."""
    speed: float
    """The top speed."""
    r: float
    """Interaction range."""
    spare: float
    """Of D, what doubt of the own response may use up."""
    braking: float
    """Acceleration that is counted on to stop."""
    firm: float
    """Beyond D plus this, an aircraft of which nothing is unsure neither forbids what the speed
    limit allows nor slows."""
    reach: float
    """Beyond D plus this, an aircraft that does its half constrains nothing."""
    farthest: float
    """An aircraft whose told stop point is farther away constrains nothing: a silent vehicle may
    have flown on with its last setpoint."""
    guards_from: float
    """Under this length a link's guard forbids nothing that the speed limit allows."""


def margins_of(
    law: LawParameters, response: Response, speed_mps: float, unit_m: float, scale_m: float = 1.0
) -> Margins:
    """For vehicles with this response; lengths of `law` are units of `unit_m`, those of the margins
    of `scale_m`."""
    r_in, span = law.r_in * unit_m, (law.r_out - law.r_in) * unit_m
    keep_out, most = r_in + _KEEP_OUT * span, response.acceleration_mps2
    slow = min(circling(_SPARE * r_in, keep_out, response, share=0.5), speed_mps)
    zone = _ZONE * span
    while _PASSING * circling(_SPARE * r_in, keep_out + zone, response, share=0.5) < speed_mps:
        zone += _STEP * span
    growth, r, spare = _GROWTH * span, law.r * unit_m, keep_out - _LEFT * r_in
    stops = (speed_mps - slow) ** 2 / (2.0 * most)
    firm = max(zone, speed_mps / (0.5 * RATE), stops)
    reach = max(firm, 2.0 * speed_mps * (0.5 * _UNSURE_S) - spare)
    farthest = keep_out + reach + _GROWS_S * growth + speed_mps * SILENT_FLIES_S
    guards_from = _GUARD_AT * r - 2.0 * speed_mps / _GUARD_RATE
    lengths = (keep_out, growth, zone, slow, speed_mps, r, spare, most)
    return Margins(*(length / scale_m for length in (*lengths, firm, reach, farthest, guards_from)))


def circling(kept: float, x: float, response: Response, *, share: float = 1.0) -> float:
    """The speed v at which stop points that circle at distance x keep positions at distance `kept`
    by the proven bound, x F(v tau / (share x)) = kept, with tau = lag + _TURNS v / most.

    Args:
        kept: of positions, less than x [m, as x].
        x: of stop points.
        response: of the vehicle.
        share: of the velocity between the two that each has: 0.5 for two vehicles, 1 for one round
            a corner.
    """
    most, lag_s = response.acceleration_mps2, _LAG_ERROR * response.lag_s
    widest = share * _widest(kept / x) * x
    return 2.0 * widest / (lag_s + math.sqrt(lag_s * lag_s + 4.0 * _TURNS / most * widest))


def minded(unsure_s: float, margins: Margins) -> float:
    """Beyond D plus this, an aircraft of which no more than `unsure_s` is `unsure` neither forbids
    what the speed limit allows nor slows."""
    return max(margins.firm, 2.0 * margins.speed * unsure_s - margins.spare)


class Other(NamedTuple):
    """What is known of one other aircraft."""

    about: int
    """Its id."""
    lower: bool
    """The own id is lower: decides which way two on one spot part."""
    apart: complex
    """Own stop point minus its, as it was told."""
    setpoint: complex
    """The velocity it was told to fly."""
    age_s: float
    """Of that news, at most."""
    flown_s: float
    """For so long it may have flown on since (`flown_s`)."""
    yields: bool
    """It does its half of keeping apart."""
    response_s: float
    """From a setpoint to its flown velocity, as it tells; 0 where it tells none."""
    along: bool
    """It flies the same formation."""


_WITH: Final = 0.5
"""Of the formation's velocity."""
NO_OTHER: Final = Other(
    about=0,
    lower=False,
    apart=0j,
    setpoint=0j,
    age_s=0.0,
    flown_s=0.0,
    yields=False,
    response_s=0.0,
    along=False,
)


def flies_with(setpoint: complex, moving: complex) -> bool:
    """Whether one that is told to fly this [m/s] makes at least half of the way that its formation
    makes. One that something else holds up does not: who counts on it flies into it."""
    along = (setpoint * moving.conjugate()).real
    return along >= _WITH * (moving * moving.conjugate()).real


def flown_s(age_s: float, fresh: bool, rare: bool) -> float:
    """For so long [s] it may have flown on with the setpoint of its news. `rare`: the news is a far
    word, up to `FAR_LATE_S` older than the last state of an agent that fell silent."""
    if fresh:
        return age_s
    return SILENT_FLIES_S + FAR_LATE_S if rare else SILENT_FLIES_S


def nearest(apart: complex, setpoint: complex, seconds: float) -> complex:
    """From the nearest place on the way that it may have flown in this time; `apart` is from where
    it was told."""
    along = (apart * setpoint.conjugate()).real / max(abs(setpoint) ** 2, 1e-12)
    return apart - setpoint * max(0.0, min(along, seconds))


def passed_at(age_s: float, margins: Margins) -> float:
    """How far from one that is silent for so long another passes: a little more than the keep-out
    asks for."""
    return margins.keep_out + margins.growth * min(age_s, _GROWS_S) + _PASSED * margins.zone


def constrains(
    distance: float,
    setpoint: complex,
    age_s: float,
    flown_s: float,
    yields: bool,
    reach: float,
    margins: Margins,
) -> bool:
    """An aircraft at this distance, as it was told, may constrain a velocity.

    Args:
        distance: from the own stop point to its.
        setpoint: as in `Other`, as the next three.
        age_s: of the news.
        flown_s: for so long it may have flown on.
        yields: it does its half.
        reach: `margins.reach`, or less where less is unsure.
        margins: lengths and speeds.
    """
    grows_s = age_s if yields else _GROWS_S
    flown = abs(setpoint) * flown_s
    return distance < margins.keep_out + reach + flown + margins.growth * grows_s


def keep_out(other: Other, margins: Margins) -> tuple[complex, float, float]:
    """(normal, bound, room) of the keep-out against one other aircraft, which may have flown on
    with its setpoint until now; room is x - D."""
    apart = other.apart
    if abs(apart) <= _ONE_SPOT:
        apart = complex(_ONE_SPOT if other.lower else -_ONE_SPOT, 0.0)
    q = nearest(apart, other.setpoint, other.flown_s)
    x = abs(q)
    room = x - (margins.keep_out + margins.growth * min(other.age_s, _GROWS_S))
    share = 0.5 if other.yields else 1.0
    return q / max(x, 1e-12), min(_ESCAPE * margins.speed, -RATE * share * room), room


def cap(room: float, unsure_s: float, margins: Margins) -> float:
    """Speed allowed with this much room to a keep-out.

    Args:
        room: x - D.
        unsure_s: the own stop point is off by at most this times the own speed (`unsure`).
        margins: lengths and speeds.
    """
    room = max(0.0, room)
    share = min(1.0, room / margins.zone)
    turns = margins.slow + (margins.speed - margins.slow) * share
    # each of two vehicles may use up half of what lies between D and r_in
    sure = (margins.spare + room) / max(2.0 * unsure_s, 1e-3)
    stops: float = margins.slow + (2.0 * margins.braking * room) ** 0.5
    return min(min(turns, stops), min(sure, margins.speed))


def unsure(doubt_s: float, response_s: float, other: Other) -> float:
    """For how long [s] the own vehicle may fly on unforeseen, seen by another aircraft.

    Its own response is not known better than `doubt_s`. And where one of the two answers later, its
    position still is where its stop point was, while the other's is there already. All of that
    difference counts, for both: with half of it, `studies/room.yaml` at 5 m/s came within 0.43
    units instead of 0.68; for the quick one alone, `studies/unlike.yaml` within 0.25.
    """
    if other.response_s == 0.0:
        return doubt_s + 0.0
    return doubt_s + abs(other.response_s - response_s)


def carried(apart: complex, setpoint: complex, age_s: float) -> complex:
    """`apart`, with the other carried on by its setpoint to now."""
    return apart - setpoint * min(age_s, PREDICT_S)


def guard(apart: complex, setpoint: complex, margins: Margins) -> tuple[complex, float]:
    """(normal, bound) of the guard that keeps a link's stop points within r.

    What the other end does not do of its half (another aircraft pushes it away), this one does as
    well.

    Args:
        apart: own stop point minus the other's, now.
        setpoint: of the other.
        margins: lengths and speeds.
    """
    x = abs(apart)
    away = apart / max(x, 1e-12)
    half = -0.5 * _GUARD_RATE * (_GUARD_AT * margins.r - x)
    undone = max(0.0, half - (away * setpoint.conjugate()).real)
    return -away, min(_GUARD_PULL * margins.speed, half + undone)


def fits(slots_apart: float, margins: Margins) -> bool:
    """A link whose slots are so far apart may be guarded."""
    return slots_apart <= _GUARD_SLOTS * margins.r


def kept(length: float, margins: Margins) -> bool:
    """A link of this length is not lost yet."""
    return length <= _GUARD_TO * margins.r


def tight(slots_apart: float, margins: Margins) -> bool:
    """A dead-locked agent that goes sideways drops the constraint of this link."""
    return slots_apart > _GUARD_TIGHT * margins.r


def _widest(ratio: float) -> float:
    """The largest m with F(m) >= `ratio`, 0 < ratio < 1, by bisection; F falls."""
    low, high = 0.0, 1.5
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _average(middle) >= ratio else (low, middle)
    return low


def _average(m: float) -> float:
    """F(m) = int_0^inf e^-u f(m u) du with f(a) = cos a up to pi/2, then pi/2 - a, in closed
    form."""
    if m < 1e-9:
        return 1.0
    tail = math.exp(-0.5 * math.pi / m)
    return (1.0 + m * tail) / (1.0 + m * m) - m * tail
