"""Flies a batch: one Python loop over ticks, arrays over missions, agents and pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.law import OVERSPEED, STATUSES
from swarm_ctl.core.plan import Compensation
from swarm_ctl.core.swarm_law import Near, Rings, SwarmLaw
from swarm_ctl.study.batch import Batch, Bools, Floats, connected
from swarm_ctl.study.motion import Motion, motion_of
from swarm_ctl.study.news import News

_CHECK: Final = 5
"""Ticks between two looks at whether the formation stands."""
_COMPACT: Final = 0.75
"""Finished missions are taken out of the arrays once no more than this share is left."""

Watch: TypeAlias = Callable[[float, NDArray[np.intp], Floats, "Near | None"], None]
"""Called every tick with the time, the places in the batch that are still flown, positions (2, n, m), near pairs."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """How each mission of a batch went; all (m,) unless they say more. Lengths in units."""

    smallest: Floats
    """Smallest true distance of any two agents."""
    converged: Bools
    time_s: Floats
    """When the formation stood (before settling); at the limit where it did not."""
    error: Floats
    """Largest |e_i - mean e| at the end."""
    links: NDArray[np.int64]
    links_broken: NDArray[np.int64]
    """Links of the start graph that ever got longer than r."""
    longest_link: Floats
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
    # A batch of one is summed in another order: last bits would differ from the same mission's in a full batch.
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
        self._cell = cell
        self.result = _blank(m)
        self._place = np.arange(m)
        self._flying = np.ones(m, dtype=np.bool_)
        self._law = SwarmLaw(batch.slots, batch.links, batch.h, cell.law)
        self._motion: Motion = motion_of(batch)
        self._carry_on = cell.compensation is Compensation.STOP_POINT
        told_late = batch.delay_s.any() or batch.loss.any()
        self._news = News(batch, cell.tick_s, self._carry_on) if told_late else None
        self._rings = Rings(cell.n, m)
        self._linked = batch.links[self._rings.first, self._rings.second] & self._rings.once[..., None]
        self._nearest = np.full(self._rings.squared.shape, np.inf)
        self._farthest = np.zeros(self._rings.squared.shape)
        self._statuses = np.zeros((len(STATUSES), m), dtype=np.int64)
        self._small_gap = np.zeros(m, dtype=np.int64)
        self._parted = np.zeros(m, dtype=np.bool_)
        self._since = np.full(m, np.inf)

    def step(self, tick: int, watch: Watch | None) -> None:
        """One tick of all missions."""
        position, points = self._motion.position, self._motion.points()
        squared = self._rings.measure(position)
        np.minimum(self._nearest, squared, out=self._nearest)
        np.maximum(self._farthest, squared, out=self._farthest)
        if self._news is None:
            u, near = self._law.step(points)
        else:
            u, near = self._law.step_heard(points, self._news.exchange(tick, points, self._motion.velocity))
        self._count(near)
        if watch is not None:
            watch(tick * self._cell.tick_s, self._place, position, near)
        self._motion.move(u)

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
        e = self._motion.position - self._law.slots
        e -= e.mean(axis=1, keepdims=True)
        error = np.sqrt((e * e).sum(axis=0).max(axis=0))
        self._since = np.where(error < self._cell.tolerance, np.minimum(self._since, now), np.inf)
        formed = now - self._since >= self._cell.settle_s - 1e-9
        over = (formed | last) & self._flying
        if over.any():
            self._conclude(over, formed, error, tick)
            self._flying &= ~over
            left = np.count_nonzero(self._flying)
            if 1 < left <= _COMPACT * len(self._flying):
                self._compact()
        return not self._flying.any()

    def _note_parted(self, stretched: Bools) -> None:
        suspects = stretched.any(axis=(0, 1)) & ~self._parted
        if not suspects.any():
            return
        ring, first, mission = np.nonzero(stretched[..., suspects])
        links = self._law.links[..., suspects].copy()
        second = self._rings.second[ring, first]
        links[first, second, mission] = links[second, first, mission] = False
        self._parted[suspects] = ~connected(links)

    def _conclude(self, over: Bools, formed: Bools, error: Floats, tick: int) -> None:
        place, result = self._place[over], self.result
        far = np.where(self._linked[..., over], self._farthest[..., over], 0.0)
        result.smallest[place] = np.sqrt(self._nearest[..., over].min(axis=(0, 1)))
        result.converged[place] = formed[over]
        result.time_s[place] = np.where(formed, self._since, tick * self._cell.tick_s)[over]
        result.error[place] = error[over]
        result.links[place] = np.count_nonzero(self._linked[..., over], axis=(0, 1))
        result.links_broken[place] = np.count_nonzero(far > self._cell.law.r**2, axis=(0, 1))
        result.longest_link[place] = np.sqrt(far.max(axis=(0, 1), initial=0.0))
        result.parted[place] = self._parted[over]
        result.statuses[:, place] = self._statuses[:, over]
        result.small_gap[place] = self._small_gap[over]
        result.steps[place] = tick + 1

    def _compact(self) -> None:
        keep = self._flying
        for name in ("_linked", "_nearest", "_farthest", "_statuses", "_small_gap", "_parted", "_since", "_place"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[..., keep]))
        self._law = self._law.only(keep)
        self._motion.only(keep)
        if self._news is not None:
            self._news.only(keep)
        self._rings = Rings(self._cell.n, len(self._place))
        self._flying = np.ones(len(self._place), dtype=np.bool_)


def _blank(m: int) -> Outcome:
    def whole() -> NDArray[np.int64]:
        return np.zeros(m, dtype=np.int64)

    return Outcome(
        smallest=np.zeros(m),
        converged=np.zeros(m, dtype=np.bool_),
        time_s=np.zeros(m),
        error=np.zeros(m),
        links=whole(),
        links_broken=whole(),
        longest_link=np.zeros(m),
        parted=np.zeros(m, dtype=np.bool_),
        statuses=np.zeros((OVERSPEED + 1, m), dtype=np.int64),
        small_gap=whole(),
        steps=whole(),
    )
