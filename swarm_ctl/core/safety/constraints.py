"""The last word between the law and the vehicle: no velocity reaches a vehicle without passing
here.

**What is done.** Everything is judged on stop points (`core/law/stop_point.py`), where a vehicle
with dead time and lag is the single integrator `ds/dt = v_cmd`. For each other j that may be near,
with `q` from the nearest place it may have got to, and `x = |q|`:

    q/x . v >= min(0.5 v_max, -rate * share * (x - D_j))           keep-out: a half-plane of
    velocities (`half_plane`)
    |v| <= slow + (v_max - slow) * (x - D_j) / zone, where x < D_j + zone           caution: a speed limit (`cap`)
    -q/x . v >= min(0.45 v_max, -0.5 rate_g * (0.98 r - x) + what j does not do of its half)
                                                                   guard, for links that the shape
                                                                   keeps: soft

and the velocity nearest to the wish that satisfies all of them is flown
(`core/safety/velocity_qp.py`). Where they exclude each other the guard gives way first, then all
keep-outs by the same least slack: none is dropped. `share` is 0.5 where the other does its half, 1
where it does not (lost, landing, landed, a stranger).

**What is proven**, for vehicles that answer exactly as modelled, linearly, with fresh news:
1. `|s_ij| >= D` is invariant: each pair's two half-planes add up to `dx/dt >= -rate (x - D)`, which
   with `rate * tick <= 1` cannot pass zero; v = 0 is allowed from there, so the program always has
   an answer.
2. A position is a positive-weight average of past stop points, so `|s_ij| <= R` always keeps
   `|p_ij| <= R` (the guard); and where no two velocities differ by more than W, `|p_ij| >= D F(W
   tau / D)`, `F(m) = int_0^inf e^-u f(m u) du`, `f(a) = cos a` up to pi/2, then `pi/2 - a`.
   `Margins.of` chooses `slow` so that this is over `r_in`.
3. With news of age A the distance stays over D as long as `rate * A <= 1/e` (a delay equation),
   radially.
**What is only measured**: acceleration limits, vehicles unlike the model, later and lost news,
direction errors of old news, everything about silent vehicles. `swarm-ctl study` measures it.

Written once for one agent and for arrays: a horizontal vector is the complex number north + 1j *
east. Any unit of length will do, if it is the same everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from swarm_ctl.core.model.plan import LawParameters, Limits, Response

RATE: Final = 3.0
"""[1/s] of the room that is left. 2 touches the paper's own regime, 4 covers less age of news (1 /
(e rate))."""
_KEEP_OUT: Final = 0.35
"""D lies so far from r_in to r_out: room for what the stop point does not know. At 0.3 simulated
ArduCopters that crossed came within 0.57 units (r_in 0.5); at 0.4, 90 of 96 such missions had not
formed after 40 s."""
_GROWTH: Final = 0.1
"""D grows with the age of the news, by this share of r_out - r_in per second, for at most
`_GROWS_S`."""
_GROWS_S: Final = 3.0
_ZONE: Final = 0.45
"""Caution reaches so far beyond D, in r_out - r_in."""
_LAG_ERROR: Final = 1.2
"""Vehicles may lag so much more than their model says."""
_SPARE: Final = 1.15
"""By this much the proven bound of two cautious vehicles lies over r_in."""
_ESCAPE: Final = 0.5
"""Of the top speed: what is asked for at most where two are under D."""
_GUARD_RATE: Final = 1.0
"""[1/s]: holds with news up to 1 / (e rate) = 0.37 s old."""
_GUARD_AT: Final = 0.98
_GUARD_SLOTS: Final = 0.985
_GUARD_TO: Final = 1.2
"""In r: where the guard ends a link's growth; links whose slots are farther apart, or that are
longer, it leaves."""
_GUARD_TIGHT: Final = 0.9
"""In r: links that the shape itself stretches so far leave no room to go round anybody. Who is
stuck lets go of them: two columns of twenty that face each other, 2.1 units from row to row, stood
for ever."""
_GUARD_PULL: Final = 0.45
"""Of the top speed: what a link that is too long asks for at most. Less than `_ESCAPE`: apart comes
before together."""

Most = Callable[[Any, Any], Any]


@dataclass(frozen=True, slots=True)
class Margins:
    """The filter's lengths and speeds, in one unit of length."""

    keep_out: float
    """D for fresh news."""
    growth: float
    """Of D, per second of age."""
    zone: float
    slow: float
    """Speed allowed to two that are at D."""
    speed: float
    r: float

    @classmethod
    def of(cls, law: LawParameters, response: Response, speed: float, unit: float = 1.0) -> Margins:
        """For vehicles with this response. `speed` and the result count in a length that a law's
        unit is `unit` of."""
        span = (law.r_out - law.r_in) * unit
        keep_out = law.r_in * unit + _KEEP_OUT * span
        slow = (
            0.5
            * _widest(_SPARE * law.r_in * unit / keep_out)
            * keep_out
            / (_LAG_ERROR * response.lag_s)
        )
        return cls(keep_out, _GROWTH * span, _ZONE * span, min(slow, speed), speed, law.r * unit)

    def out(self, age_s: Any, least: Most = min) -> Any:
        """D for news of this age."""
        return self.keep_out + self.growth * least(age_s, _GROWS_S)

    @property
    def reach(self) -> float:
        """Beyond D plus this nobody forbids anything to an agent whose other does its half."""
        return max(self.zone, self.speed / (0.5 * RATE))


def half_plane(
    apart: Any,
    commanded: Any,
    reach_s: Any,
    keep_out: Any,
    share: Any,
    speed: float,
    least: Most = min,
    most: Most = max,
) -> tuple[Any, Any, Any]:
    """(normal, bound, x - keep_out) of the keep-out plane against one other.

    Args:
        apart: own stop point minus the other's, as it was told.
        commanded: what the other told to command; it may have flown on with it for up to `reach_s`.
        keep_out: D.
        share: of the burden.
        speed: the limit.
        least: `np.minimum` for arrays.
        most: `np.maximum` for arrays.
    """
    along = (apart * commanded.conjugate()).real / most(abs(commanded) ** 2, 1e-12)
    q = apart - commanded * most(0.0, least(along, reach_s))
    x = abs(q)
    room = x - keep_out
    return q / most(x, 1e-12), least(_ESCAPE * speed, -RATE * share * room), room


def cap(room: Any, margins: Margins, most: Most = max, least: Most = min) -> Any:
    """Speed allowed with this much room to the nearest keep-out."""
    return margins.slow + (margins.speed - margins.slow) * least(
        1.0, most(0.0, room) / margins.zone
    )


def guard_plane(
    apart: Any, commanded: Any, margins: Margins, least: Most = min, most: Most = max
) -> tuple[Any, Any]:
    """(normal, bound) of the plane that keeps a link's stop points within r; `apart`, `commanded`
    as in `half_plane`.

    What the other one cannot do of its half (it is pushed away by somebody), this one does as well.
    """
    x = abs(apart)
    away = apart / most(x, 1e-12)
    half = -0.5 * _GUARD_RATE * (_GUARD_AT * margins.r - x)
    undone = most(0.0, half - (away * commanded.conjugate()).real)
    return -away, least(_GUARD_PULL * margins.speed, half + undone)


def guards_from(margins: Margins) -> float:
    """Under this length a link's guard forbids nothing that the speed limit allows."""
    return _GUARD_AT * margins.r - 2.0 * margins.speed / _GUARD_RATE


def guarded(slots_apart: Any, apart: Any, margins: Margins) -> Any:
    """The guard minds this link: its slots fit in r, and it is not lost already (distances, or
    arrays of them)."""
    return (slots_apart <= _GUARD_SLOTS * margins.r) & (apart <= _GUARD_TO * margins.r)


def tight(slots_apart: Any, margins: Margins) -> Any:
    """An agent that goes sideways to get out of a dead-lock does not mind this link."""
    return slots_apart > _GUARD_TIGHT * margins.r


def _widest(ratio: float) -> float:
    """The largest m with F(m) >= `ratio`, 0 < ratio < 1, by bisection; F falls."""
    low, high = 0.0, 1.5
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _average(middle) >= ratio else (low, middle)
    return low


def _average(m: float) -> float:
    """F(m) in closed form: int e^-u f(m u) du with f(a) = cos a up to pi/2, then pi/2 - a."""
    if m < 1e-9:
        return 1.0
    tail = math.exp(-0.5 * math.pi / m)
    return (1.0 + m * tail) / (1.0 + m * m) - m * tail


# --- shaping a wish before it is judged ---


def limited(wish: complex, limits: Limits) -> complex:
    """Scaled to the speed limit. What is not finite becomes zero: stopping is the one answer right
    for every cause."""
    finite = math.isfinite(math.hypot(wish.real, wish.imag))  # abs() of huge ones raises
    return shortened(wish, limits.speed_mps) if finite else 0j


def shortened(vector: complex, most: float) -> complex:
    """The vector, not longer than `most`."""
    length = abs(vector)
    return vector if length <= most else vector / length * most


def bent(wish: complex, away: complex, closing_mps: float) -> complex:
    """The wish, not closing in faster than `closing_mps` on somebody who stays; what is too much
    goes past it.

    `away` points from the other to us. Everybody turns to the same side, so nobody is stuck
    head-on.
    """
    size = abs(away)
    if size < 1e-9:
        return wish
    away /= size
    excess = -(wish * away.conjugate()).real - closing_mps
    return wish + excess * away * (1 - 1j) if excess > 0.0 else wish


def climb_rate(height_error_m: float, limits: Limits) -> float:
    """The slow altitude loop: climb rate [m/s, up] for a height error [m, positive: too low]."""
    if not math.isfinite(height_error_m):
        return 0.0
    return max(-limits.descent_mps, min(limits.climb_mps, _ALTITUDE_GAIN * height_error_m))


_ALTITUDE_GAIN = 0.5
"""[1/s]: well under 1 / (dead time + lag) of any multirotor, so the loop cannot ring."""
