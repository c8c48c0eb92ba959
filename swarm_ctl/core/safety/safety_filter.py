"""`core/safety/constraints.py` for one agent: from a wish to the velocity that is flown, tick by
tick.

Metres; a horizontal vector is the complex number north + 1j * east.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarm_ctl.core.model.messages import SafetyReport
from swarm_ctl.core.model.plan import Plan, Point, Response
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, PREDICT_S, SILENT_FLIES_S
from swarm_ctl.core.safety import constraints
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.deadlock import SWIRL_OFF, DeadlockRelease, swirled
from swarm_ctl.core.safety.velocity_qp import Plane, relaxed
from swarm_ctl.core.swarm.peers import NOTHING_COMMON, Common, Other, Peers

_UNTOUCHED_MPS = 1e-6


class SafetyFilter:
    """One agent's last word. Counts what it changes."""

    def __init__(self, plan: Plan, own_id: int, peers: Peers, vehicle: Response) -> None:
        self._plan = plan
        self._own = own_id
        self._peers = peers
        unit = plan.unit_m
        self._margins = Margins.of(plan.law, vehicle, plan.limits.speed_mps, unit)
        self._near_m = self._margins.keep_out + self._margins.reach
        farthest = self._near_m + 3.0 * self._margins.growth + self._margins.speed * SILENT_FLIES_S
        self._swirl_off_m = (plan.law.r_out + SWIRL_OFF) * unit
        self._reach_m = max(farthest, self._swirl_off_m)
        """Nobody farther away forbids anything."""
        # told up to a second ago: so much longer it may be by now
        self._stretched_m = (
            constraints.guards_from(self._margins) - self._margins.speed * NEIGHBOUR_S
        )
        self._looked: tuple[float, list[Other]] = (-math.inf, [])
        self.release = DeadlockRelease(own_id, plan.limits.speed_mps, plan.tick_s)
        self._slots: Mapping[int, Point] = {}
        self._chosen: frozenset[int] = frozenset()
        self._guarded: frozenset[int] = frozenset()
        self._slack: frozenset[int] = frozenset()
        """Of those, the links that are minded even while the release goes sideways."""
        self._ticks = self._touched = self._yielded = 0
        self._from: set[int] = set()

    def report(self) -> SafetyReport:
        """What was changed so far, and because of whom since the last report."""
        seen, self._from = tuple(sorted(self._from)), set()
        return SafetyReport(self._ticks, self._touched, self._yielded, self.release.fails, seen)

    def turned(self, own: complex, now: float, consensus: complex, avoidance: complex) -> complex:
        """The avoidance with its swirl (`core/safety/deadlock.py`)."""
        if not self._plan.safety.release or not avoidance or not consensus:
            return avoidance
        for other in self._near(now, own):
            if not other.heard and abs(own - other.stop_point) < self._swirl_off_m:
                return avoidance
        return complex(swirled(consensus, avoidance))

    def keep(
        self, now: float, own: complex, wish: complex, slots: Mapping[int, Point], common: Common
    ) -> complex:
        """The velocity nearest to the wish that keeps apart from everybody and, for the links of
        `slots`, together.

        Who flies the same formation moves with it, so between those only what differs from its
        velocity counts.
        """
        if not self._plan.safety.filter:
            return wish
        self._ticks += 1
        near = [
            (other, apart)
            for other in self._near(now, own)
            if self._reaches(other, abs(apart := own - other.stop_point))
        ]
        hard, room, stranger_near = self._keep_outs(near, common)
        moving = 0j if stranger_near else common.velocity_mps
        if moving != common.velocity_mps:
            hard, room, _ = self._keep_outs(near, NOTHING_COMMON)
        soft = self._guards(now, own, slots, common if moving else NOTHING_COMMON)
        if not hard and not soft:
            return wish
        cap = min(constraints.cap(room, self._margins), self._margins.speed)
        flown = (
            self._nearest(wish - moving, hard, soft, cap, [other.id for other, _ in near]) + moving
        )
        return constraints.limited(flown, self._plan.limits) if moving else flown

    def _keep_outs(
        self, near: list[tuple[Other, complex]], common: Common
    ) -> tuple[list[Plane], float, bool]:
        """The planes for velocities less the common one, the least room, and whether somebody who
        does not fly along is so close that the common velocity itself has to bow to him.
        """
        margins, moving = self._margins, common.velocity_mps
        planes: list[Plane] = []
        least_room, stranger_near = math.inf, False
        for other, apart in near:
            normal, bound, room = constraints.half_plane(
                _distinct(apart, self._own < other.id),
                other.commanded,
                other.age_s if other.heard else SILENT_FLIES_S,
                margins.out(other.age_s),
                0.5 if other.yields else 1.0,
                margins.speed,
            )
            if moving and other.flying != common.flying:
                bound -= (normal.conjugate() * moving).real
                stranger_near |= room < margins.zone
            least_room = min(least_room, room)
            planes.append((normal.real, normal.imag, bound))
        return planes, least_room, stranger_near

    def _guards(
        self, now: float, own: complex, slots: Mapping[int, Point], common: Common
    ) -> list[Plane]:
        """For the links that the shape keeps, but those to somebody who does not fly along."""
        planes: list[Plane] = []
        guarded = self._links(slots)
        if not guarded:
            return planes
        for other in self._peers.far(guarded, now, own, self._stretched_m):
            along = not common.velocity_mps or other.flying == common.flying
            if other.age_s > NEIGHBOUR_S or not along:
                continue
            apart = own - other.stop_point - other.commanded * min(other.age_s, PREDICT_S)
            if constraints.guarded(0.0, abs(apart), self._margins):
                normal, bound = constraints.guard_plane(
                    apart, other.commanded - common.velocity_mps, self._margins
                )
                if bound > -self._margins.speed:
                    planes.append((normal.real, normal.imag, bound))
        return planes

    def _nearest(
        self, wish: complex, hard: list[Plane], soft: list[Plane], cap: float, who: list[int]
    ) -> complex:
        (north, east), slack = relaxed((wish.real, wish.imag), hard, soft, cap)
        flown = complex(north, east)
        if abs(flown - wish) > _UNTOUCHED_MPS:
            self._touched += 1
            self._yielded += slack > 0.0
            self._from.update(
                i
                for i, (n, e, b) in zip(who, hard, strict=True)
                if n * wish.real + e * wish.imag < b
            )
        return flown

    def _near(self, now: float, own: complex) -> list[Other]:
        """Everybody who may forbid something; looked up once a tick."""
        if self._looked[0] != now:
            self._looked = (now, self._peers.near(now, own, self._reach_m))
        return self._looked[1]

    def _reaches(self, other: Other, distance: float) -> bool:
        """It may forbid something: with what it may have flown since, and all of the burden on
        us."""
        if other.heard and other.yields:
            return (
                distance
                < self._near_m
                + abs(other.commanded) * other.age_s
                + self._margins.growth * other.age_s
            )
        flown = abs(other.commanded) * max(other.age_s if other.heard else SILENT_FLIES_S, 0.0)
        return distance < self._near_m + flown + 3.0 * self._margins.growth

    def _links(self, slots: Mapping[int, Point]) -> frozenset[int]:
        """The neighbours whose slots lie within r of the own one; worked out when slots or
        neighbours change."""
        if not self._plan.safety.guard:
            return frozenset()
        chosen = self._peers.links
        if slots is not self._slots or chosen is not self._chosen:
            self._slots, self._chosen = slots, chosen
            own, unit = slots.get(self._own), self._plan.unit_m
            gaps = (
                {i: math.dist(own, slots[i]) * unit for i in chosen if i in slots}
                if own is not None
                else {}
            )
            self._guarded = frozenset(
                i for i, gap in gaps.items() if constraints.guarded(gap, 0.0, self._margins)
            )
            self._slack = frozenset(
                i for i in self._guarded if not constraints.tight(gaps[i], self._margins)
            )
        return self._slack if self.release.releasing else self._guarded


def _distinct(apart: complex, first: bool) -> complex:
    """Two on one spot part along north, the lower id northwards."""
    return apart if abs(apart) > 1e-9 else complex(1e-9 if first else -1e-9, 0.0)
