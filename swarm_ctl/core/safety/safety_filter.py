"""The constraints of `core/safety/constraints.py` for one agent: from a wish to the velocity that
is flown, tick by tick.

Metres; a horizontal vector is the complex number north + 1j * east.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarm_ctl.core.law.response_estimate import ResponseEstimate
from swarm_ctl.core.model.messages import SafetyReport
from swarm_ctl.core.model.plan import Plan, Point, Response
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.safety import constraints
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.deadlock import SWIRL_OFF, DeadlockRelease, swirled
from swarm_ctl.core.safety.velocity_qp import Plane, relaxed
from swarm_ctl.core.safety.wish import limited
from swarm_ctl.core.swarm.snapshot import Formation, FormationKey, OtherAircraft, PeerSnapshot


@row
class _KeepOuts:
    """The keep-out constraints of one tick."""

    planes: list[Plane]
    ids: list[int]
    """The aircraft that each plane keeps away from."""
    cap_mps: float
    """Speed allowed with these aircraft near."""
    stranger_near: bool
    """An aircraft that does not fly along is so close that the common velocity has to give way."""


class SafetyFilter:
    """Chooses the velocity that one agent flies, and counts what it changes.

    `vehicle` is how the own vehicle answers a setpoint, `estimate` what the flight says of that.
    """

    def __init__(
        self, plan: Plan, own_id: int, vehicle: Response, estimate: ResponseEstimate
    ) -> None:
        self._plan = plan
        self._own = own_id
        self.estimate = estimate
        self._margins = Margins.of(plan.law, vehicle, plan.limits.speed_mps, plan.unit_m)
        self._swirl_off_m = (plan.law.r_out + SWIRL_OFF) * plan.unit_m
        self.reach_m = max(self._margins.farthest, self._swirl_off_m)
        """An aircraft farther away constrains nothing."""
        # a link that was told up to `NEIGHBOUR_S` ago may be so much longer by now
        self._stretched_m = self._margins.guards_from - self._margins.speed * NEIGHBOUR_S
        self._looked: tuple[PeerSnapshot | None, list[OtherAircraft]] = (None, [])
        self.release = DeadlockRelease(own_id, plan.limits.speed_mps, plan.tick_s)
        self._links = _GuardedLinks()
        self._ticks = self._touched = self._yielded = 0
        self._from: set[int] = set()

    def report(self) -> SafetyReport:
        """What was changed so far, and because of which aircraft since the last report."""
        seen, self._from = tuple(sorted(self._from)), set()
        return SafetyReport(self._ticks, self._touched, self._yielded, self.release.fails, seen)

    def velocity(
        self,
        snapshot: PeerSnapshot,
        own: complex,
        consensus: complex,
        avoidance: complex,
        formation: Formation,
    ) -> complex:
        """What is flown for the law's two terms; `own` is the own stop point."""
        if not self._plan.safety.release:
            return self.filtered(snapshot, own, consensus + avoidance, formation)
        wish = consensus + self._swirled(snapshot, own, consensus, avoidance)
        wish = self.release.turn(wish, consensus)
        flown = self.filtered(snapshot, own, wish, formation)
        self.release.note(consensus, flown)
        return flown

    def _swirled(
        self, snapshot: PeerSnapshot, own: complex, consensus: complex, avoidance: complex
    ) -> complex:
        """The avoidance with its swirl (`core/safety/deadlock.py`); without it near an aircraft
        that is not heard, because that one does not turn."""
        if not avoidance or not consensus:
            return avoidance
        for other in self._near(snapshot, own):
            if not other.fresh and abs(own - other.stop_point) < self._swirl_off_m:
                return avoidance
        return complex(swirled(consensus, avoidance))

    def filtered(
        self, snapshot: PeerSnapshot, own: complex, wish: complex, formation: Formation
    ) -> complex:
        """The velocity nearest to the wish, within the speed limit, that keeps apart from all
        aircraft and, for the formation's links, together.

        Peers of the same formation move with it, so between those only the difference from its
        common velocity counts. `own` is the own stop point.
        """
        wish = limited(wish, self._margins.speed)
        if not self._plan.safety.filter:
            return wish
        self._ticks += 1
        margins, reach = self._margins, self._margins.reach
        near = [
            (other, own - other.stop_point)
            for other in self._near(snapshot, own)
            if constraints.constrains(other, abs(own - other.stop_point), margins, reach=reach)
        ]
        moving = formation.velocity
        keep_outs = self._keep_outs(near, formation.key, moving)
        if keep_outs.stranger_near:
            moving = 0j
            keep_outs = self._keep_outs(near, None, moving)
        soft = self._guards(snapshot, own, formation, moving)
        if not keep_outs.planes and not soft:
            return wish
        flown = self._nearest(wish - moving, keep_outs, soft, keep_outs.cap_mps) + moving
        return limited(flown, self._margins.speed) if moving else flown

    def _keep_outs(
        self, near: list[tuple[OtherAircraft, complex]], key: FormationKey | None, moving: complex
    ) -> _KeepOuts:
        """The keep-outs for velocities less the common one, `moving`."""
        margins, estimate = self._margins, self.estimate
        planes: list[Plane] = []
        cap_mps, stranger_near = margins.speed, False
        for other, apart in near:
            normal, bound, room = constraints.keep_out_plane(
                apart, self._own < other.id, other, margins
            )
            if moving and other.formation != key:
                bound -= (normal.conjugate() * moving).real
                stranger_near |= room < margins.zone
            unsure_s = constraints.unsure(estimate.doubt_s, estimate.response_s, other)
            cap_mps = min(cap_mps, constraints.cap(room, unsure_s, margins))
            planes.append((normal.real, normal.imag, bound))
        return _KeepOuts(planes, [other.id for other, _ in near], cap_mps, stranger_near)

    def _guards(
        self, snapshot: PeerSnapshot, own: complex, formation: Formation, moving: complex
    ) -> list[Plane]:
        """The constraints of the links that the shape keeps. Those to peers that fly another
        formation are left out; while the formation moves, those to all that do not fly along."""
        planes: list[Plane] = []
        if not self._plan.safety.guard:
            return planes
        guarded = self._links.guarded(
            self._own, formation, self._margins, self._plan.unit_m, self.release.releasing
        )
        if not guarded:
            return planes
        for other in snapshot.far(guarded, own, self._stretched_m):
            along = not moving or other.formation == formation.key
            along = along and not other.elsewhere(formation.key)
            if other.age_at_most_s > NEIGHBOUR_S or not along:
                continue
            apart = constraints.carried(own - other.stop_point, other)
            if constraints.kept(abs(apart), self._margins):
                along_mps = self._turning(formation, other.id)
                normal, bound = constraints.guard_plane(
                    apart, other.setpoint - moving - along_mps, self._margins
                )
                bound += (normal.conjugate() * along_mps).real
                if bound > -self._margins.speed:
                    planes.append((normal.real, normal.imag, bound))
        return planes

    def _turning(self, formation: Formation, other: int) -> complex:
        """How fast [m/s] the middle of the link to `other` moves as the shape turns and grows: both
        ends fly along with it, and only what they fly besides stretches the link. Without it, a
        stretched link lets neither end go on, and a shape creeps through its turn."""
        if not formation.spin:
            return 0j
        ends = complex(*formation.slots[self._own]) + complex(*formation.slots[other])
        return formation.spin * 0.5 * ends * self._plan.unit_m

    def _nearest(
        self, wish: complex, keep_outs: _KeepOuts, soft: list[Plane], cap: float
    ) -> complex:
        hard = keep_outs.planes
        (north, east), slack = relaxed((wish.real, wish.imag), hard, soft, cap)
        flown = complex(north, east)
        if abs(flown - wish) > constraints.UNTOUCHED:
            self._touched += 1
            self._yielded += slack > 0.0
            self._from.update(
                i
                for i, (n, e, b) in zip(keep_outs.ids, hard, strict=True)
                if n * wish.real + e * wish.imag < b
            )
        return flown

    def _near(self, snapshot: PeerSnapshot, own: complex) -> list[OtherAircraft]:
        """All aircraft that may constrain this tick; looked up once a snapshot."""
        if self._looked[0] is not snapshot:
            self._looked = (snapshot, snapshot.near(own, self.reach_m))
        return self._looked[1]


class _GuardedLinks:
    """The neighbours whose slots lie within r of the own one; worked out when slots or neighbours
    change."""

    def __init__(self) -> None:
        self._slots: Mapping[int, Point] = {}
        self._neighbours: frozenset[int] = frozenset()
        self._all: frozenset[int] = frozenset()
        self._loose: frozenset[int] = frozenset()
        """Of those, the links that the guard minds even while a dead-lock release is under way."""

    def guarded(
        self, own_id: int, formation: Formation, margins: Margins, unit_m: float, releasing: bool
    ) -> frozenset[int]:
        """The neighbours to stay together with."""
        slots, neighbours = formation.slots, formation.neighbours
        if slots is not self._slots or neighbours is not self._neighbours:
            self._slots, self._neighbours = slots, neighbours
            own, gaps = slots.get(own_id), {}
            if own is not None:
                gaps = {i: math.dist(own, slots[i]) * unit_m for i in neighbours if i in slots}
            self._all = frozenset(i for i, gap in gaps.items() if constraints.fits(gap, margins))
            self._loose = frozenset(i for i in self._all if not constraints.tight(gaps[i], margins))
        return self._loose if releasing else self._all
