"""From what one agent knows of the other aircraft to what `core/kernel/decide.py` asks for, tick by
tick; and the account of it.

Metres; a horizontal vector is the complex number north + 1j * east.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from swarm_ctl.core.kernel import constraints
from swarm_ctl.core.kernel.constraints import Margins, Other, flies_with, keep_out, margins_of
from swarm_ctl.core.kernel.decide import (
    PAIRS,
    WALLS,
    Decision,
    Link,
    NearWall,
    Own,
    decided,
    freer_side,
)
from swarm_ctl.core.kernel.heights import (
    NO_SPAN,
    Span,
    apart_by_height,
    is_ahead,
    may_pass,
    needed_m,
    span,
)
from swarm_ctl.core.kernel.program import Row, violated
from swarm_ctl.core.kernel.walls import FENCE
from swarm_ctl.core.kernel.wish import NO_RELEASE, SWIRL_OFF, limited, noted, swirled, turned
from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.messages import SafetyReport
from swarm_ctl.core.model.plan import HEIGHT_DOUBT_M, Plan, Point, Response
from swarm_ctl.core.model.timeouts import FAR_LATE_S, NEIGHBOUR_S
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.surroundings import Surroundings
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.core.swarm.plausibility import HeightJumps
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot

_KEPT_S: Final = 2.0
"""Longer than a vehicle takes to brake and turn aside."""
_NOTHING: Final = -2


class SafetyFilter:
    """Chooses the velocity that one agent flies, and counts what it changes.

    `vehicle` is how the own vehicle answers a setpoint, `estimate` what the flight says of that.
    """

    def __init__(self, plan: Plan, own_id: int, vehicle: Response, estimate: OwnResponse) -> None:
        self._plan = plan
        self._own = own_id
        self.estimate = estimate
        self.margins = margins_of(plan.law, vehicle, plan.limits.speed_mps, plan.unit_m)
        self._vehicle = vehicle
        self._kept = _NOTHING, 0
        """The wall that forbids the wish, and for how many ticks."""
        self.set_zones(plan.zones)
        self.height_m = self.climbs_m = 0.0
        """Of the vehicle, above the origin, and how far it is to climb: zones end at heights."""
        self.lands = False
        """It is to go down through all heights below it."""
        self.layers = Layers(plan, own_id, self.margins)
        self.loose = False
        """The vehicle is on a way round a zone: its links may stretch."""
        self.wish = 0j
        """This tick's."""
        self.inside = ""
        """The zone that the vehicle is in, by fault or because it is a new one."""
        self.waits = False
        """A zone is over or under the vehicle where it is to climb or to sink: it leaves that place
        first."""
        self._swirl_off_m = (plan.law.r_out + SWIRL_OFF) * plan.unit_m
        self.reach_m = max(self.margins.farthest, self._swirl_off_m)
        """An aircraft farther away constrains nothing, unless it fell silent after a far word."""
        rare_m = 0.0 if hears_all(plan) else self.margins.speed * FAR_LATE_S
        self._looks_m = self.reach_m + rare_m
        # a link that was told up to `NEIGHBOUR_S` ago may be so much longer by now
        self._stretched_m = self.margins.guards_from - self.margins.speed * NEIGHBOUR_S
        self._looked: tuple[PeerSnapshot | None, list[OtherAircraft]] = (None, [])
        self.release = NO_RELEASE
        self._links = _GuardedLinks()
        self._rows: list[Row] = []
        self._ticks = self._touched = self._yielded = 0
        self._from: set[int] = set()

    def set_zones(self, zones: Sequence[Zone]) -> None:
        """The zones in force from now on."""
        speed_mps = self._plan.limits.speed_mps
        self._surroundings = Surroundings(zones, self._plan.fence, self._vehicle, speed_mps)
        if self._kept[0] != FENCE:  # another zone may have its number now, or none
            self._kept = _NOTHING, 0

    def in_layers(self, snapshot: PeerSnapshot, own: complex) -> PeerSnapshot:
        """The snapshot, with those marked that the vehicle is apart from by height; `own` is its
        stop point."""
        climbs_m = -math.inf if self.lands else self.climbs_m
        return self.layers.sorted(snapshot, own, self.height_m, climbs_m)

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
        speed, tick_s = self.margins.speed, self._plan.tick_s
        wish, self.release = turned(self.release, wish, consensus, self._own, speed, tick_s)
        flown = self.filtered(snapshot, own, wish, formation)
        self.release = noted(self.release, consensus, flown, speed, tick_s)
        return flown

    def _swirled(
        self, snapshot: PeerSnapshot, own: complex, consensus: complex, avoidance: complex
    ) -> complex:
        """The avoidance with its swirl (`core/kernel/wish.py`); without it near an aircraft
        that is not heard, because that one does not turn."""
        if not avoidance or not consensus:
            return avoidance
        for other in self.near(snapshot, own):
            if not other.fresh and abs(own - other.stop_point) < self._swirl_off_m:
                return avoidance
        return swirled(consensus, avoidance)

    def filtered(
        self, snapshot: PeerSnapshot, own: complex, wish: complex, formation: Formation
    ) -> complex:
        """The velocity nearest to the wish, within the speed limit, that keeps apart from all
        aircraft and, for the formation's links, together.

        Peers of the same formation move with it, so between those only the difference from its
        common velocity counts. `own` is the own stop point.
        """
        wish = limited(wish, self.margins.speed)
        if not self._plan.safety.filter:
            return wish
        self._ticks += 1
        near = self._others(snapshot, own, formation)
        links = self._guarded(snapshot, own, formation)
        estimate, rows = self.estimate, self._rows
        itself = Own(estimate.doubt_s, estimate.response_s, formation.velocity)
        walls = self._walls(own)
        near_by = (near, len(near), links, len(links), walls, len(walls))
        found = decided(wish, *near_by, itself, self.margins, rows)
        self.wish = wish
        if walls or self._kept[1]:
            self._note_walls(found)
        if found.touched:
            self._touched += 1
            self._yielded += found.yielded
            self._from.update(
                row.about
                for row in rows[: found.used]
                if row.source == PAIRS and violated(row, found.wish)
            )
        return found.velocity

    def passing_side(self, away: complex, own: complex) -> complex:
        """On which side an aircraft that stays is passed (`freer_side`)."""
        walls = self._walls(own)
        return freer_side(away, walls, len(walls))

    def over_zone(self, own: complex) -> str:
        """The zone that a vehicle at `own` would come down in, or beside nearer than it may: `zone
        oak`; '': none."""
        near = self._surroundings.near(own, -math.inf, self.height_m)
        return self._surroundings.nearest_zone(near)

    @property
    def kept_off(self) -> str:
        """The wall that has forbidden the wish for some seconds: `zone oak`, or ''."""
        about, ticks = self._kept
        return self._surroundings.name(about) if ticks * self._plan.tick_s >= _KEPT_S else ""

    def _note_walls(self, found: Decision) -> None:
        forbids = _NOTHING
        for row in self._rows[: found.used]:
            if row.source == WALLS and violated(row, found.wish):
                forbids = row.about
        about, ticks = self._kept
        self._kept = (forbids, ticks + 1 if forbids == about else 1)
        if forbids == _NOTHING:
            self._kept = _NOTHING, 0

    def _walls(self, own: complex) -> list[NearWall]:
        low_m, high_m = sorted((self.height_m, self.height_m + self.climbs_m))
        walls = self._surroundings.near(own, low_m, high_m)
        self.waits = bool(walls) and self._surroundings.blocked(walls, self.height_m)
        self.inside = self._surroundings.holds(walls) if walls and not self.waits else ""
        return walls

    def _others(self, snapshot: PeerSnapshot, own: complex, formation: Formation) -> list[Other]:
        """All aircraft that may constrain this tick."""
        near: list[Other] = []
        margins, key = self.margins, formation.key
        reach, own_id, constrains = margins.reach, self._own, constraints.constrains
        may_fly_s = constraints.flown_s
        for other in self.near(snapshot, own):
            apart, setpoint, age_s = own - other.stop_point, other.setpoint, other.age_at_most_s
            yields, flown_s = other.yields, may_fly_s(age_s, other.fresh, other.rare)
            if constrains(abs(apart), setpoint, age_s, flown_s, yields, reach, margins):
                about, responds_s = other.id, other.response_s
                along = other.formation == key and flies_with(setpoint, formation.velocity)
                lower = own_id < about
                near.append(
                    Other(about, lower, apart, setpoint, age_s, flown_s, yields, responds_s, along)
                )
        return near

    def _guarded(self, snapshot: PeerSnapshot, own: complex, formation: Formation) -> list[Link]:
        """The links that the shape keeps and that are long; those to peers that fly another
        formation are left out."""
        links: list[Link] = []
        if not self._plan.safety.guard or self.loose:
            return links
        guarded = self._links.guarded(
            self._own, formation, self.margins, self._plan.unit_m, self.release.left_s > 0.0
        )
        if not guarded:
            return links
        for other in snapshot.far(guarded, own, self._stretched_m):
            if other.age_at_most_s > NEIGHBOUR_S or other.elsewhere(formation.key):
                continue
            told = own - other.stop_point
            apart = constraints.carried(told, other.setpoint, other.age_at_most_s)
            if constraints.kept(abs(apart), self.margins):
                along, turning = (
                    other.formation == formation.key,
                    self._turning(formation, other.id),
                )
                links.append(Link(other.id, apart, other.setpoint, turning, along))
        return links

    def _turning(self, formation: Formation, other: int) -> complex:
        """How fast [m/s] the middle of the link to `other` moves as the shape turns and grows.
        Without it, a stretched link lets neither end go on, and a shape creeps through its turn."""
        if not formation.spin:
            return 0j
        ends = complex(*formation.slots[self._own]) + complex(*formation.slots[other])
        return formation.spin * 0.5 * ends * self._plan.unit_m

    def near(self, snapshot: PeerSnapshot, own: complex) -> list[OtherAircraft]:
        """All aircraft that may constrain this tick; looked up once a snapshot."""
        if self._looked[0] is not snapshot:
            self._looked = (snapshot, snapshot.near(own, self._looks_m))
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


class Layers:
    """Which aircraft one agent is apart from by height, tick by tick, and whether it may fly on
    through the heights of others.

    In a mission whose slots have heights (`Plan.wake`) each agent tells the height that it flies
    to. A pair whose spans (`core/kernel/heights.py`) lie far enough from each other has no plane
    between them; each other pair counts as in one plane, as in any mission. So a pair of which one
    is to pass the other's height keeps apart in the plane before it does, while it does, and until
    it has. Horizontal vectors are north + 1j * east [m]; heights are m above the common frame's
    origin.
    """

    def __init__(self, plan: Plan, own_id: int, margins: Margins) -> None:
        limits = plan.limits
        self._flown = plan.wake is not None
        self._layer_m = plan.layer_m
        self._closing_mps = limits.climb_mps + limits.descent_mps
        self._r_in_m = plan.law.r_in * plan.unit_m
        self._own, self._margins = own_id, margins
        self._jumps = HeightJumps()
        self._last: tuple[float, float, float] | None = None
        self.waits_for: int | None = None
        """The aircraft whose height is to be passed, and which is too near for that; `TRAFFIC`: one
        that no peer explains. None: nothing is."""

    def locate(self, now: float, height_m: float, climb_mps: float) -> None:
        """The own height, and how fast it rises, by the own estimate at `now`; call it every
        tick."""
        if self._flown and self._last is not None:
            then, last_m, last_mps = self._last
            self._jumps.look(now - then, height_m - last_m, 0.5 * (last_mps + climb_mps))
        self._last = now, height_m, climb_mps

    def sorted(
        self, snapshot: PeerSnapshot, own: complex, height_m: float, climbs_m: float
    ) -> PeerSnapshot:
        """The snapshot, with those marked that the agent is apart from by height.

        `own` is the own stop point; the vehicle is at `height_m`, and is to climb by `climbs_m`
        (-inf: to the ground, wherever that is).
        """
        self.waits_for = None
        if not self._flown:
            return snapshot
        one = span(height_m, height_m + climbs_m, HEIGHT_DOUBT_M + abs(self._jumps.off_m))
        over = set[int]()
        for other in snapshot.peers:
            if other.state is None:
                continue
            told = self._span(other)
            age_s = other.age_at_most_s
            if apart_by_height(one, told, self._layer_m, self._closing_mps, age_s):
                over.add(other.id)
            elif self._is_blocked(other, one, told, own, height_m, climbs_m):
                self.waits_for = other.id
        for other in snapshot.traffic:
            if climbs_m and not self._has_room(other, own):
                self.waits_for = other.id
        return replace(snapshot, over=frozenset(over)) if over else snapshot

    def _span(self, other: OtherAircraft) -> Span:
        """Nothing is known of a peer whose word is late or doubted, or that does not fly by
        setpoints of its agent."""
        state = other.state
        if state is None or state.goal_height_m is None or not other.yields:
            return NO_SPAN
        doubt_m = HEIGHT_DOUBT_M + other.height_off_m
        return span(-state.position_ned_m[2], state.goal_height_m, doubt_m)

    def _is_blocked(
        self,
        other: OtherAircraft,
        one: Span,
        told: Span,
        own: complex,
        height_m: float,
        climbs_m: float,
    ) -> bool:
        """It is ahead in height, within reach of the way, and too near for passing it."""
        if other.state is None or other.down:
            return False
        age_s = other.age_at_most_s if other.yields else 0.0
        near_m = needed_m(one, told, self._layer_m, self._closing_mps, age_s)
        other_m = -other.state.position_ned_m[2]
        ahead = is_ahead(height_m, climbs_m, other_m, near_m)
        return ahead and not self._has_room(other, own)

    def _has_room(self, other: OtherAircraft, own: complex) -> bool:
        seen = Other(
            about=other.id,
            lower=self._own < other.id,
            apart=own - other.stop_point,
            setpoint=other.setpoint,
            age_s=other.age_at_most_s,
            flown_s=constraints.flown_s(other.age_at_most_s, other.fresh, other.rare),
            yields=other.yields,
            response_s=other.response_s,
            along=False,
        )
        _, _, room = keep_out(seen, self._margins)
        return may_pass(room, self._margins.keep_out, self._r_in_m)
