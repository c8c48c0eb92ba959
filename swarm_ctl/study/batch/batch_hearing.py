"""Near and far peers (`core.swarm.hearing`) in a batch: which states agents of a large swarm hear.

As in lockstep: a state is heard from `FOLLOW_TICKS` after its sender has come near. The swarms have
flown before, so what is near at the start is heard already.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from swarm_ctl.core.model.arrays import MANY, Bools, Floats, Ints, keep_missions
from swarm_ctl.core.model.plan import Policies
from swarm_ctl.core.model.timeouts import FAR_EVERY_S, FAR_LATE_S, NEIGHBOUR_S
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.deadlock import SWIRL_OFF
from swarm_ctl.core.swarm.hearing import FOLLOW_TICKS, KEPT_S, LOOK_S, SMALL_SWARM, Boundary
from swarm_ctl.study.batch.batch import Batch

_NEVER: Final = np.iinfo(np.int64).max
_BEFORE: Final = -(1 << 40)
"""A tick long before the start."""


class BatchHearing:
    """Of all pairs (receiver, sender, mission) of a batch."""

    def __init__(self, batch: Batch) -> None:
        cell, (_, n, m) = batch.cell, batch.starts.shape
        margins = Margins.of(cell.law, cell.model, cell.speed_mps, cell.unit_m)
        reach_m = max(margins.farthest, (cell.law.r_out + SWIRL_OFF) * cell.unit_m)
        silent_s, tick_s = Policies().agent_lost_after_s, cell.tick_s
        self._boundary = Boundary(reach_m, cell.speed_mps, tick_s, silent_s)
        self._unit_m, self._tick_s, self._agent = cell.unit_m, tick_s, np.arange(n)
        self._look, self._word = (max(1, round(s / tick_s)) for s in (LOOK_S, FAR_EVERY_S))
        self._kept, self._late = (round(s / tick_s) for s in (KEPT_S, NEIGHBOUR_S))
        self._links = self._always = batch.links
        self._near = np.zeros((n, n, m), dtype=np.bool_)
        self._near_at = np.full((n, n, m), _BEFORE)
        """The last look at which it was within the boundary."""
        self._heard_from = np.full((n, n, m), _NEVER)
        """The first tick whose states are heard; `_NEVER` of far peers."""
        apart = batch.starts[:, :, None] - batch.starts[:, None]
        self._choose(0, slice(None), np.sqrt((apart**2).sum(axis=0)), np.zeros((n, n, m)))
        self._heard_from[self._near] = _BEFORE

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        keep_missions(self, missions, "_links", "_always", "_near", "_near_at", "_heard_from")

    @property
    def near(self) -> Bools:
        """Who is near (n, n, m)."""
        return self._near

    def hears(self, sent: Ints) -> Bools:
        """Which states, sent in these ticks (n or 1, n, m), are heard (n, n, m): those of near
        peers, and far words."""
        word = (sent + self._agent[:, None]) % self._word == 0
        heard: Bools = word | (sent >= self._heard_from)
        return heard

    def late_s(self, tick: int) -> Floats:
        """By how much words may be older than states are (n, n, m); see `Peer.late_s`."""
        soon = self._heard_from > tick - self._late + FOLLOW_TICKS - 1
        return np.where(soon, FAR_LATE_S, 0.0)

    def look(
        self, tick: int, points: Floats, told: Floats, age_s: Floats, partners: Bools | None
    ) -> None:
        """Choose the near peers anew, for the agents whose turn it is: every `LOOK_S`, and when
        others exchange slots with them.

        Args:
            tick: now.
            points: own stop points (2, n, m) [units].
            told: the others', as they were told (2, n, n, m).
            age_s: of that news (n, n, m).
            partners: agents that exchange slots (n, n, m); None: slots stay.
        """
        rows, turn = slice(-tick % self._look, None, self._look), np.True_
        if partners is not None:
            always = self._links | partners
            changed, self._always = (always != self._always).any(axis=1), always
            if changed.any():
                changed[rows] = True
                rows, turn = slice(None), changed[:, None]
        apart = points[:, rows, None] - told[:, rows]
        self._choose(tick, rows, np.sqrt((apart**2).sum(axis=0)), age_s[rows], turn)

    def _choose(
        self,
        tick: int,
        rows: slice,
        distance: Floats,
        age_s: Floats,
        turn: Bools | np.bool_ = np.True_,
    ) -> None:
        """For these rows of receivers, in the missions where it is their turn."""
        within = distance * self._unit_m <= self._boundary.near_m(age_s, MANY)
        within |= self._always[rows]
        self._near_at[rows] = np.where(within & turn, tick, self._near_at[rows])
        near = np.where(turn, tick - self._near_at[rows] <= self._kept, self._near[rows])
        comes, goes = near & ~self._near[rows], ~near
        found = np.where(comes, tick + FOLLOW_TICKS, self._heard_from[rows])
        self._heard_from[rows] = np.where(goes, _NEVER, found)
        self._near[rows] = near


def hearing_of(batch: Batch) -> BatchHearing | None:
    """None for swarms in which all hear all."""
    return BatchHearing(batch) if batch.cell.n > SMALL_SWARM else None
