"""From flown velocity steps to a vehicle's `Response`: dead time, first-order lag and acceleration
limit.

The model is the one behind the stop point (`core/kernel/response.py`): a setpoint acts after the
dead time, then `dv/dt = (setpoint - v) / lag`, never faster than the limit. The fit minimises the
squared difference between modelled and flown velocity. Times are the controller's own, of sending
and of hearing, so the dead time contains all that lies between: the vehicle link both ways, the
vehicle's own delay, and the part of jerk limits and motors that looks like a delay. The stop point
needs just that, because it starts from the newest position that was heard.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from swarm_ctl.core.kernel.response import coast_of, coasted, pending, rest
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.plan import Response

DEAD_TIME_S: Final = (0.0, 2.0)
LAG_S: Final = (0.02, 5.0)
ACCELERATION_MPS2: Final = (0.1, 20.0)
"""The ranges searched; a mission file allows the same."""
_DT_S: Final = 0.025
"""The model's own step: half a tick."""
_ROUNDS: Final = 11
"""Refinements, each by `_FINER`: from the first grid's spacing to half a hundredth of it."""
_MOVES: Final = 30
"""Grids at most, finer ones and those that move."""
_FINER: Final = 0.6
_COUNTS: Final = (15, 13, 9)
"""Points of the first grid: dead times, lags, limits."""
_STARTS: Final = 3
"""Searches at most."""
_FLAT: Final = 1.3
"""A smaller ratio of mean squares does not tell the acceleration limit, so the typical one is kept.
ArduCopter's steps of 3 m/s fit best without a limit; but with the typical one stop points are
predicted better in turns, and at 5 m/s twice as well."""
_EXACT: Final = 1e-5
"""A mean square of so little [m2/s2] is of the model's own steps, not of the vehicle."""
_AT_REST_MPS: Final = 0.2
_STOPPING_S: Final = 2.5
"""The predicted stop point is compared with the place of rest for this long after a stop."""

BAD_SHARE: Final = 0.25
"""With a residual of this share of the step the model does not describe the vehicle."""
POOR_SHARE: Final = 0.1
_SPREAD_S: Final = 0.15
_UNUSUAL_S: Final = 0.25
_UNUSUAL: Final = 1.6


@dataclass(frozen=True, slots=True)
class Leg:
    """Steps along one line, out and back, begun at rest; one sample a tick, positive outwards."""

    way: str
    """`north`, `east`."""
    kind: str
    """`3 m/s for 1.5 s`; the same in all directions."""
    times_s: Sequence[float]
    commands_mps: Sequence[float]
    """The setpoint sent at that time, in force until the next."""
    positions_m: Sequence[float]
    velocities_mps: Sequence[float]
    """As known at that time, before the setpoint was sent."""

    @property
    def step_mps(self) -> float:
        """The largest command."""
        return max(abs(command) for command in self.commands_mps)


_LEAST_DOUBT_S, _MOST_DOUBT_S = 0.1, 1.0
"""Of a measured response: wind and the length of the steps change it."""


@dataclass(frozen=True, slots=True)
class Fit:
    """The response that was found, and how far to trust it."""

    response: Response
    limited: bool
    """The steps tell the acceleration limit. If not, the response has the typical limit, provided
    that it fits."""
    residual_mps: float
    """Root mean square of flown minus modelled velocity."""
    share: float
    """The same, relative to the steps."""
    stop_rms_m: float
    """From the predicted stop point to the place of rest, over all ticks of all stops."""
    stop_most_m: float
    spread: tuple[Response, ...]
    """Dead time and lag of each leg alone."""
    warnings: tuple[str, ...]
    usable: bool
    """False: not to be flown with."""

    @property
    def rounded(self) -> Response:
        """As it is written into a file: to 10 ms and 0.1 m/s2, with its doubt."""
        r = self.response
        lag_s = max(round(r.lag_s, 2), LAG_S[0])
        return Response(
            round(r.dead_time_s, 2), lag_s, round(r.acceleration_mps2, 1), round(self.doubt_s, 2)
        )

    @property
    def doubt_s(self) -> float:
        """By how much dead time and lag together may be off: as far as one leg is from all."""
        whole = self.response.dead_time_s + self.response.lag_s
        off_s = (abs(leg.dead_time_s + leg.lag_s - whole) for leg in self.spread)
        return min(max(_LEAST_DOUBT_S, *off_s), _MOST_DOUBT_S)


def fit(legs: Sequence[Leg], typical: Response) -> Fit:
    """The response that fits the flown legs best.

    Args:
        legs: at least one, with at least one step each.
        typical: the autopilot's usual response. Its acceleration limit is kept where no step
            reached one, and warnings compare with it.

    Raises:
        ValueError: no leg, or a leg without a step.
    """
    if not legs or not all(leg.step_mps > 0.0 for leg in legs):
        raise ValueError("no steps to fit")
    runs = [_Run(leg) for leg in legs]
    found = _best(runs, (DEAD_TIME_S, LAG_S, ACCELERATION_MPS2))
    unbounded = _best(runs, (DEAD_TIME_S, LAG_S, (ACCELERATION_MPS2[1],) * 2))
    flat = _FLAT * max(_error(runs, found), _EXACT)
    limited = _error(runs, unbounded) > flat
    if not limited:
        usual = _best(runs, (DEAD_TIME_S, LAG_S, (typical.acceleration_mps2,) * 2))
        found = usual if _error(runs, usual) <= flat else found
    bounds = (DEAD_TIME_S, LAG_S, (found.acceleration_mps2,) * 2)
    spread = tuple(_best([run], bounds) for run in runs)
    residual = math.sqrt(_error(runs, found))
    share = residual / math.sqrt(float(np.mean([leg.step_mps**2 for leg in legs])))
    stops = np.concatenate([_stop_errors(leg, found) for leg in legs])
    stop_rms, stop_most = (
        (math.sqrt(float(np.mean(stops**2))), float(stops.max())) if stops.size else (math.nan,) * 2
    )
    warnings = tuple(_warnings(legs, found, typical, spread, share))
    usable = share < BAD_SHARE and _inside(found)
    return Fit(
        response=found,
        limited=limited,
        residual_mps=residual,
        share=share,
        stop_rms_m=stop_rms,
        stop_most_m=stop_most,
        spread=spread,
        warnings=warnings,
        usable=usable,
    )


def model(times_s: Sequence[float], commands_mps: Sequence[float], vehicle: Response) -> Floats:
    """Velocities (n,) [m/s] at `times_s` (n,), from rest, of a vehicle with exactly this
    response."""
    run = _Run(Leg("", "", times_s, commands_mps, (0.0,) * len(times_s), (0.0,) * len(times_s)))
    return run.velocities(*(np.array([x]) for x in _numbers(vehicle)))[:, 0]


class _Run:
    """One leg, laid out for the model: its setpoints as an integral over time, so that a dead time
    is a shift."""

    def __init__(self, leg: Leg) -> None:
        self._times = np.asarray(leg.times_s, dtype=np.float64)
        commands = np.asarray(leg.commands_mps, dtype=np.float64)
        self._flown = np.asarray(leg.velocities_mps, dtype=np.float64)
        flown_on = np.concatenate([[0.0], np.cumsum(commands[:-1] * np.diff(self._times))])
        steps = math.ceil((self._times[-1] - self._times[0]) / _DT_S) + 1
        self._grid = self._times[0] + _DT_S * np.arange(steps + 1)
        self._before = np.concatenate([[self._times[0] - DEAD_TIME_S[1] - 1.0], self._times])
        self._integral = np.concatenate([[0.0], flown_on])
        cell = (self._times - self._times[0]) / _DT_S
        self._cell = np.minimum(cell.astype(np.intp), steps - 1)
        self._part = (cell - self._cell)[:, None]

    def velocities(self, dead_s: Floats, lag_s: Floats, most_mps2: Floats) -> Floats:
        """(n, k): for each sample the velocity of k models, given as (k,) each."""
        shifted = np.interp(self._grid[:, None] - dead_s, self._before, self._integral)
        acting = np.diff(shifted, axis=0) / _DT_S
        share, bound = -np.expm1(-_DT_S / lag_s), most_mps2 * _DT_S
        v = np.full_like(dead_s, self._flown[0])
        course = [v]
        for command in acting:
            dv = (command - v) * share
            v = v + np.minimum(np.maximum(dv, -bound), bound)
            course.append(v)
        flown = np.array(course)
        answer: Floats = flown[self._cell] * (1.0 - self._part) + flown[self._cell + 1] * self._part
        return answer

    def errors(self, dead_s: Floats, lag_s: Floats, most_mps2: Floats) -> Floats:
        """(k,) mean squares [m2/s2]."""
        misses = self.velocities(dead_s, lag_s, most_mps2) - self._flown[:, None]
        answer: Floats = np.mean(misses**2, axis=0)
        return answer


Bounds = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def _best(runs: Sequence[_Run], bounds: Bounds) -> Response:
    """Least squares by grids that move to their best point and get finer: they cannot diverge.

    A long lag and a low limit look alike to a coarse grid: once a lag of 0.8 s was found as 0.06 s.
    So each lag of the first grid that is better than its neighbours begins a search of its own.
    Lag and acceleration are spaced by ratios.
    """
    low, high = (np.array(_scaled([bound[end] for bound in bounds])) for end in (0, 1))
    gaps = (high - low) / (np.array(_COUNTS) - 1)
    axes = [
        np.linspace(a, b, n if b > a else 1) for a, b, n in zip(low, high, _COUNTS, strict=True)
    ]
    points, costs = _tried(runs, axes)
    by_lag = costs.reshape([len(axis) for axis in axes]).min(axis=(0, 2))
    walled = np.concatenate([[math.inf], by_lag, [math.inf]])
    valleys = np.flatnonzero((by_lag <= walled[:-2]) & (by_lag <= walled[2:]))
    valleys = valleys[np.argsort(by_lag[valleys])][:_STARTS]
    of_lag = np.broadcast_to(np.arange(len(axes[1]))[:, None], [len(axis) for axis in axes]).ravel()
    starts = [points[:, int(np.argmin(np.where(of_lag == k, costs, math.inf)))] for k in valleys]
    found = [_refined(runs, start, gaps, (low, high)) for start in starts]
    best = min(found, key=lambda each: each[1])[0]
    return Response(float(best[0]), math.exp(best[1]), math.exp(best[2]))


def _tried(runs: Sequence[_Run], axes: Sequence[Floats]) -> tuple[Floats, Floats]:
    """The grid's points (3, k), and the cost (k,) of each."""
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    dead, lag, most = points[0], np.exp(points[1]), np.exp(points[2])
    costs: Floats = np.sum([run.errors(dead, lag, most) for run in runs], axis=0)
    return points, costs


def _refined(
    runs: Sequence[_Run], best: Floats, gaps: Floats, limits: tuple[Floats, Floats]
) -> tuple[Floats, float]:
    """The best point that a grid around it leads to, and its cost. While its best point lies at its
    edge the grid moves; then it becomes finer. A valley may be longer than finer grids reach."""
    cost, finer = math.inf, 0
    for _ in range(_MOVES):
        around = zip(best, gaps, *limits, strict=True)
        axes = [
            np.unique(np.clip(x + gap * np.linspace(-1, 1, 5), a, b)) for x, gap, a, b in around
        ]
        points, costs = _tried(runs, axes)
        best_at = int(np.argmin(costs))
        moved = bool(np.any(np.abs(points[:, best_at] - best) > 0.75 * gaps))
        best, cost = points[:, best_at], float(costs[best_at])
        if moved:
            continue
        gaps = gaps * _FINER
        finer += 1
        if finer == _ROUNDS - 1:
            break
    return best, cost


def _scaled(numbers: Sequence[float]) -> list[float]:
    dead_s, lag_s, most_mps2 = numbers
    return [dead_s, math.log(lag_s), math.log(most_mps2)]


def _error(runs: Sequence[_Run], vehicle: Response) -> float:
    return float(
        np.mean([run.errors(*(np.array([x]) for x in _numbers(vehicle)))[0] for run in runs])
    )


def _numbers(vehicle: Response) -> tuple[float, float, float]:
    return vehicle.dead_time_s, vehicle.lag_s, vehicle.acceleration_mps2


def _inside(vehicle: Response) -> bool:
    """The response is not at the end of the range searched, beyond which the truth may lie."""
    return vehicle.dead_time_s < DEAD_TIME_S[1] - 0.01 and vehicle.lag_s < 0.98 * LAG_S[1]


def _stop_errors(leg: Leg, vehicle: Response) -> Floats:
    """Distances [m] from predicted stop points to the place of rest, each tick after each stop."""
    times, commands = np.asarray(leg.times_s), np.asarray(leg.commands_mps)
    positions, velocities = np.asarray(leg.positions_m), np.asarray(leg.velocities_mps)
    tick_s = float(np.median(np.diff(times)))
    ahead = pending(vehicle, tick_s)
    before = np.concatenate([np.zeros(ahead), commands]).tolist()
    predicted = np.array(
        [
            stop_point(position, velocity, before[k : k + ahead], tick_s, vehicle).real
            for k, (position, velocity) in enumerate(
                zip(positions.tolist(), velocities.tolist(), strict=True)
            )
        ]
    )
    stopped = np.concatenate([[False], commands == 0.0, [False]])
    edges = np.flatnonzero(np.diff(stopped.astype(np.int8)))
    found = [np.zeros(0)]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if begin > 0 and abs(velocities[end - 1]) < _AT_REST_MPS:
            soon = slice(
                begin, begin + int(np.searchsorted(times[begin:end], times[begin] + _STOPPING_S))
            )
            found.append(np.abs(predicted[soon] - positions[end - 1]))
    return np.concatenate(found)


def _warnings(
    legs: Sequence[Leg],
    found: Response,
    typical: Response,
    spread: Sequence[Response],
    share: float,
) -> Iterator[str]:
    if share >= POOR_SHARE:
        yield (
            f"the velocity differs from the model's by {share:.0%} of the step: wind, or a vehicle "
            "that answers unlike dead time and lag"
        )
    if not _inside(found):
        most = f"{DEAD_TIME_S[1]:g} s, {LAG_S[1]:g} s"
        yield f"dead time or lag lies beyond what is looked for ({most})"
    for kind in dict.fromkeys(leg.kind for leg in legs):
        alike = [
            r.dead_time_s + r.lag_s for leg, r in zip(legs, spread, strict=True) if leg.kind == kind
        ]
        if max(alike) - min(alike) > _SPREAD_S:
            span = f"{min(alike):.2f} to {max(alike):.2f} s"
            yield f"{kind}: dead time and lag together are {span} from way to way"
    if abs(found.dead_time_s - typical.dead_time_s) > _UNUSUAL_S:
        usual = f"unusual for this autopilot ({typical.dead_time_s:g} s)"
        yield f"a dead time of {found.dead_time_s:.2f} s is {usual}"
    if not 1 / _UNUSUAL < found.lag_s / typical.lag_s < _UNUSUAL:
        yield f"a lag of {found.lag_s:.2f} s is unusual for this autopilot ({typical.lag_s:g} s)"


def stop_point(
    position: complex,
    velocity: complex,
    commands: Iterable[complex],
    tick_s: float,
    vehicle: Response,
) -> complex:
    """Where a vehicle ends up [m] if zero velocity is commanded from now on.

    Args:
        position: now [m].
        velocity: now [m/s].
        commands: those still in the dead time [m/s], oldest first, one per `tick_s`.
        tick_s: between two of them.
        vehicle: dead time, lag, acceleration limit.
    """
    coast = coast_of(vehicle, tick_s)
    for acting in commands:
        position, velocity = coasted(position, velocity, acting, 1.0, coast)
    return rest(position, velocity, coast)
