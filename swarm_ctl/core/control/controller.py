"""From where everybody is to the velocity to fly: the law on the chosen points, then the safety
filter."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.law import formation_law, mean_error_feedback, stop_point
from swarm_ctl.core.model.messages import Gains, PairReport, SigmaReport
from swarm_ctl.core.model.plan import Compensation, Plan, Point, Response
from swarm_ctl.core.model.timeouts import lead_s
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.safety import constraints
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.swarm.peers import NOTHING_COMMON, Common, LawInput, Peers

_APPROACH_RATE = 1.0
"""[1/s] of the room that is left: what a wish may come closer to somebody who stays. Stop points
need no more."""
_NOWHERE: Mapping[int, Point] = {}
_COMPLEX = np.array([1.0, 1.0j])


class Controller:
    """One agent's horizontal control. Remembers its last commands (for the stop point) and the
    law's last result.

    `vehicle` is how the own vehicle answers.
    """

    def __init__(self, plan: Plan, own_id: int, peers: Peers, vehicle: Response) -> None:
        self._plan = plan
        self._vehicle = vehicle
        self._own = own_id
        self._peers = peers
        self.keeper = SafetyFilter(plan, own_id, peers, vehicle)
        delayed = stop_point.pending(vehicle, plan.tick_s)
        self._commands: deque[Point] = deque([(0.0, 0.0)] * delayed, maxlen=delayed)
        self.tune(Gains(plan.law.delta_a, plan.law.delta_l, plan.law.h, plan.kappa))
        self._result: formation_law.LawResult | None = None
        self._points = np.zeros((0, 2))
        self._tally = np.zeros(len(formation_law.STATUSES), dtype=np.int64)
        self.overspeed_ticks = 0
        self.commanded_mps: Point = (0.0, 0.0)
        self.stop_point_m: Point = (0.0, 0.0)
        """Where the vehicle would come to rest."""
        self.point_m: Point = (0.0, 0.0)
        """What the law takes it to be at: the stop point, or (`compensation: none`) the
        position."""

    def tune(self, gains: Gains) -> None:
        """The law in force from now on (`core/swarm/gain_update.py` says when it may change)."""
        self.gains = gains
        self._law = replace(self._plan.law, h=gains.h, delta_l=gains.delta_l, delta_a=gains.delta_a)
        self._iteration_mps = self._plan.unit_m * gains.kappa
        self.gain = gains.kappa * gains.h
        """The law's own rate [1/s]."""
        self._lead_s: float = lead_s(self.gain)

    @property
    def tally(self) -> dict[str, int]:
        """Pair-ticks by sigma status since the start."""
        return {
            name: int(count)
            for name, count in zip(formation_law.STATUSES, self._tally, strict=True)
        }

    def locate(self, fix: OwnFix) -> None:
        """Work out the own stop point for this tick."""
        north, east, _ = fix.position_ned_m
        self.stop_point_m = stop_point.stop_point(
            (north, east),
            fix.velocity_ned_mps[:2],
            self._commands,
            self._plan.tick_s,
            self._vehicle,
        )
        self.point_m = (
            (north, east) if self._plan.compensation is Compensation.NONE else self.stop_point_m
        )

    def form(
        self,
        now: float,
        slots: Mapping[int, Point],
        contacts: Sequence[Contact],
        extra_mps: Point = (0.0, 0.0),
        common: Common = NOTHING_COMMON,
    ) -> Point:
        """The law (26): velocity (north, east) [m/s] towards the shape `slots` [units], keeping
        apart.

        `extra_mps` is flown on top: what moves the formation as a whole, of it `common` by
        everybody alike.
        """
        consensus, avoidance = self._terms(now, slots, contacts, common)
        if extra_mps != (0.0, 0.0):
            wish = self._around(now, consensus + complex(*extra_mps))
            return self._kept(now, wish + avoidance, slots, common)
        wish = consensus + self.keeper.turned(
            complex(*self.stop_point_m), now, consensus, avoidance
        )
        if not self._plan.safety.release:
            return self._kept(now, wish, slots)
        release = self.keeper.release
        flown = self._kept(now, release.turn(wish, consensus), slots)
        release.note(consensus, complex(*flown))
        return flown

    def go_to(
        self, now: float, to_m: Point, speed_mps: float, contacts: Sequence[Contact]
    ) -> Point:
        """Straight to a point, keeping apart from everybody; around whoever stands in the way."""
        _, avoidance = self._terms(now, _NOWHERE, contacts)
        pull = constraints.shortened(
            self.gain * (complex(*to_m) - complex(*self.point_m)), speed_mps
        )
        return self._kept(now, avoidance + self._around(now, pull), _NOWHERE)

    def keep_clear(self, now: float, contacts: Sequence[Contact]) -> Point:
        """Stay, but make room for whoever comes close: the law's avoidance term alone."""
        _, avoidance = self._terms(now, _NOWHERE, contacts)
        return self._kept(now, avoidance, _NOWHERE)

    def rest(self) -> None:
        """Another than us moves the vehicle this tick, or nobody does."""
        self._result = None
        self.commanded(0.0, 0.0)

    def commanded(self, north_mps: float, east_mps: float) -> None:
        """Remember what this tick's setpoint said: it acts after the dead time."""
        self.commanded_mps = (north_mps, east_mps)
        self._commands.append(self.commanded_mps)

    def _terms(
        self,
        now: float,
        slots: Mapping[int, Point],
        contacts: Sequence[Contact],
        common: Common = NOTHING_COMMON,
    ) -> tuple[complex, complex]:
        """The law's consensus, with the pull to the average of all who fly the same, and its
        avoidance [m/s]."""
        others = self._peers.law_input(now, self.point_m, slots, contacts, self._lead_s, common)
        result, rate = self._evaluate(others, slots), self._iteration_mps
        (north, east), (away_north, away_east) = (
            result.consensus[0].tolist(),
            result.avoidance[0].tolist(),
        )
        consensus = complex(north, east) * rate
        if self._plan.safety.align and common.flying is not None:
            own = complex(*self.point_m) / self._plan.unit_m - complex(
                *slots.get(self._own, (0.0, 0.0))
            )
            errors = (others.points[0] - others.slots[0]) @ _COMPLEX
            consensus += (
                complex(mean_error_feedback.pull(np.array(own), errors, others.along))
                * self._plan.unit_m
            )
        return consensus, complex(away_north, away_east) * rate

    def _evaluate(self, others: LawInput, slots: Mapping[int, Point]) -> formation_law.LawResult:
        unit = self._plan.unit_m
        own = np.array([[self.point_m[0] / unit, self.point_m[1] / unit]])
        own_slot = np.array([slots.get(self._own, (0.0, 0.0))])
        result = formation_law.evaluate(
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
            counts = np.bincount(result.pairs.status, minlength=len(formation_law.STATUSES))
            self._tally += counts
            self.overspeed_ticks += bool(counts[formation_law.OVERSPEED])
        self._result, self._points = result, others.points[0]
        return result

    def _around(self, now: float, wish_mps: complex) -> complex:
        """The wish, bent around everybody within `r_out` who does not fly along: lost, landing,
        landed, strangers."""
        pairs = self._result.pairs if self._result is not None else None
        if pairs is None or not wish_mps:
            return wish_mps
        unit, law_ = self._plan.unit_m, self._plan.law
        for k, column in enumerate(pairs.index[-1].tolist()):
            if self._peers.flies_along(column, now):
                continue
            room_m = (float(pairs.distance[k]) - 0.5 * (law_.r_in + law_.r_out)) * unit
            away = complex(*self.point_m) / unit - complex(*self._points[column].tolist())
            wish_mps = constraints.bent(wish_mps, away, max(0.0, _APPROACH_RATE * room_m))
        return wish_mps

    def _kept(
        self,
        now: float,
        wish_mps: complex,
        slots: Mapping[int, Point],
        common: Common = NOTHING_COMMON,
    ) -> Point:
        wish = constraints.limited(wish_mps, self._plan.limits)
        flown = self.keeper.keep(now, complex(*self.stop_point_m), wish, slots, common)
        self.commanded(flown.real, flown.imag)
        return self.commanded_mps

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

    def _pair(self, pairs: formation_law.Pairs, k: int) -> PairReport:
        d = float(pairs.d[k])
        return PairReport(
            self._peers.ids[int(pairs.index[-1][k])],
            bool(pairs.neighbour[k]),
            formation_law.STATUSES[int(pairs.status[k])],
            float(pairs.distance[k]),
            float(pairs.sigma[k]),
            float(pairs.sigma_lb[k]),
            float(pairs.d_lb[k]),
            float(pairs.d_ub[k]),
            None if math.isnan(d) else d,
            float(pairs.alpha[k]),
        )
