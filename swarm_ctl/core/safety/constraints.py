"""The constraints of `core/kernel/constraints.py` for arrays of agents, until studies fly the
kernel itself: a test holds the two together.

A horizontal vector is the complex number north + 1j * east, in any one unit of length.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Any, Final, Protocol

from swarm_ctl.core.model.arrays import ONE, Arithmetic
from swarm_ctl.core.model.plan import LawParameters, Response
from swarm_ctl.core.model.timeouts import PREDICT_S, SILENT_FLIES_S

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
_STEP: Final = 0.01
_LAG_ERROR: Final = 1.2
"""Vehicles may lag so much more than their model says."""
_SPARE: Final = 1.15
"""By this much the proven bound of two cautious vehicles lies over r_in."""
_TURNS: Final = 0.3
"""A limit `a` of acceleration delays a turn at speed `v` as a further lag of this times `v / a`
would. Without it, vehicles that answer fast and accelerate slowly came within 0.44 units; with it
the swaps of docs/pages/safety.md form some per cent later."""
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


class Heard(Protocol):
    """What is known of another aircraft; its fields are numbers or arrays."""

    @property
    def setpoint(self) -> Any:
        """The velocity it was told to fly."""

    @property
    def age_at_most_s(self) -> Any:
        """Of that news."""

    @property
    def fresh(self) -> Any:
        """The news is at most `FRESH_S` old."""

    @property
    def yields(self) -> Any:
        """It does its half of keeping apart."""

    @property
    def response_s(self) -> Any:
        """From a setpoint to its flown velocity, as it tells; 0 where it tells none."""


@dataclass(frozen=True, slots=True)
class Margins:
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

    @classmethod
    def of(cls, law: LawParameters, response: Response, speed_mps: float, unit_m: float) -> Margins:
        """For vehicles with this response, in metres; lengths of `law` are units of `unit_m`."""
        r_in, span = law.r_in * unit_m, (law.r_out - law.r_in) * unit_m
        keep_out, most = r_in + _KEEP_OUT * span, response.acceleration_mps2
        lag_s = _LAG_ERROR * response.lag_s

        def circles(x: float) -> float:
            """The speed of the proven bound x F(2 v tau / x) = _SPARE r_in, with
            tau = lag + _TURNS v / most."""
            widest = 0.5 * _widest(_SPARE * r_in / x) * x
            return 2.0 * widest / (lag_s + math.sqrt(lag_s * lag_s + 4.0 * _TURNS / most * widest))

        slow = circles(keep_out)
        zone = _ZONE * span
        while _PASSING * circles(keep_out + zone) < speed_mps:
            zone += _STEP * span
        return cls(
            keep_out,
            _GROWTH * span,
            zone,
            min(slow, speed_mps),
            speed_mps,
            law.r * unit_m,
            keep_out - _LEFT * r_in,
            most,
        )

    def in_units(self, unit_m: float) -> Margins:
        """The same in units."""
        return Margins(*(value / unit_m for value in astuple(self)))

    @property
    def reach(self) -> float:
        """Beyond D plus this, an aircraft that does its half constrains nothing."""
        return float(self.minded(0.5 * _UNSURE_S))

    def minded(self, unsure_s: Any, of: Arithmetic = ONE) -> Any:
        """Beyond D plus this, an aircraft of which no more than `unsure_s` is `unsure` neither
        forbids what the speed limit allows nor slows."""
        stops = (self.speed - self.slow) ** 2 / (2.0 * self.braking)
        firm = max(self.zone, self.speed / (0.5 * RATE), stops)
        return of.most(firm, 2.0 * self.speed * unsure_s - self.spare)

    @property
    def farthest(self) -> float:
        """An aircraft whose told stop point is farther away constrains nothing: a silent vehicle
        may have flown on with its last setpoint."""
        return self.keep_out + self.reach + _GROWS_S * self.growth + self.speed * SILENT_FLIES_S

    @property
    def guards_from(self) -> float:
        """Under this length a link's guard forbids nothing that the speed limit allows."""
        return _GUARD_AT * self.r - 2.0 * self.speed / _GUARD_RATE


def _flown_s(other: Heard, of: Arithmetic) -> Any:
    """For so long it may have flown on with its setpoint."""
    return of.where(other.fresh, other.age_at_most_s, SILENT_FLIES_S)


def constrains(
    other: Heard, distance: Any, margins: Margins, of: Arithmetic = ONE, reach: Any = None
) -> Any:
    """An aircraft at this distance, as it was told, may constrain a velocity.

    Args:
        other: what is known of it.
        distance: from the own stop point to its.
        margins: lengths and speeds.
        of: `MANY` for arrays.
        reach: `margins.reach`, asked for once, or less where less is unsure.
    """
    grows_s = of.where(other.fresh & other.yields, other.age_at_most_s, _GROWS_S)
    flown = abs(other.setpoint) * _flown_s(other, of)
    reach = margins.reach if reach is None else reach
    return distance < margins.keep_out + reach + flown + margins.growth * grows_s


def keep_out_plane(
    apart: Any, lower: Any, other: Heard, margins: Margins, of: Arithmetic = ONE
) -> tuple[Any, Any, Any]:
    """(normal, bound, room) of the keep-out against one other aircraft; room is x - D.

    Args:
        apart: own stop point minus the other's, as it was told.
        lower: the own id is lower: decides which way two on one spot part.
        other: it may have flown on with its setpoint until now.
        margins: lengths and speeds.
        of: `MANY` for arrays.
    """
    north = of.where(lower, _ONE_SPOT, -_ONE_SPOT)
    apart = of.where(abs(apart) > _ONE_SPOT, apart, north + 0j)
    # the nearest place on the way that it may have flown
    setpoint = other.setpoint
    along = (apart * setpoint.conjugate()).real / of.most(abs(setpoint) ** 2, 1e-12)
    q = apart - setpoint * of.most(0.0, of.least(along, _flown_s(other, of)))
    x = abs(q)
    room = x - (margins.keep_out + margins.growth * of.least(other.age_at_most_s, _GROWS_S))
    share = of.where(other.yields, 0.5, 1.0)
    return q / of.most(x, 1e-12), of.least(_ESCAPE * margins.speed, -RATE * share * room), room


def cap(room: Any, unsure_s: Any, margins: Margins, of: Arithmetic = ONE) -> Any:
    """Speed allowed with this much room to a keep-out.

    Args:
        room: x - D.
        unsure_s: the own stop point is off by at most this times the own speed (`unsure`).
        margins: lengths and speeds.
        of: `MANY` for arrays.
    """
    room = of.most(0.0, room)
    share = of.least(1.0, room / margins.zone)
    turns = margins.slow + (margins.speed - margins.slow) * share
    # each of two vehicles may use up half of what lies between D and r_in
    sure = (margins.spare + room) / of.most(2.0 * unsure_s, 1e-3)
    stops = margins.slow + (2.0 * margins.braking * room) ** 0.5
    return of.least(of.least(turns, stops), of.least(sure, margins.speed))


def unsure(doubt_s: Any, response_s: Any, other: Heard, of: Arithmetic = ONE) -> Any:
    """For how long [s] the own vehicle may fly on unforeseen, seen by another aircraft.

    Its own response is not known better than `doubt_s`. And where one of the two answers later, its
    position still is where its stop point was, while the other's is there already. All of that
    difference counts, for both: with half of it, `studies/room.yaml` at 5 m/s came within 0.43
    units instead of 0.68; for the quick one alone, `studies/unlike.yaml` within 0.25.
    """
    differs_s = of.where(other.response_s != 0.0, abs(other.response_s - response_s), 0.0)
    return doubt_s + differs_s


def carried(apart: Any, other: Heard, of: Arithmetic = ONE) -> Any:
    """`apart`, with the other carried on by its setpoint to now."""
    return apart - other.setpoint * of.least(other.age_at_most_s, PREDICT_S)


def guard_plane(
    apart: Any, setpoint: Any, margins: Margins, of: Arithmetic = ONE
) -> tuple[Any, Any]:
    """(normal, bound) of the guard that keeps a link's stop points within r.

    What the other end does not do of its half (another aircraft pushes it away), this one does as
    well.

    Args:
        apart: own stop point minus the other's, now.
        setpoint: of the other.
        margins: lengths and speeds.
        of: `MANY` for arrays.
    """
    x = abs(apart)
    away = apart / of.most(x, 1e-12)
    half = -0.5 * _GUARD_RATE * (_GUARD_AT * margins.r - x)
    undone = of.most(0.0, half - (away * setpoint.conjugate()).real)
    return -away, of.least(_GUARD_PULL * margins.speed, half + undone)


def fits(slots_apart: Any, margins: Margins) -> Any:
    """A link whose slots are so far apart may be guarded."""
    return slots_apart <= _GUARD_SLOTS * margins.r


def kept(length: Any, margins: Margins) -> Any:
    """A link of this length is not lost yet."""
    return length <= _GUARD_TO * margins.r


def tight(slots_apart: Any, margins: Margins) -> Any:
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
