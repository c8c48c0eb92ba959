"""From where everybody is to the velocity to fly: the law on the chosen points, then `core/safety.py`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from swarm_ctl.core import law, response, safety
from swarm_ctl.core.navigation import OwnFix
from swarm_ctl.core.peers import Peers
from swarm_ctl.core.plan import Compensation, Plan, Point
from swarm_ctl.core.state import Gains, PairReport, SigmaReport
from swarm_ctl.core.vehicle import Contact

_APPROACH_RATE = 1.0
"""[1/s] of the room that is left: what a wish may come closer to somebody who stays. Stop points need no more."""
_NOWHERE: Mapping[int, Point] = {}


class Controller:
    """One agent's horizontal control. Remembers its last commands (for the stop point) and the law's last result."""

    def __init__(self, plan: Plan, own_id: int, peers: Peers) -> None:
        self._plan = plan
        self._own = own_id
        self._peers = peers
        delayed = response.pending(plan.response, plan.tick_s) if plan.compensation is Compensation.STOP_POINT else 0
        self._commands: deque[Point] = deque([(0.0, 0.0)] * delayed, maxlen=delayed)
        self.tune(Gains(plan.law.delta_a, plan.law.delta_l, plan.law.h, plan.kappa))
        self._result: law.LawResult | None = None
        self._points = np.zeros((0, 2))
        self._tally = np.zeros(len(law.STATUSES), dtype=np.int64)
        self.overspeed_ticks = 0
        self.commanded_mps: Point = (0.0, 0.0)
        self.stop_point_m: Point = (0.0, 0.0)

    def tune(self, gains: Gains) -> None:
        """The law in force from now on (`core/tuning.py` says when it may change)."""
        self.gains = gains
        self._law = replace(self._plan.law, h=gains.h, delta_l=gains.delta_l, delta_a=gains.delta_a)
        self._iteration_mps = self._plan.unit_m * gains.kappa
        self.gain = gains.kappa * gains.h
        """The law's own rate [1/s]."""

    @property
    def tally(self) -> dict[str, int]:
        """Pair-ticks by sigma status since the start."""
        return {name: int(count) for name, count in zip(law.STATUSES, self._tally, strict=True)}

    def locate(self, fix: OwnFix) -> None:
        """Work out the own stop point for this tick."""
        north, east, _ = fix.position_ned_m
        if self._plan.compensation is Compensation.NONE:
            self.stop_point_m = (north, east)
            return
        self.stop_point_m = response.stop_point(
            (north, east), fix.velocity_ned_mps[:2], self._commands, self._plan.tick_s, self._plan.response
        )

    def form(
        self, now: float, slots: Mapping[int, Point], contacts: Sequence[Contact], extra_mps: Point = (0.0, 0.0)
    ) -> Point:
        """The law (26): velocity (north, east) [m/s] towards the shape `slots` [units], keeping apart.

        `extra_mps` is flown on top: what moves the formation as a whole.
        """
        result = self._evaluate(now, slots, contacts)
        if extra_mps == (0.0, 0.0):
            return self._protected(float(result.u[0, 0]), float(result.u[0, 1]))
        rate = self._iteration_mps
        north, east = float(result.consensus[0, 0]) * rate, float(result.consensus[0, 1]) * rate
        wish = self._around(now, (north + extra_mps[0], east + extra_mps[1]))
        return self._protected(float(result.avoidance[0, 0]), float(result.avoidance[0, 1]), wish)

    def go_to(self, now: float, to_m: Point, speed_mps: float, contacts: Sequence[Contact]) -> Point:
        """Straight to a point, keeping apart from everybody; around whoever stands in the way."""
        result = self._evaluate(now, _NOWHERE, contacts)
        (north, east), gain = self.stop_point_m, self.gain
        pull = safety.shortened((gain * (to_m[0] - north), gain * (to_m[1] - east)), speed_mps)
        return self._protected(float(result.avoidance[0, 0]), float(result.avoidance[0, 1]), self._around(now, pull))

    def keep_clear(self, now: float, contacts: Sequence[Contact]) -> Point:
        """Stay, but make room for whoever comes close: the law's avoidance term alone."""
        result = self._evaluate(now, _NOWHERE, contacts)
        return self._protected(float(result.avoidance[0, 0]), float(result.avoidance[0, 1]))

    def rest(self) -> None:
        """Another than us moves the vehicle this tick, or nobody does."""
        self._result = None
        self.commanded(0.0, 0.0)

    def commanded(self, north_mps: float, east_mps: float) -> None:
        """Remember what this tick's setpoint said: it acts after the dead time."""
        self.commanded_mps = (north_mps, east_mps)
        self._commands.append(self.commanded_mps)

    def _evaluate(self, now: float, slots: Mapping[int, Point], contacts: Sequence[Contact]) -> law.LawResult:
        others = self._peers.law_input(now, self.stop_point_m, slots, contacts)
        unit = self._plan.unit_m
        own = np.array([[self.stop_point_m[0] / unit, self.stop_point_m[1] / unit]])
        own_slot = np.array([slots.get(self._own, (0.0, 0.0))])
        result = law.evaluate(
            own,
            own_slot,
            others.points,
            others.slots,
            others.neighbour,
            others.present,
            others.lower_id,
            self._law,
        )
        if result.pairs is not None:
            counts = np.bincount(result.pairs.status, minlength=len(law.STATUSES))
            self._tally += counts
            self.overspeed_ticks += bool(counts[law.OVERSPEED])
        self._result, self._points = result, others.points[0]
        return result

    def _around(self, now: float, wish_mps: Point) -> Point:
        """The wish, bent around everybody within `r_out` who does not fly along: lost, landing, landed, strangers."""
        pairs = self._result.pairs if self._result is not None else None
        if pairs is None or wish_mps == (0.0, 0.0):
            return wish_mps
        unit, law_ = self._plan.unit_m, self._plan.law
        for k, column in enumerate(pairs.index[-1].tolist()):
            if self._peers.flies_along(column, now):
                continue
            room_m = (float(pairs.distance[k]) - 0.5 * (law_.r_in + law_.r_out)) * unit
            north, east = self._points[column].tolist()
            away = (self.stop_point_m[0] / unit - north, self.stop_point_m[1] / unit - east)
            wish_mps = safety.bent(wish_mps, away, max(0.0, _APPROACH_RATE * room_m))
        return wish_mps

    def _protected(self, u_north: float, u_east: float, extra_mps: Point = (0.0, 0.0)) -> Point:
        north, east = u_north * self._iteration_mps + extra_mps[0], u_east * self._iteration_mps + extra_mps[1]
        velocity = safety.protect((north, east), self._plan.limits)
        self.commanded(*velocity)
        return velocity

    def sigma_report(self, now: float) -> SigmaReport | None:
        """All pairs of the last evaluation; None when nobody was within `r_out`."""
        if self._result is None or self._result.pairs is None:
            return None
        pairs = self._result.pairs
        return SigmaReport(
            self._own,
            now,
            (float(self._result.consensus[0, 0]), float(self._result.consensus[0, 1])),
            (float(self._result.avoidance[0, 0]), float(self._result.avoidance[0, 1])),
            tuple(self._pair(pairs, k) for k in range(len(pairs.distance))),
        )

    def _pair(self, pairs: law.Pairs, k: int) -> PairReport:
        d = float(pairs.d[k])
        return PairReport(
            self._peers.ids[int(pairs.index[-1][k])],
            bool(pairs.neighbour[k]),
            law.STATUSES[int(pairs.status[k])],
            float(pairs.distance[k]),
            float(pairs.sigma[k]),
            float(pairs.sigma_lb[k]),
            float(pairs.d_lb[k]),
            float(pairs.d_ub[k]),
            None if math.isnan(d) else d,
            float(pairs.alpha[k]),
        )
