"""From where the other aircraft are to the velocity to fly: the law on the chosen points, then the
safety filter.

Horizontal vectors inside are complex numbers north + 1j * east [m, m/s].
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.kernel import law, wish
from swarm_ctl.core.kernel.constraints import flown_s, nearest, passed_at
from swarm_ctl.core.kernel.receiver import Known, Me, out_of_reach
from swarm_ctl.core.kernel.wish import bent, shortened
from swarm_ctl.core.law.formation_law import PAPER, FormationLaw
from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.messages import Gains, PairReport, Phase, SigmaReport
from swarm_ctl.core.model.plan import Compensation, Plan, Point, Response
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.timeouts import lead_s
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.own_way import OwnWay, WayLeg, wish_on
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.safety.surroundings import FENCE_NAME
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.core.swarm.snapshot import (
    NO_FORMATION,
    TRAFFIC,
    Formation,
    OtherAircraft,
    PeerSnapshot,
    predicted_s,
)

_APPROACH_RATE = 1.0
"""[1/s] of the room that is left: how fast a wish may approach an aircraft that does not fly along.
Stop points need no more."""
_ROOM_M = 0.5
"""Beyond the room that is to be made, at 1 m/s a metre: else the last of it takes for ever."""
_SKIPPED = 10
"""Ticks: after more of them the vehicle itself has stopped (`setpoint_timeout_s`)."""

NO_WAY: Final = "has no way past"


class Controller:
    """One agent's horizontal control.

    Remembers how the vehicle follows, for its stop point, and the law's last result, for the
    report.
    `vehicle` is how the own vehicle answers a setpoint, `own_law` the law that the plan pins in
    place of the paper's. ValueError where that one is not given.
    """

    def __init__(
        self, plan: Plan, own_id: int, vehicle: Response, own_law: FormationLaw | None = None
    ) -> None:
        if bool(plan.law.own) is not (own_law is not None):
            raise ValueError(f"the plan's law is {plan.law.own or 'the paper'}: not what is given")
        self._plan = plan
        self._own = own_id
        self._law_input = LawInputBuilder(plan, own_id)
        self._law = own_law or PAPER
        self._memory = [0.0] * self._law.memory
        self.estimate = OwnResponse(vehicle, plan.tick_s)
        self.headwind = Headwind(vehicle, plan.tick_s)
        self._located_s = math.inf
        self.down_m = 0.0
        """The own depth in the common frame."""
        self.safety_filter = SafetyFilter(plan, own_id, vehicle, self.estimate)
        self._vehicle = vehicle
        self.zones = plan.zones
        """In force; `set_zones` changes them."""
        self._way = self._way_among(plan.zones)
        self._round = ""
        """The zone that the vehicle goes round, or has no way past: in words."""
        self._most_rate = vehicle.most_rate
        self.set_gains(planned(plan))
        self._others: LawInput | None = None
        """Of the last evaluation, as the next three."""
        self._result = (0j, 0j)
        """Consensus and avoidance, as the law gives them."""
        self._pairs: list[law.Pair] = []
        self._seen = 0
        """So many of the pairs are of it: those inside r_out."""
        self._tally = [0] * len(law.STATUSES)
        self._sides = dict[int, tuple[complex, int]]()
        """By lost peer: on which side it is passed, and after how many dead-locks."""
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
        of = self._plan.law
        if of.own:
            self._numbers = self._law.numbers(*(value for _, value in gains.own))
        else:
            self._numbers = law.Law(of.r, of.r_out, of.r_in, h, gains.delta_l, gains.delta_a)
        self._reach = self._law.reach(self._numbers)
        self._term_mps = self._plan.unit_m * self._law.rate(gains.kappa)
        self.gain = gains.kappa * h
        """The law's own rate [1/s]."""
        self._lead_s: float = lead_s(self.gain)

    def set_zones(self, zones: tuple[Zone, ...]) -> None:
        """The zones in force from now on."""
        self.zones, self._way = zones, self._way_among(zones)
        self.safety_filter.set_zones(zones)

    @property
    def other_zones(self) -> tuple[Zone, ...] | None:
        """The zones in force; None: the plan's."""
        return None if self.zones is self._plan.zones else self.zones

    @property
    def tally(self) -> dict[str, int]:
        """Pair-ticks by sigma status since the start."""
        return dict(zip(law.STATUSES, self._tally, strict=True))

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
        (north, east, self.down_m), (v_north, v_east, _) = (
            fix.position_ned_m,
            fix.velocity_ned_mps,
        )
        self.safety_filter.height_m = -self.down_m
        self.safety_filter.layers.locate(now, -self.down_m, -fix.velocity_ned_mps[2])
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
        snapshot = self._in_layers(snapshot.aloft(self.down_m))
        if self.safety_filter.layers.waits_for is not None:
            # the shape would draw it under or over the very aircraft that it is to pass
            return self.keep_clear(snapshot, room_m=self.safety_filter.margins.keep_out)
        consensus, avoidance = self._terms(snapshot, formation)
        round_zones = self._round_zones(formation, off_m)
        if round_zones is not None:
            own = complex(*self.stop_point_m)
            flown = self.safety_filter.velocity(snapshot, own, round_zones, avoidance, formation)
            self.send(flown)
            return self.setpoint_mps
        if off_m is not None:
            # A mean, no sum: at twice the law's rate its stop point swings.
            consensus = 0.5 * (consensus + self.gain * complex(*off_m))
        if extra_mps != (0.0, 0.0) or off_m is not None:
            wish = self._around(snapshot, consensus + complex(*extra_mps))
            return self._filtered(snapshot, wish + avoidance, formation)
        own = complex(*self.stop_point_m)
        flown = self.safety_filter.velocity(snapshot, own, consensus, avoidance, formation)
        self.send(flown)
        return self.setpoint_mps

    def go_to(self, snapshot: PeerSnapshot, to_m: Point, speed_mps: float) -> Point:
        """Straight to a point, keeping apart from what is aloft; around an aircraft that stands in
        the way, and out of a dead-lock as in a formation."""
        snapshot = self._in_layers(snapshot.aloft(self.down_m))
        _, avoidance = self._terms(snapshot, NO_FORMATION)
        leg = self._leg(complex(*to_m))
        if leg.round:
            pull = wish_on(leg, complex(*self.point_m), self.gain, speed_mps)
        else:
            pull = self.gain * (complex(*to_m) - complex(*self.point_m))
        wish, own = self._around(snapshot, shortened(pull, speed_mps)), complex(*self.stop_point_m)
        self.send(self.safety_filter.velocity(snapshot, own, wish, avoidance, NO_FORMATION))
        return self.setpoint_mps

    def keep_clear(
        self, snapshot: PeerSnapshot, *, ground: bool = False, room_m: float = 0.0
    ) -> Point:
        """Stay, but make room for an aircraft that comes close: the law's avoidance term, and away
        from each that is nearer than `room_m`.

        `ground`: keep clear of vehicles that stand on the ground, too, as before a landing.
        """
        self._round, self.safety_filter.loose = "", False
        snapshot = self._in_layers(snapshot if ground else snapshot.aloft(self.down_m))
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
        snapshot = self._in_layers(snapshot.aloft(self.down_m))
        return self._filtered(snapshot, wish, NO_FORMATION)

    def rest(self) -> None:
        """No setpoint of ours moves the vehicle in this tick."""
        self._seen, self._round = 0, ""
        self.setpoint_mps = (0.0, 0.0)
        self.safety_filter.layers.waits_for = None
        self.estimate.rest()
        self.headwind.rest()

    def send(self, setpoint: complex) -> None:
        """Remember this tick's setpoint: it acts after the dead time."""
        self.setpoint_mps = (setpoint.real, setpoint.imag)
        self.estimate.sent(setpoint)

    @property
    def hindered(self) -> str:
        """What keeps the vehicle from its place: `goes round zone oak`; '': nothing."""
        if self._round:
            return self._round
        waits_for = self.safety_filter.layers.waits_for
        if waits_for is not None:
            whom = f"agent {waits_for}" if waits_for != TRAFFIC else "an aircraft"
            return f"waits at its height for {whom}, which is in the way"
        wall = self.safety_filter.kept_off
        return f"kept {'inside' if wall == FENCE_NAME else 'off'} {wall}" if wall else ""

    # --- parts ---

    def _in_layers(self, snapshot: PeerSnapshot) -> PeerSnapshot:
        return self.safety_filter.in_layers(snapshot, complex(*self.stop_point_m))

    def _way_among(self, zones: tuple[Zone, ...]) -> OwnWay:
        plan = self._plan
        return OwnWay(zones, plan.fence, plan.tick_s)

    def _leg(self, to: complex) -> WayLeg:
        """To a place of its own, round zones."""
        heights = sorted((-self.down_m, self.safety_filter.climbs_m - self.down_m))
        leg = self._way.leg(complex(*self.point_m), to, *heights)
        self.safety_filter.loose = bool(leg.round)
        verb = "goes round" if leg.exists else NO_WAY
        self._round = f"{verb} {leg.round}" if leg.round else ""
        return leg

    def _round_zones(self, formation: Formation, off_m: Point | None) -> complex | None:
        """The wish of a way round zones to the own place, where one cuts the straight line; None:
        none does. The place is the frame's on the agent that is pinned to it; on others it is where
        the slot lies by the mean of all that fly along."""
        if self._way.free or self._others is None:
            return None
        own, unit = complex(*self.point_m), self._plan.unit_m
        if off_m is not None:
            place = own + complex(*off_m)
        else:
            slot = complex(*formation.slots.get(self._own, (0.0, 0.0)))
            error, count = own / unit - slot, self._others.along
            mean = (sum(self._others.errors) + error) / (count + 1)
            place = (slot + mean) * unit
        leg = self._leg(place)
        speed_mps = self._plan.limits.speed_mps
        return wish_on(leg, own, self.gain, speed_mps) if leg.round else None

    def _terms(self, snapshot: PeerSnapshot, formation: Formation) -> tuple[complex, complex]:
        """The law's consensus, with the mean-error feedback, and its avoidance [m/s]."""
        unit, rate = self._plan.unit_m, self._term_mps
        own = complex(*self.point_m) / unit
        others = self._law_input.build(snapshot, formation, self._lead_s, own, self._reach)
        slot = complex(*formation.slots.get(self._own, (0.0, 0.0)))
        consensus, avoidance = self._evaluate(others, own, slot)
        consensus *= rate
        if self._plan.safety.align and formation.key is not None:
            errors = np.array(others.errors, dtype=np.complex128)
            total = complex(np.add.reduce(errors))
            consensus += wish.pull(own - slot, total, others.along) * unit
        return consensus, avoidance * rate

    def _evaluate(self, others: LawInput, own: complex, slot: complex) -> tuple[complex, complex]:
        """The law's two terms, as it gives them."""
        self._others, plan, of = others, self._plan, self._plan.law
        me = Me(
            self._own,
            own,
            slot,
            complex(*self.setpoint_mps) / plan.unit_m,
            plan.limits.speed_mps / plan.unit_m,
            plan.tick_s,
            self.gain,
            of.r,
            of.r_out,
            of.r_in,
        )
        consensus, avoidance, self._seen = self._law.form(
            me, others.rows, self._numbers, self._memory, self._pairs
        )
        statuses = [pair.status for pair in self._pairs[: self._seen]]
        for status in statuses:
            self._tally[status] += 1
        self.overspeed_ticks += law.OVERSPEED in statuses
        self._result = consensus, avoidance
        return consensus, avoidance

    def _around(self, snapshot: PeerSnapshot, wish: complex) -> complex:
        """The wish, bent around each aircraft that is near and does not fly along: lost peers, from
        where they may have flown to, and those within `r_out` that land, or are strangers. Reads
        this tick's rows."""
        if not wish or self._others is None:
            return wish
        wish = self._past_silent(snapshot, wish)
        unit, of = self._plan.unit_m, self._plan.law
        own = complex(*self.point_m) / unit
        for other, known in zip(self._others.aircraft, self._others.rows, strict=True):
            away = own - known.at
            squared = away.real * away.real + away.imag * away.imag
            silent = other.state is not None and not other.followed
            if squared >= of.r_out * of.r_out or silent or flies_along(other):
                continue
            room_m = (math.sqrt(squared) - 0.5 * (of.r_in + of.r_out)) * unit
            wish = bent(wish, away, max(0.0, _APPROACH_RATE * room_m))
        return wish

    def _past_silent(self, snapshot: PeerSnapshot, wish: complex) -> complex:
        """The wish, bent around lost peers, each on one side: the one that walls leave, and the
        other one after a dead-lock."""
        own, safety = complex(*self.point_m), self.safety_filter
        for other in safety.near(snapshot, own):
            if other.state is None or other.followed:
                continue
            apart, age_s = own - other.stop_point, other.age_at_most_s
            away = nearest(apart, other.setpoint, flown_s(age_s, fresh=False, rare=other.rare))
            room_m = abs(away) - passed_at(age_s, safety.margins)
            if room_m < safety.margins.zone:
                side, fails = self._sides.get(other.id, (0j, 0))
                if not side:
                    side = safety.passing_side(away, own)
                elif fails != safety.release.fails:
                    side = -side
                self._sides[other.id] = side, safety.release.fails
                wish = bent(wish, away, max(0.0, _APPROACH_RATE * room_m), side)
        return wish

    def _filtered(self, snapshot: PeerSnapshot, wish: complex, formation: Formation) -> Point:
        own = complex(*self.stop_point_m)
        self.send(self.safety_filter.filtered(snapshot, own, wish, formation))
        return self.setpoint_mps

    # --- what is told of it ---

    def sigma_report(self, now: float) -> SigmaReport | None:
        """All pairs of the last evaluation; None where no aircraft was within `r_out`."""
        others, (consensus, avoidance) = self._others, self._result
        if not self._seen or others is None:
            return None
        return SigmaReport(
            self._own,
            now,
            (consensus.real, consensus.imag),
            (avoidance.real, avoidance.imag),
            tuple(_report_of(pair, others) for pair in self._pairs[: self._seen]),
        )


def _report_of(pair: law.Pair, others: LawInput) -> PairReport:
    return PairReport(
        peer=others.aircraft[pair.place].id,
        neighbour=pair.neighbour,
        status=law.STATUSES[pair.status],
        distance=pair.distance,
        sigma=pair.sigma,
        sigma_lb=pair.sigma_lb,
        d_lb=pair.d_lb,
        d_ub=pair.d_ub,
        d=None if math.isnan(pair.d) else pair.d,
        alpha=pair.alpha,
    )


_MET_PER_S: Final = 2.0
"""How fast what is missing is added in a climb [1/s]."""
_STEADY_S: Final = 0.5
"""In flight that takes as long as the vehicle takes to answer, and no less than this: one that
answers later would swing."""
_OVERTAKES: Final = 1.2
"""Of the speed limit: the most that a vehicle is told to fly that gathers speed late; an autopilot
overshoots by as much. Without a bound one flew at 3.2 m/s where 2.1 are allowed."""
_TAKES_OVER_S: Final = 4.5
"""The vehicle's integrator fills in this time by what is added: P over I of a PX4 as delivered."""
_HEADWIND_MPS: Final = 3.0
"""More than this is no wind in which a swarm takes off."""


class Headwind:
    """What is added to the setpoints of a vehicle against the wind. Complex numbers north + 1j *
    east [m/s].

    A PX4 that is flown by velocities meets the wind with an integrator that is still empty (and has
    to be, on the ground). It fills slowly, `MPC_XY_VEL_I_ACC / MPC_XY_VEL_P_ACC` = 0.22 1/s as
    delivered. Until then the wind takes the vehicle with it, by metres; and one that brakes flies
    on for seconds by what its integrator held against the air. So setpoints to it are more by what
    it lacks, and less of that as its own integrator takes over.
    """

    def __init__(self, vehicle: Response, tick_s: float) -> None:
        self._tick_s = tick_s
        self._share = tick_s / (vehicle.dead_time_s + vehicle.lag_s + tick_s)
        self._expected = 0j
        self.added = 0j

    def rest(self) -> None:
        """The vehicle stands on the ground, or flies by itself."""
        self._expected = self.added = 0j

    def meet(self, setpoint: complex, flown: complex) -> complex:
        """What is added in this tick of a climb: the vehicle was told to fly `setpoint`, and is
        `flown`."""
        self._expected += self._share * (setpoint - self._expected)
        self.added += _MET_PER_S * self._tick_s * (self._expected - flown)
        self.added *= _HEADWIND_MPS / max(_HEADWIND_MPS, abs(self.added))
        return self.added

    def steady(
        self, setpoint: complex, flown: complex, response_s: float, most_mps: float
    ) -> complex:
        """What is added in this tick of a flight after it.

        Args:
            setpoint: that is to be flown.
            flown: velocity.
            response_s: from a setpoint to the flown velocity, as estimated in flight.
            most_mps: the speed limit.
        """
        self._expected += self._tick_s / (response_s + self._tick_s) * (setpoint - self._expected)
        per_s = 1.0 / max(response_s, _STEADY_S)
        self.added += per_s * self._tick_s * (self._expected - flown)
        self.added *= _HEADWIND_MPS / max(_HEADWIND_MPS, abs(self.added))
        ahead = setpoint / max(abs(setpoint), 1e-9)
        faster = (self.added * ahead.conjugate()).real
        over = abs(setpoint) + faster - _OVERTAKES * most_mps
        self.added -= ahead * max(0.0, min(faster, over))
        return self.fade()

    def fade(self) -> complex:
        """What is added while the vehicle does not follow setpoints."""
        self.added *= 1.0 - self._tick_s / _TAKES_OVER_S
        return self.added


@row
class LawInput:
    """The other aircraft as the law takes them, in the plan's order, then traffic."""

    aircraft: list[OtherAircraft]
    """One a row."""
    rows: list[Known]
    errors: list[complex]
    """Of every aircraft, point minus slot [units]; 0 where it does not fly along."""
    along: int
    """How many do: fresh, with a slot, and in the same formation."""


class LawInputBuilder:
    """Builds the law's input each tick; keeps what changes only when an aircraft comes or goes, or
    the slots change."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._unit_m = plan.unit_m
        self._plain = plan.compensation is Compensation.NONE
        self._own = own_id
        self._traffic = -1
        self._slots: Mapping[int, Point] = {}

    def build(
        self,
        snapshot: PeerSnapshot,
        formation: Formation,
        lead_s: float,
        own: complex,
        reach: float,
    ) -> LawInput:
        """All neighbours, and all aircraft within `reach` of `own` [units].

        A peer is carried on with its setpoint for at most `lead_s` [s], then with the formation's
        common velocity for as long as a prediction holds (`predicted_s`). A peer without a slot is
        no neighbour. One that is apart by height is no row, or, as a neighbour, one out of reach.
        """
        slots, neighbours = formation.slots, formation.neighbours
        now, plain, unit_m = snapshot.now_s, self._plain, self._unit_m
        key, velocity = formation.key, formation.velocity
        traffic, within, over = snapshot.traffic, reach * reach, snapshot.over
        if slots is not self._slots or len(traffic) != self._traffic:
            self._slots, self._traffic = slots, len(traffic)
            everyone = snapshot.peers + traffic
            self._places = [complex(*slots.get(other.id, (0.0, 0.0))) for other in everyone]
            self._lower = [other.id == TRAFFIC or self._own < other.id for other in everyone]
        new = tuple.__new__  # a third of the time that `Known(...)` takes
        aircraft: list[OtherAircraft] = []
        rows: list[Known] = []
        errors: list[complex] = []
        count = 0
        for peer, place, lower in zip(snapshot.peers, self._places, self._lower, strict=False):
            # few calls: a large swarm has a hundred
            agent, state, setpoint = peer.id, peer.state, peer.setpoint
            flies = peer.formation
            with_us = flies is not None and flies == key and agent in slots
            age_s = now - peer.true_s if peer.far else peer.age_s
            lead = age_s if age_s < lead_s else lead_s  # noqa: FURB136 - without a call
            if plain:
                point = peer.position / unit_m
            elif with_us and velocity:
                further = min(age_s, predicted_s(peer)) - lead
                point = (peer.stop_point + setpoint * lead + velocity * further) / unit_m
            else:
                point = (peer.stop_point + setpoint * lead) / unit_m
            if with_us:
                errors.append(point - place)
                count += 1
            else:
                errors.append(0j)
            if state is None:
                continue
            linked = (
                agent in neighbours
                and peer.followed
                and (with_us or (agent in slots and not peer.elsewhere(key)))
            )
            if not linked:
                q = own - point
                if not q.real * q.real + q.imag * q.imag < within:
                    continue
            if agent in over:
                if not linked:
                    continue
                off = out_of_reach(point - own, reach)
                point, place = point + off, place + off
            aircraft.append(peer)
            known = (agent, point, place, setpoint / unit_m, age_s, linked, lower)
            rows.append(new(Known, known))
        for other in traffic:
            errors.append(0j)
            point = other.stop_point / unit_m
            q = own - point
            if q.real * q.real + q.imag * q.imag < within:
                aircraft.append(other)
                flown = other.setpoint / unit_m
                rows.append(new(Known, (TRAFFIC, point, 0j, flown, other.age_s, False, True)))
        return LawInput(aircraft=aircraft, rows=rows, errors=errors, along=count)


def flies_along(other: OtherAircraft) -> bool:
    """It was heard within `NEIGHBOUR_S` and flies the mission's law; traffic never does."""
    return other.followed and other.state is not None and other.state.phase is Phase.FLY
