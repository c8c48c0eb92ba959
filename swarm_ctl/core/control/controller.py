"""From where the other aircraft are to the velocity to fly: the law on the chosen points, then the
safety filter.

Horizontal vectors inside are complex numbers north + 1j * east [m, m/s].
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from swarm_ctl.core.control.headwind import Headwind
from swarm_ctl.core.control.law_input import LawInput, LawInputBuilder, flies_along
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.law import formation_law, mean_error_feedback
from swarm_ctl.core.law.laws import law_of
from swarm_ctl.core.law.response_estimate import ResponseEstimate
from swarm_ctl.core.model.messages import Gains, PairReport, SigmaReport
from swarm_ctl.core.model.plan import Compensation, Plan, Point, Response
from swarm_ctl.core.model.timeouts import lead_s
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.safety.wish import bent, shortened
from swarm_ctl.core.swarm.snapshot import NO_FORMATION, Formation, PeerSnapshot

_APPROACH_RATE = 1.0
"""[1/s] of the room that is left: how fast a wish may approach an aircraft that does not fly along.
Stop points need no more."""
_ROOM_M = 0.5
"""Beyond the room that is to be made, at 1 m/s a metre: else the last of it takes for ever."""
_SKIPPED = 10
"""Ticks: after more of them the vehicle itself has stopped (`SETPOINT_TIMEOUT_S`)."""


class Controller:
    """One agent's horizontal control.

    Remembers how the vehicle follows, for its stop point, and the law's last result, for the
    report.
    `vehicle` is how the own vehicle answers a setpoint.
    """

    def __init__(self, plan: Plan, own_id: int, vehicle: Response) -> None:
        self._plan = plan
        self._own = own_id
        self._law_input = LawInputBuilder(plan, own_id)
        self._formation_law = law_of(plan.law)
        self.estimate = ResponseEstimate(vehicle, plan.tick_s)
        self.headwind = Headwind(vehicle, plan.tick_s)
        self._located_s, self._down_m = math.inf, 0.0
        self.safety_filter = SafetyFilter(plan, own_id, vehicle, self.estimate)
        self._most_rate = vehicle.most_rate
        self.set_gains(Gains(plan.law.delta_a, plan.law.delta_l, plan.law.h, plan.kappa))
        self._result: formation_law.LawResult | None = None
        self._others: LawInput | None = None
        self._tally = np.zeros(len(formation_law.STATUSES), dtype=np.int64)
        self.overspeed_ticks = 0
        self.setpoint_mps: Point = (0.0, 0.0)
        """This tick's."""
        self.stop_point_m: Point = (0.0, 0.0)
        """Where the vehicle would come to rest."""
        self.point_m: Point = (0.0, 0.0)
        """Where the law takes the vehicle to be: the stop point, or with `compensation: none` the
        position."""

    def set_gains(self, gains: Gains) -> None:
        """The gains in force from now on; `core/swarm/gain_update.py` says when they may change.
        `h` is less where the vehicle is too slow for it."""
        h = min(gains.h, self._most_rate / gains.kappa)
        self.gains = gains
        self._law = replace(self._plan.law, h=h, delta_l=gains.delta_l, delta_a=gains.delta_a)
        self._iteration_mps = self._plan.unit_m * gains.kappa
        self.gain = gains.kappa * h
        """The law's own rate [1/s]."""
        self._lead_s: float = lead_s(self.gain)

    @property
    def tally(self) -> dict[str, int]:
        """Pair-ticks by sigma status since the start."""
        return dict(zip(formation_law.STATUSES, self._tally.tolist(), strict=True))

    def locate(self, fix: OwnFix, now: float) -> None:
        """Work out the own stop point for the tick at `now` [s]."""
        # in ticks that were skipped, the vehicle has flown on with the last setpoint
        skipped = round(max(0.0, now - self._located_s) / self._plan.tick_s) - 1
        if skipped > _SKIPPED:
            self.estimate.restart()
        else:
            for _ in range(skipped):
                self.estimate.sent(complex(*self.setpoint_mps))
        self._located_s = now
        (north, east, self._down_m), (v_north, v_east, _) = (
            fix.position_ned_m,
            fix.velocity_ned_mps,
        )
        point = self.estimate.stop_point(complex(north, east), complex(v_north, v_east))
        self.stop_point_m = (point.real, point.imag)
        plain = self._plan.compensation is Compensation.NONE
        self.point_m = (north, east) if plain else self.stop_point_m

    # --- what can be flown: each gives the velocity (north, east) [m/s] that was chosen ---

    def form(
        self,
        snapshot: PeerSnapshot,
        formation: Formation,
        extra_mps: Point = (0.0, 0.0),
        off_m: Point | None = None,
    ) -> Point:
        """The law (26) towards the formation's slots, keeping apart from what is aloft.

        `extra_mps` moves the formation as a whole; it is flown on top of the law. `off_m` is from
        the own stop point to the own place, for the agent that is pinned to it: the place weighs as
        much as all neighbours.
        """
        snapshot = snapshot.aloft(self._down_m)
        consensus, avoidance = self._terms(snapshot, formation)
        if off_m is not None:
            # A mean, no sum: at twice the law's rate its stop point swings.
            consensus = 0.5 * (consensus + self.gain * complex(*off_m))
        if extra_mps != (0.0, 0.0) or off_m is not None:
            wish = self._around(consensus + complex(*extra_mps))
            return self._filtered(snapshot, wish + avoidance, formation)
        own = complex(*self.stop_point_m)
        flown = self.safety_filter.velocity(snapshot, own, consensus, avoidance, formation)
        self.send(flown)
        return self.setpoint_mps

    def go_to(self, snapshot: PeerSnapshot, to_m: Point, speed_mps: float) -> Point:
        """Straight to a point, keeping apart from what is aloft; around an aircraft that stands in
        the way, and out of a dead-lock as in a formation."""
        snapshot = snapshot.aloft(self._down_m)
        _, avoidance = self._terms(snapshot, NO_FORMATION)
        pull = self.gain * (complex(*to_m) - complex(*self.point_m))
        wish, own = self._around(shortened(pull, speed_mps)), complex(*self.stop_point_m)
        self.send(self.safety_filter.velocity(snapshot, own, wish, avoidance, NO_FORMATION))
        return self.setpoint_mps

    def keep_clear(
        self, snapshot: PeerSnapshot, *, ground: bool = False, room_m: float = 0.0
    ) -> Point:
        """Stay, but make room for an aircraft that comes close: the law's avoidance term, and away
        from each that is nearer than `room_m`.

        `ground`: keep clear of vehicles that stand on the ground, too, as before a landing.
        """
        snapshot = snapshot if ground else snapshot.aloft(self._down_m)
        _, wish = self._terms(snapshot, NO_FORMATION)
        own = complex(*self.stop_point_m)
        for other in snapshot.near(own, room_m):
            apart = own - other.stop_point
            wish += apart / max(abs(apart), 1e-9) * (room_m + _ROOM_M - abs(apart))
        return self._filtered(snapshot, wish, NO_FORMATION)

    def stand_at(self, snapshot: PeerSnapshot, place_m: Point) -> Point:
        """Stay over a place, out of the way of what comes closer than the filter allows."""
        own = complex(*self.stop_point_m)
        wish = self.gain * (complex(*place_m) - own)
        return self._filtered(snapshot.aloft(self._down_m), wish, NO_FORMATION)

    def rest(self) -> None:
        """No setpoint of ours moves the vehicle in this tick."""
        self._result = None
        self.setpoint_mps = (0.0, 0.0)
        self.estimate.rest()
        self.headwind.rest()

    def send(self, setpoint: complex) -> None:
        """Remember this tick's setpoint: it acts after the dead time."""
        self.setpoint_mps = (setpoint.real, setpoint.imag)
        self.estimate.sent(setpoint)

    # --- parts ---

    def _terms(self, snapshot: PeerSnapshot, formation: Formation) -> tuple[complex, complex]:
        """The law's consensus, with the mean-error feedback, and its avoidance [m/s]."""
        others = self._law_input.build(snapshot, formation, self._lead_s)
        unit, rate = self._plan.unit_m, self._iteration_mps
        own = complex(*self.point_m) / unit
        slot = complex(*formation.slots.get(self._own, (0.0, 0.0)))
        consensus, avoidance = self._evaluate(others, own, slot)
        consensus *= rate
        if self._plan.safety.align and formation.key is not None:
            errors, count = others.errors_along(), sum(others.along)
            consensus += mean_error_feedback.pull(own - slot, errors, count) * unit
        return consensus, avoidance * rate

    def _evaluate(self, others: LawInput, own: complex, slot: complex) -> tuple[complex, complex]:
        """The law's two terms [units]."""
        self._result, self._others = None, others
        plain = self._formation_law is formation_law.evaluate
        if plain and not others.near(own, self._law.r_out):
            return formation_law.consensus(own - slot, others.errors_linked(), self._law), 0j
        result = self._formation_law(
            np.array([[own.real, own.imag]]),
            np.array([[slot.real, slot.imag]]),
            *others.arrays(),
            self._law,
        )
        if result.pairs is not None:
            counts = np.bincount(result.pairs.status, minlength=len(formation_law.STATUSES))
            self._tally += counts
            self.overspeed_ticks += bool(counts[formation_law.OVERSPEED])
        self._result = result
        (north, east), (away_north, away_east) = (
            result.consensus[0].tolist(),
            result.avoidance[0].tolist(),
        )
        return complex(north, east), complex(away_north, away_east)

    def _around(self, wish: complex) -> complex:
        """The wish, bent around each aircraft within `r_out` that does not fly along: lost peers,
        landing ones, strangers. Reads this tick's result of the law."""
        if self._result is None or self._result.pairs is None or not wish or self._others is None:
            return wish
        pairs, unit, law = self._result.pairs, self._plan.unit_m, self._plan.law
        for k, column in enumerate(pairs.index[-1].tolist()):
            if flies_along(self._others.aircraft[column]):
                continue
            room_m = (float(pairs.distance[k]) - 0.5 * (law.r_in + law.r_out)) * unit
            away = complex(*self.point_m) / unit - self._others.points[column]
            wish = bent(wish, away, max(0.0, _APPROACH_RATE * room_m))
        return wish

    def _filtered(self, snapshot: PeerSnapshot, wish: complex, formation: Formation) -> Point:
        own = complex(*self.stop_point_m)
        self.send(self.safety_filter.filtered(snapshot, own, wish, formation))
        return self.setpoint_mps

    # --- what is told of it ---

    def sigma_report(self, now: float) -> SigmaReport | None:
        """All pairs of the last evaluation; None where no aircraft was within `r_out`."""
        result, others = self._result, self._others
        if result is None or result.pairs is None or others is None:
            return None
        pairs = result.pairs
        return SigmaReport(
            self._own,
            now,
            (float(result.consensus[0, 0]), float(result.consensus[0, 1])),
            (float(result.avoidance[0, 0]), float(result.avoidance[0, 1])),
            tuple(_pair(pairs, k, others) for k in range(len(pairs.distance))),
        )


def _pair(pairs: formation_law.Pairs, k: int, others: LawInput) -> PairReport:
    d = float(pairs.d[k])
    return PairReport(
        others.aircraft[int(pairs.index[-1][k])].id,
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
