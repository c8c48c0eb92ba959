"""Flies a batch: one Python loop over ticks, arrays over missions, agents and pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.law.formation_law import OVERSPEED, STATUSES
from swarm_ctl.core.law.swarm_law import Near, Rings, SwarmLaw
from swarm_ctl.core.model.plan import Compensation
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, SETPOINT_TIMEOUT_S
from swarm_ctl.study.batch.batch import Batch, Bools, Floats, connected
from swarm_ctl.study.batch.batch_safety_filter import BatchSafetyFilter
from swarm_ctl.study.batch.lossy_channel import News, Told
from swarm_ctl.study.batch.motion import Motion, motion_of

_CHECK: Final = 5
"""Ticks between two looks at whether the formation stands."""
_STILL: Final = (0.05, 20.0)
"""All commands under this [m/s] for so long, and not formed: a dead-lock."""
_KEPT: Final = 0.9
"""Links whose slots are this close [r] are expected to stay within r."""
_COMPACT: Final = 0.75
"""Finished missions are taken out of the arrays once no more than this share is left."""

Watch: TypeAlias = Callable[[float, NDArray[np.intp], Floats, "Near | None"], None]
"""Called every tick with the time, the places in the batch that are still flown, positions (2, n,
m), near pairs."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """How each mission of a batch went; all (m,) unless they say more. Lengths in units."""

    smallest: Floats
    """Smallest true distance of any two live agents."""
    smallest_silent: Floats
    """Smallest true distance of a live agent to the vehicle of a silent one; infinity without
    one."""
    converged: Bools
    time_s: Floats
    """When the formation stood (before settling); at the limit where it did not."""
    error: Floats
    """Largest |e_i - mean e| at the end."""
    links: NDArray[np.int64]
    links_broken: NDArray[np.int64]
    """Links of the start graph that ever got longer than r."""
    kept_broken: NDArray[np.int64]
    """Of those, the ones between live agents while their slots were within 0.9 r."""
    longest_link: Floats
    stuck: Bools
    """A dead-lock: not formed at the end, and all commands under 0.05 m/s for the last 20 s."""
    touched: Floats
    """Share of agent-ticks in which the safety filter changed the wish; 0 without one."""
    yielded: NDArray[np.int64]
    """Agent-ticks in which keep-outs excluded each other."""
    exchanges: NDArray[np.int64]
    parted: Bools
    """The links that were within r did not hang together at some look (every `_CHECK` ticks)."""
    statuses: NDArray[np.int64]
    """Pair-ticks by sigma status (4, m), each agent's view of a pair counted."""
    small_gap: NDArray[np.int64]
    """Pair-ticks with D_ub - D_lb <= 2, which the paper takes for impossible."""
    steps: NDArray[np.int64]
    """Ticks flown."""


def fly(batch: Batch, watch: Watch | None = None) -> Outcome:
    """Fly all missions of a batch to their ends."""
    count = len(batch)
    # A batch of one is summed in another order: last bits would differ from the same mission's in a
    # full batch.
    flight = _Flight(batch if count > 1 else batch.only(np.zeros(2, dtype=np.intp)))
    last = round(batch.cell.limit_s / batch.cell.tick_s)
    for tick in range(last + 1):
        flight.step(tick, watch)
        if (tick % _CHECK == 0 or tick == last) and flight.look(tick, tick == last):
            break
    return _of_first(flight.result, count)


def _of_first(outcome: Outcome, count: int) -> Outcome:
    return Outcome(*(getattr(outcome, name)[..., :count] for name in Outcome.__slots__))


class _Flight:
    """A batch in the air."""

    def __init__(self, batch: Batch) -> None:
        cell, m = batch.cell, len(batch)
        self._cell, self._kappa = cell, batch.kappa
        self.result = _blank(m)
        self._place = np.arange(m)
        self._flying = np.ones(m, dtype=np.bool_)
        self._law = SwarmLaw(batch.slots, batch.links, batch.h, cell.law)
        self._motion: Motion = motion_of(batch)
        self._seen = batch.starts
        """Positions at the last step."""
        self._carry_on = cell.compensation is Compensation.STOP_POINT
        self._silent_from = batch.silent_from(cell.tick_s)
        self._silent = bool(np.isfinite(self._silent_from).any())
        told_late = batch.delay_s.any() or batch.loss.any() or self._silent
        self._news = News(batch, cell.tick_s) if told_late else None
        self._keeper = BatchSafetyFilter(batch) if cell.safety != "off" else None
        self._slots = batch.slots
        """As they are now: exchanges change them."""
        self._rings = Rings(cell.n, m)
        self._linked = (
            batch.links[self._rings.first, self._rings.second] & self._rings.once[..., None]
        )
        self._fits = self._fitting()
        self._held = self._fits
        self._nearest = np.full(self._rings.squared.shape, np.inf)
        self._nearest_silent = np.full(m, np.inf)
        self._farthest = np.zeros(self._rings.squared.shape)
        self._farthest_kept = np.zeros(self._rings.squared.shape)
        self._statuses = np.zeros((len(STATUSES), m), dtype=np.int64)
        self._small_gap = np.zeros(m, dtype=np.int64)
        self._parted = np.zeros(m, dtype=np.bool_)
        self._since = np.full(m, np.inf)
        self._moved_s = np.zeros(m)

    def _fitting(self) -> Bools:
        """Links (rings, n, m) that the shape keeps within r."""
        apart = self._slots[:, self._rings.first] - self._slots[:, self._rings.second]
        fits: Bools = self._linked & ((apart**2).sum(axis=0) <= (_KEPT * self._cell.law.r) ** 2)
        return fits

    def step(self, tick: int, watch: Watch | None) -> None:
        """One tick of all missions."""
        position, points = self._motion.position, self._motion.points()
        self._seen = position
        talks = tick < self._silent_from
        self._measure(position, talks)
        wish, near = self._wish(tick, points, talks)
        self._count(near)
        if watch is not None:
            watch(tick * self._cell.tick_s, self._place, position, near)
        if self._silent:
            wish = self._without_the_silent(tick, wish, talks)
        self._motion.move(wish)

    def _measure(self, position: Floats, talks: Bools) -> None:
        squared = self._rings.measure(position)
        live = squared
        if self._silent:
            both = talks[self._rings.first] & talks[self._rings.second]
            live = np.where(both, squared, np.inf)
            np.minimum(
                self._nearest_silent,
                np.where(both, np.inf, squared).min(axis=(0, 1)),
                out=self._nearest_silent,
            )
            squared = np.where(both, squared, 0.0)
        np.minimum(self._nearest, live, out=self._nearest)
        np.maximum(self._farthest, squared, out=self._farthest)
        if self._keeper is not None:
            # a link that an exchange makes fit counts from when it is as short as its slots
            self._held = self._fits & (self._held | (squared <= (_KEPT * self._cell.law.r) ** 2))
            np.maximum(self._farthest_kept, squared, out=self._farthest_kept, where=self._held)

    def _wish(self, tick: int, points: Floats, talks: Bools) -> tuple[Floats, Near | None]:
        """What is commanded [units/s], and the near pairs."""
        if self._news is None and self._keeper is None:
            u, near = self._law.step(points)
            return u * self._kappa, near
        velocity = self._motion.velocity
        if self._news is not None:
            told = self._news.exchange(tick, points, velocity)
        else:
            told = Told(
                points[:, None],
                velocity[:, None],
                np.zeros((1, *points.shape[1:])),
                np.zeros(points.shape[-1]),
            )
        if self._silent:
            self._unlink(tick)
        at = told.carried() if self._carry_on else told.points
        dealing = self._keeper.dealing if self._keeper is not None else None
        if dealing is not None:
            dealing.look(tick, points, told, talks)
            u, near = self._law.step_heard(points, at, dealing.slots, dealing.told_slots)
            self._change_slots(dealing.slots)
        else:
            u, near = self._law.step_heard(points, at)
        if self._keeper is None:
            return u * self._kappa, near
        return self._keeper.velocity(self._law, self._kappa, points, told, self._slots, talks), near

    def _change_slots(self, slots: Floats) -> None:
        if slots is not self._slots:
            self._slots = slots
            self._fits = self._fitting()

    def _unlink(self, tick: int) -> None:
        """Nobody follows whoever has not been heard for `NEIGHBOUR_S`."""
        gone = self._silent_from + round(NEIGHBOUR_S / self._cell.tick_s) == tick
        if gone.any():
            self._law = self._law.unlinked(gone)

    def _without_the_silent(self, tick: int, wish: Floats, talks: Bools) -> Floats:
        """Vehicles of silent agents go on with the last command, then stop."""
        blind_s = SETPOINT_TIMEOUT_S.get(self._cell.vehicle, SETPOINT_TIMEOUT_S["ardupilot"])
        still = tick >= self._silent_from + blind_s / self._cell.tick_s
        return np.where(talks, wish, np.where(still, 0.0, self._motion.velocity))

    def _count(self, near: Near | None) -> None:
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
        speed = np.sqrt((self._motion.velocity**2).sum(axis=0).max(axis=0)) * self._cell.unit_m
        self._moved_s = np.where(
            (speed >= _STILL[0]) | (error < self._cell.tolerance), now, self._moved_s
        )
        stuck = now - self._moved_s >= _STILL[1]
        over = (formed | last) & self._flying
        if over.any():
            self._conclude(over, formed, stuck & ~formed, error, tick)
            self._flying &= ~over
            left = np.count_nonzero(self._flying)
            if 1 < left <= _COMPACT * len(self._flying):
                self._compact()
        return not self._flying.any()

    def _error(self, talks: Bools) -> Floats:
        """Largest |e_i - mean e| over the live agents, (m,)."""
        e = self._seen - self._slots
        if not self._silent:
            e -= e.mean(axis=1, keepdims=True)
        else:
            e -= e.mean(axis=1, keepdims=True, where=talks)
            e = np.where(talks, e, 0.0)
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
        result.smallest[place] = np.sqrt(self._nearest[..., over].min(axis=(0, 1)))
        result.smallest_silent[place] = np.sqrt(self._nearest_silent[over])
        result.converged[place] = formed[over]
        result.stuck[place] = stuck[over]
        result.time_s[place] = np.where(formed, self._since, tick * self._cell.tick_s)[over]
        result.error[place] = error[over]
        result.links[place] = np.count_nonzero(self._linked[..., over], axis=(0, 1))
        result.links_broken[place] = np.count_nonzero(far > r2, axis=(0, 1))
        kept = (
            self._farthest_kept
            if self._keeper is not None
            else np.where(self._fits, self._farthest, 0.0)
        )
        result.kept_broken[place] = np.count_nonzero(kept[..., over] > r2, axis=(0, 1))
        result.longest_link[place] = np.sqrt(far.max(axis=(0, 1), initial=0.0))
        result.parted[place] = self._parted[over]
        result.statuses[:, place] = self._statuses[:, over]
        result.small_gap[place] = self._small_gap[over]
        result.steps[place] = tick + 1
        if self._keeper is not None:
            counts = self._keeper.counts
            result.touched[place] = (counts.touched / np.maximum(counts.flown, 1))[over]
            result.yielded[place] = counts.yielded[over]
            if self._keeper.dealing is not None:
                result.exchanges[place] = self._keeper.dealing.count[over]

    def _compact(self) -> None:
        keep = self._flying
        for name in _BY_MISSION:
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[..., keep]))
        self._law = self._law.only(keep)
        self._motion.only(keep)
        for part in (self._news, self._keeper):
            if part is not None:
                part.only(keep)
        self._rings = Rings(self._cell.n, len(self._place))
        self._flying = np.ones(len(self._place), dtype=np.bool_)


_BY_MISSION: Final = (
    "_linked", "_fits", "_held", "_nearest", "_nearest_silent", "_farthest", "_farthest_kept", "_statuses",
    "_small_gap", "_parted", "_since", "_moved_s", "_place", "_kappa", "_silent_from", "_slots",
)  # fmt: skip


def _blank(m: int) -> Outcome:
    def whole() -> NDArray[np.int64]:
        return np.zeros(m, dtype=np.int64)

    return Outcome(
        smallest=np.zeros(m),
        smallest_silent=np.full(m, np.inf),
        converged=np.zeros(m, dtype=np.bool_),
        time_s=np.zeros(m),
        error=np.zeros(m),
        links=whole(),
        links_broken=whole(),
        kept_broken=whole(),
        longest_link=np.zeros(m),
        stuck=np.zeros(m, dtype=np.bool_),
        touched=np.zeros(m),
        yielded=whole(),
        exchanges=whole(),
        parted=np.zeros(m, dtype=np.bool_),
        statuses=np.zeros((OVERSPEED + 1, m), dtype=np.int64),
        small_gap=whole(),
        steps=whole(),
    )
