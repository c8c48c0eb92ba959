"""A swarm that flies a plan's form steps before the vehicles do: law, safety filter and vehicles.

Each vehicle answers exactly as `plan.response` says, and each agent knows all states at once. So
wind, late states, slot exchange and errors of the response are left out: flown, a step takes about
as long (docs/pages/safety.md#the-envelope).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from swarm_ctl.core.kernel import align
from swarm_ctl.core.law.response_estimate import ResponseEstimate
from swarm_ctl.core.law.stop_point import Coast, pending
from swarm_ctl.core.model.arrays import MANY, Bools, Complex, Floats, complex_of_last
from swarm_ctl.core.model.plan import Compensation, Plan
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.safety.batch_safety_filter import (
    BatchHeard,
    BatchLinks,
    BatchPeers,
    BatchSafetyFilter,
)
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.own_laws import law_of


class Rehearsal:
    """One form step, tick by tick.

    Args:
        plan: what is flown.
        step: the form step.
        points: where the agents stand (n, 2) [units].
        links: N_i by agent id, in the order of `plan.agents`.
    """

    def __init__(
        self, plan: Plan, step: FormStep, points: Floats, links: Sequence[tuple[int, ...]]
    ) -> None:
        self._plan, self._tick_s, self._unit_m = plan, plan.tick_s, plan.unit_m
        ids = [agent.id for agent in plan.agents]
        count, model = len(ids), plan.response
        self.linked: Bools = np.array([[j in near for j in ids] for near in links])
        """j in N_i (n, n)."""
        self._slots = np.array(step.slots, dtype=np.float64)
        self._pairs = ~np.eye(count, dtype=bool)
        self._lower = np.triu(np.ones((count, count), dtype=bool), 1)
        self._law = law_of(plan.law)
        margins = Margins.of(plan.law, model, plan.limits.speed_mps, plan.unit_m)
        self._filter = BatchSafetyFilter(
            plan.safety,
            plan.law,
            margins.in_units(plan.unit_m),
            plan.tick_s,
            np.array(ids)[:, None],
        )
        slots = complex_of_last(self._slots)[:, None]
        self._links = BatchLinks(self.linked[..., None], slots, slots[None])
        # each vehicle: place and velocity (n, 1) [m, m/s], and the setpoints in its dead time
        self._place = complex_of_last(points)[:, None] * plan.unit_m
        self._velocity = np.zeros_like(self._place)
        self._setpoint = np.zeros_like(self._place)
        self._under_way = deque([self._velocity] * pending(model, plan.tick_s))
        self._coast = Coast(model, plan.tick_s, np.maximum)
        self._estimate = ResponseEstimate(model, plan.tick_s, self._velocity, MANY)

    @property
    def points(self) -> Floats:
        """Where the vehicles are (n, 2) [units]."""
        return _plane(self._place / self._unit_m)[..., 0].T

    def tick(self) -> None:
        """Decide and fly one tick; one agent alone is in its shape wherever it is."""
        if len(self._place) == 1:
            return
        found = self._estimate.stop_point(self._place, self._velocity)
        stop: Complex = np.asarray(found, dtype=np.complex128) / self._unit_m
        plain = self._plan.compensation is Compensation.NONE
        consensus, avoidance = self._terms(self.points if plain else _plane(stop)[..., 0].T)
        flown = self._filter.velocity(consensus, avoidance, self._peers(stop), self._links)
        self._setpoint = flown * self._unit_m
        self._estimate.sent(self._setpoint)
        self._under_way.append(self._setpoint)
        self._place, self._velocity = self._coast.tick(
            self._place, self._velocity, self._under_way.popleft()
        )

    def _terms(self, points: Floats) -> tuple[Complex, Complex]:
        """The law's consensus, with the mean-error feedback, and its avoidance (n, 1)
        [units/s]."""
        plan, slots, count = self._plan, self._slots, len(points)
        # every agent hears all points as they are: row i is what agent i sees
        others = np.broadcast_to(points, (count, count, 2))
        other_slots = np.broadcast_to(slots, (count, count, 2))
        found = self._law(
            *(points, slots, others, other_slots),
            *(self.linked, self._pairs, self._lower, plan.law),
        )
        consensus = complex_of_last(found.consensus) * plan.kappa
        if plan.safety.align:
            errors = complex_of_last(points - slots)
            consensus += align.RATE * (errors.mean() - errors)
        return consensus[:, None], complex_of_last(found.avoidance)[:, None] * plan.kappa

    def _peers(self, stop: Complex) -> BatchPeers:
        """What all agents know of each other now; `stop` (n, 1) [units]."""
        points, shape = _plane(stop), (1, *stop.shape)
        response_s = np.asarray(self._estimate.response_s)
        known = BatchHeard(
            (self._setpoint / self._unit_m)[None],
            np.zeros(shape),
            np.ones(shape, dtype=np.bool_),
            np.ones(shape, dtype=np.bool_),
            response_s[None],
        )
        doubt_s = np.asarray(self._estimate.doubt_s)
        return BatchPeers(points, points[:, None], known, doubt_s, response_s)


def _plane(vectors: Complex) -> Floats:
    return np.stack((vectors.real, vectors.imag))
