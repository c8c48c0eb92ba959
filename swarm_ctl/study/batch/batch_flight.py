"""Flies a batch: one Python loop over ticks, arrays over missions, agents and pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Final, Self, TypeAlias

import numpy as np

from swarm_ctl.core.law import mean_error_feedback
from swarm_ctl.core.law.formation_law import STATUSES
from swarm_ctl.core.law.swarm_law import NearPairs, Rings
from swarm_ctl.core.model.arrays import (
    Bools,
    Complex,
    Floats,
    Indices,
    Ints,
    complex_of,
    keep_missions,
)
from swarm_ctl.core.model.plan import Compensation, Safety
from swarm_ctl.core.model.timeouts import FRESH_S, SETPOINT_TIMEOUT_S
from swarm_ctl.core.safety.batch_safety_filter import (
    BatchHeard,
    BatchLinks,
    BatchPeers,
    BatchSafetyFilter,
)
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.study.batch.batch import Batch, connected
from swarm_ctl.study.batch.batch_hearing import hearing_of
from swarm_ctl.study.batch.batch_slot_exchange import BatchSlotExchange
from swarm_ctl.study.batch.lossy_channel import HeardStates, LossyChannel
from swarm_ctl.study.batch.motion import BatchMotion, motion_of
from swarm_ctl.study.batch.own_swarm_law import swarm_law
from swarm_ctl.study.parameter_space import Cell

_CHECK: Final = 5
"""Ticks between two looks at whether the formation stands."""
STUCK_MPS: Final = 0.05
_STUCK_S: Final = 20.0
"""All commands this close to their mean for so long, and not formed: a dead-lock. A swarm that is
blocked may drift as a whole."""
_KEPT: Final = 0.9
"""Links whose slots are this close [r] are expected to stay within r."""
_COMPACT: Final = 0.75
"""Finished missions are taken out of the arrays once no more than this share is left."""

TickObserver: TypeAlias = Callable[[float, Indices, Floats, "NearPairs | None"], None]
"""Called every tick with the time, the places in the batch that are still flown, positions (2, n,
m), near pairs."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchResult:
    """How each mission of a batch went; all (m,) unless they say more. Lengths in units."""

    smallest: Floats
    """Smallest true distance of any two live agents, between ticks too: each flies straight from
    one to the next."""
    smallest_silent: Floats
    """Smallest true distance of a live agent to the vehicle of a silent one; infinity without
    one."""
    converged: Bools
    time_s: Floats
    """When the formation stood (before settling); at the limit where it did not."""
    error: Floats
    """Largest |e_i - mean e| at the end."""
    links: Ints
    links_broken: Ints
    """Links of the start graph that ever got longer than r."""
    kept_broken: Ints
    """Of those, the ones between live agents while their slots were within 0.9 r."""
    longest_link: Floats
    stuck: Bools
    """A dead-lock: not formed at the end, and all commands within 0.05 m/s of their mean for the
    last 20 s."""
    touched: Floats
    """Share of agent-ticks in which the safety filter changed the wish; 0 without one."""
    yielded: Ints
    """Agent-ticks in which keep-outs excluded each other."""
    exchanges: Ints
    parted: Bools
    """The links that were within r did not hang together at some look (every `_CHECK` ticks)."""
    statuses: Ints
    """Pair-ticks by sigma status (4, m), each agent's view of a pair counted."""
    small_gap: Ints
    """Pair-ticks with D_ub - D_lb <= 2, which the paper takes for impossible."""
    steps: Ints
    """Ticks flown."""

    @classmethod
    def blank(cls, m: int) -> Self:
        """For m missions, nothing flown yet."""
        types = {"Floats": np.float64, "Ints": np.int64, "Bools": np.bool_}
        shapes = {"statuses": (len(STATUSES), m)}
        return cls(*(np.zeros(shapes.get(f.name, (m,)), types[str(f.type)]) for f in fields(cls)))

    def only(self, missions: slice) -> Self:
        """Of some of the missions."""
        return type(self)(*(getattr(self, f.name)[..., missions] for f in fields(self)))


def fly(batch: Batch, observer: TickObserver | None = None) -> BatchResult:
    """Fly all missions of a batch to their ends."""
    count = len(batch)
    # A batch of one is summed in another order: last bits would differ from the same mission's in a
    # full batch.
    flight = _BatchFlight(batch if count > 1 else batch.only(np.zeros(2, dtype=np.intp)))
    last = round(batch.cell.limit_s / batch.cell.tick_s)
    for tick in range(last + 1):
        flight.step(tick, observer)
        if (tick % _CHECK == 0 or tick == last) and flight.look(tick, tick == last):
            break
    return flight.result.only(slice(count))


def safety_filter_of(cell: Cell, agents: Ints) -> BatchSafetyFilter:
    """The safety filter that a cell asks for; `agents` are ids (n, m)."""
    safety = Safety(*(cell.has(part) for part in ("filter", "guard", "release", "align")))
    margins = Margins.of(cell.law, cell.model, cell.speed_mps, cell.unit_m).in_units(cell.unit_m)
    return BatchSafetyFilter(safety, cell.law, margins, cell.tick_s, agents)


class _BatchFlight:
    """A batch in the air."""

    def __init__(self, batch: Batch) -> None:
        cell, (_, n, m) = batch.cell, batch.starts.shape
        self._cell, self._kappa = cell, batch.kappa
        self.result = BatchResult.blank(m)
        self._place = np.arange(m)
        self._flying = np.ones(m, dtype=np.bool_)
        self._law = swarm_law(batch.slots, batch.links, batch.flown_h, cell.law)
        self._neighbours, self._h = batch.links, batch.flown_h
        self._motion: BatchMotion = motion_of(batch)
        self._seen = batch.starts
        """Positions at the last step."""
        self._silent_from = batch.silent_from(cell.tick_s)
        self._silent = bool(np.isfinite(self._silent_from).any())
        told_late = any(
            each.high > 0 for each in (cell.delay_s, cell.jitter_s, cell.loss, cell.silent)
        )
        ids = np.repeat(1 + np.arange(n)[:, None], m, axis=1)
        self._filter = safety_filter_of(cell, ids) if cell.has("filter") else None
        # without filter and average only links and what is within r_out count: near peers
        self._hearing = hearing_of(batch) if told_late or self._filter is not None else None
        late = told_late or self._hearing is not None
        self._channel = LossyChannel(batch, cell.tick_s, self._hearing) if late else None
        self._exchange = BatchSlotExchange(batch) if cell.has("exchange") else None
        self._slots, self._told_slots = batch.slots, batch.slots[:, None]
        """As they are now, and as they are heard: exchanges change them."""
        self._links: BatchLinks | None = None
        self._flown, self._touched, self._yielded = np.zeros(m), np.zeros(m), np.zeros(m)
        """Agent-ticks: all, those in which the filter changed the wish, and those in which
        keep-outs excluded each other."""
        self._rings = Rings(n, m)
        self._linked = (
            batch.links[self._rings.first, self._rings.second] & self._rings.once[..., None]
        )
        self._fits = self._held = self._fitting()
        pairs = self._rings.squared.shape
        self._nearest, self._nearest_silent = np.full(m, np.inf), np.full(m, np.inf)
        self._farthest, self._farthest_kept = np.zeros(pairs), np.zeros(pairs)
        self._statuses = np.zeros((len(STATUSES), m), dtype=np.int64)
        self._small_gap = np.zeros(m, dtype=np.int64)
        self._parted = np.zeros(m, dtype=np.bool_)
        self._since, self._moved_s = np.full(m, np.inf), np.zeros(m)

    def _fitting(self) -> Bools:
        """Links (rings, n, m) that the shape keeps within r."""
        apart = self._slots[:, self._rings.first] - self._slots[:, self._rings.second]
        fits: Bools = self._linked & ((apart**2).sum(axis=0) <= (_KEPT * self._cell.law.r) ** 2)
        return fits

    def step(self, tick: int, observer: TickObserver | None) -> None:
        """One tick of all missions."""
        position, points = self._motion.position, self._motion.points()
        live = tick < self._silent_from
        self._measure(position, live)
        self._seen = position
        wish, near = self._wish(tick, points, live)
        self._count(near)
        if observer is not None:
            observer(tick * self._cell.tick_s, self._place, position, near)
        if self._silent:
            wish = self._without_the_silent(tick, wish, live)
        self._motion.move(wish)

    def _measure(self, position: Floats, live: Bools) -> None:
        """Take the distances of all pairs into the smallest and the largest."""
        squared = self._rings.measure(position)
        moved = position - self._seen
        if not self._silent:
            self._approach(self._nearest, squared, moved)
        else:
            first, second = live[self._rings.first], live[self._rings.second]
            both, one = first & second, first ^ second
            self._approach(self._nearest, np.where(both, squared, np.inf), moved)
            self._approach(self._nearest_silent, np.where(one, squared, np.inf), moved)
            squared = np.where(both, squared, 0.0)
        np.maximum(self._farthest, squared, out=self._farthest)
        if self._filter is not None:
            # a link that an exchange makes fit counts from when it is as short as its slots
            self._held = self._fits & (self._held | (squared <= (_KEPT * self._cell.law.r) ** 2))
            np.maximum(self._farthest_kept, squared, out=self._farthest_kept, where=self._held)

    def _approach(self, nearest: Floats, squared: Floats, moved: Floats) -> None:
        """Take the pairs' squared distances since the last tick into `nearest` (m,).

        Args:
            nearest: the smallest so far, squared.
            squared: now, by rings; infinity for pairs that do not count.
            moved: since the last tick, (2, n, m).
        """
        now = squared.min(axis=(0, 1))
        np.minimum(nearest, now, out=nearest)
        # no two come closer than so much in a tick: most missions have no pair that could have been
        # nearer on the way than any was
        reach = 2.0 * np.sqrt((moved**2).sum(axis=0).max(axis=0))
        bound = (np.sqrt(nearest) + reach) ** 2
        some = np.flatnonzero(now < bound)
        ring, agent, place = np.nonzero(squared[..., some] < bound[some])
        first, second = self._rings.first[ring, agent], self._rings.second[ring, agent]
        mission = some[place]
        way = moved[:, first, mission] - moved[:, second, mission]
        before = self._seen[:, first, mission] - self._seen[:, second, mission]
        length = np.maximum((way * way).sum(axis=0), 1e-300)
        share = np.clip(-(before * way).sum(axis=0) / length, 0.0, 1.0)
        np.minimum.at(nearest, mission, ((before + share * way) ** 2).sum(axis=0))

    def _wish(self, tick: int, points: Floats, live: Bools) -> tuple[Floats, NearPairs | None]:
        """What is commanded [units/s], and the near pairs."""
        if self._channel is None and self._filter is None:
            u, near = self._law.step(points)
            return u * self._kappa, near
        heard = self._heard(tick, points)
        self._follow(heard)
        if self._exchange is not None and self._exchange.look(tick, points, heard, live):
            self._slots, self._told_slots = self._exchange.slots, self._exchange.told_slots
            self._links, self._fits = None, self._fitting()
        if self._hearing is not None:
            partners = None if self._exchange is None else self._exchange.partners
            self._hearing.look(tick, points, heard.points, heard.age_s, partners)
        carry_on = self._cell.compensation is Compensation.STOP_POINT
        at = heard.carried(heard.lead_s) if carry_on else heard.points
        terms = self._law.step_heard(points, at, self._slots, self._told_slots)
        if self._filter is None:
            return (terms.consensus + terms.avoidance) * self._kappa, terms.near
        consensus = complex_of(terms.consensus) * self._kappa
        avoidance = complex_of(terms.avoidance) * self._kappa
        peers = _peers_of(points, heard, self._motion)
        if self._cell.has("align"):
            consensus = consensus + self._aligned(points, terms.told, peers.heard.fresh)
        if self._links is None:
            told = complex_of(self._told_slots)
            self._links = BatchLinks(self._neighbours, complex_of(self._slots), told)
        flown = self._filter.velocity(consensus, avoidance, peers, self._links)
        self._flown += np.count_nonzero(live, axis=0)
        self._touched += np.count_nonzero(self._filter.touched & live, axis=0)
        self._yielded += np.count_nonzero(self._filter.yielded & live, axis=0)
        return np.stack((flown.real, flown.imag)), terms.near

    def _heard(self, tick: int, points: Floats) -> HeardStates:
        velocity = self._motion.velocity
        if self._channel is not None:
            return self._channel.exchange(tick, points, velocity)
        _, n, m = points.shape
        return HeardStates(points[:, None], velocity[:, None], np.zeros((1, n, m)), np.zeros(m))

    def _aligned(self, points: Floats, errors: Floats, fresh: Bools) -> Complex:
        """The pull to the average of all agents that are heard; `errors` (2, n, n, m) as they are
        told."""
        counted = np.empty(errors.shape[1:])
        counted[:] = fresh
        others = np.arange(len(counted))
        counted[others, others] = 0.0
        total = complex_of(np.einsum("ijm,cijm->cim", counted, errors))
        return mean_error_feedback.pull_of(
            complex_of(points - self._slots), total, counted.sum(axis=1)
        )

    def _follow(self, heard: HeardStates) -> None:
        """Agents follow the neighbours that they have heard within `NEIGHBOUR_S`."""
        followed = self._neighbours & heard.followed
        if (followed != self._law.links).any():
            self._law = swarm_law(self._law.slots, followed, self._h, self._cell.law)

    def _without_the_silent(self, tick: int, wish: Floats, live: Bools) -> Floats:
        """Vehicles of silent agents go on with the last command, then stop."""
        blind_s = SETPOINT_TIMEOUT_S.get(self._cell.vehicle, SETPOINT_TIMEOUT_S["ardupilot"])
        still = tick >= self._silent_from + blind_s / self._cell.tick_s
        return np.where(live, wish, np.where(still, 0.0, self._motion.velocity))

    def _count(self, near: NearPairs | None) -> None:
        if near is None:
            return
        m = len(self._place)
        numbers = near.numbers
        mission = np.broadcast_to(near.mission, numbers.status.shape)
        cells = numbers.status.astype(np.intp) * m + mission
        self._statuses += np.bincount(cells.ravel(), minlength=len(STATUSES) * m).reshape(-1, m)
        narrow = numbers.d_ub - numbers.d_lb <= 2.0
        self._small_gap += np.bincount(mission[narrow], minlength=m)

    def look(self, tick: int, last: bool) -> bool:
        """Note which missions are over; True when all are."""
        now = tick * self._cell.tick_s
        stretched = (self._rings.squared > self._cell.law.r**2) & self._linked
        self._note_parted(stretched)
        error = self._error(tick < self._silent_from)
        self._since = np.where(error < self._cell.tolerance, np.minimum(self._since, now), np.inf)
        formed = now - self._since >= self._cell.settle_s - 1e-9
        velocity = self._motion.velocity
        velocity = velocity - velocity.mean(axis=1, keepdims=True)
        speed = np.sqrt((velocity**2).sum(axis=0).max(axis=0)) * self._cell.unit_m
        self._moved_s = np.where(
            (speed >= STUCK_MPS) | (error < self._cell.tolerance), now, self._moved_s
        )
        stuck = now - self._moved_s >= _STUCK_S
        over = (formed | last) & self._flying
        if over.any():
            self._conclude(over, formed, stuck & ~formed, error, tick)
            self._flying &= ~over
            left = np.count_nonzero(self._flying)
            if 1 < left <= _COMPACT * len(self._flying):
                self._compact()
        return not self._flying.any()

    def _error(self, live: Bools) -> Floats:
        """Largest |e_i - mean e| over the live agents, (m,)."""
        e = self._seen - self._slots
        if not self._silent:
            e -= e.mean(axis=1, keepdims=True)
        else:
            e -= e.mean(axis=1, keepdims=True, where=live)
            e = np.where(live, e, 0.0)
        error: Floats = np.sqrt((e * e).sum(axis=0).max(axis=0))
        return error

    def _note_parted(self, stretched: Bools) -> None:
        suspects = stretched.any(axis=(0, 1)) & ~self._parted
        if not suspects.any():
            return
        ring, first, mission = np.nonzero(stretched[..., suspects])
        links = self._law.links[..., suspects].copy()
        second = self._rings.second[ring, first]
        links[first, second, mission] = links[second, first, mission] = False
        self._parted[suspects] = ~connected(links)

    def _conclude(self, over: Bools, formed: Bools, stuck: Bools, error: Floats, tick: int) -> None:
        place, result, r2 = self._place[over], self.result, self._cell.law.r**2
        far = np.where(self._linked[..., over], self._farthest[..., over], 0.0)
        result.smallest[place] = np.sqrt(self._nearest[over])
        result.smallest_silent[place] = np.sqrt(self._nearest_silent[over])
        result.converged[place] = formed[over]
        result.stuck[place] = stuck[over]
        result.time_s[place] = np.where(formed, self._since, tick * self._cell.tick_s)[over]
        result.error[place] = error[over]
        result.links[place] = np.count_nonzero(self._linked[..., over], axis=(0, 1))
        result.links_broken[place] = np.count_nonzero(far > r2, axis=(0, 1))
        kept = self._farthest_kept
        if self._filter is None:
            kept = np.where(self._fits, self._farthest, 0.0)
        result.kept_broken[place] = np.count_nonzero(kept[..., over] > r2, axis=(0, 1))
        result.longest_link[place] = np.sqrt(far.max(axis=(0, 1), initial=0.0))
        result.parted[place] = self._parted[over]
        result.statuses[:, place] = self._statuses[:, over]
        result.small_gap[place] = self._small_gap[over]
        result.steps[place] = tick + 1
        result.touched[place] = (self._touched / np.maximum(self._flown, 1))[over]
        result.yielded[place] = self._yielded[over]
        if self._exchange is not None:
            result.exchanges[place] = self._exchange.count[over]

    def _compact(self) -> None:
        keep = self._flying
        keep_missions(self, keep, *_BY_MISSION)
        self._law, self._links = self._law.only(keep), None
        self._motion.only(keep)
        for part in (self._channel, self._filter, self._exchange):
            if part is not None:
                part.only(keep)
        self._rings = Rings(self._cell.n, len(self._place))
        self._flying = np.ones(len(self._place), dtype=np.bool_)


_BY_MISSION: Final = (
    *(
        "_place",
        "_kappa",
        "_h",
        "_seen",
        "_neighbours",
        "_silent_from",
        "_slots",
        "_told_slots",
        "_linked",
    ),
    *("_fits", "_held", "_nearest", "_nearest_silent", "_farthest", "_farthest_kept", "_statuses"),
    *("_small_gap", "_parted", "_since", "_moved_s", "_flown", "_touched", "_yielded"),
)


def _peers_of(points: Floats, heard: HeardStates, motion: BatchMotion) -> BatchPeers:
    fresh, response_s = heard.fresh, motion.response_s
    yields = fresh if isinstance(heard.late_s, float) else heard.age_s <= FRESH_S
    known = BatchHeard(complex_of(heard.velocity), heard.age_s, fresh, yields, response_s[None])
    return BatchPeers(points, heard.points, known, motion.doubt_s, response_s)
