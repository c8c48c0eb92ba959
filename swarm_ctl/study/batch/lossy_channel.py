"""What agents hear of each other when states are late and some get lost. Times in ticks, lengths in
units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.arrays import Bools, Floats, Indices, Ints, keep_missions
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S, lead_s
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.batch_hearing import BatchHearing

_DRAWN: Final = 512
"""Agents' ticks whose losses are drawn at once: so many ticks over n."""


@dataclass(frozen=True, slots=True, eq=False)
class HeardStates:
    """What each receiver (n, or 1 where all hear the same) knows of each sender; until the next
    tick."""

    points: Floats
    """As told, (2, receivers, senders, m)."""
    velocity: Floats
    """Commanded by the senders (2, receivers, senders, m) [units/s]."""
    age_s: Floats
    """(receivers, senders, m)."""
    lead_s: Floats
    """For how long the law carries the points on, (m,)."""
    late_s: Floats | float = 0.0
    """By how much news may be older than states are (receivers, senders, m)."""

    @property
    def fresh(self) -> Bools:
        """(receivers, senders, m), as the next."""
        return self.age_s <= FRESH_S + self.late_s

    @property
    def followed(self) -> Bools:
        """The law follows these senders."""
        return self.age_s <= NEIGHBOUR_S + self.late_s

    def carried(self, at_most_s: Floats | float) -> Floats:
        """The points, carried on with the senders' commands for their age, or this long."""
        carried: Floats = self.velocity * np.minimum(self.age_s, at_most_s)
        carried += self.points
        return carried


class LossyChannel:
    """Carries (point, command) of each agent to each other one every tick; links lose states
    independently. Silent agents send no more from their tick on. A state that arrives behind a
    newer one is dropped.

    Each mission draws its losses and jitter from Philox generators of its own, keyed by seed and
    row: it loses the same states whatever missions it is flown beside.
    """

    def __init__(self, batch: Batch, tick_s: float, hearing: BatchHearing | None = None) -> None:
        self._tick_s, self._hearing = tick_s, hearing
        self._delay = np.rint(batch.delay_s / tick_s).astype(np.intp)
        self._lead_s: Floats = lead_s(batch.kappa * batch.flown_h, np.minimum)
        _, n, m = batch.starts.shape
        self._silent_from = batch.silent_from(tick_s)
        self._losses = _Losses(batch, tick_s) if batch.loss.any() else None
        self._jitter = _Jitter(batch, tick_s) if batch.jitter_s.any() else None
        each = any(part is not None for part in (self._losses, self._jitter, hearing))
        oldest = int(self._delay.max()) if self._jitter is None else self._jitter.latest
        self._past = np.zeros((oldest + 1, 4, n, m))
        self._past[:, :2] = batch.starts
        self._known = np.zeros((4, n if each else 1, n, m))
        self._known[:2] = batch.starts[:, None]
        self._sent = np.zeros((n if each else 1, n, m))

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        keep_missions(self, missions, "_delay", "_past", "_known", "_sent")
        keep_missions(self, missions, "_silent_from", "_lead_s")
        for part in (self._losses, self._jitter, self._hearing):
            if part is not None:
                part.only(missions)

    def exchange(self, tick: int, points: Floats, velocity: Floats) -> HeardStates:
        """Send `points` and `velocity` [units/s] (2, n, m); what is heard."""
        place = tick % len(self._past)
        self._past[place, :2], self._past[place, 2:] = points, velocity
        if self._jitter is None:
            sent = (tick - self._delay)[None]
            arrives = sent < self._silent_from
            if self._hearing is not None:
                arrives = arrives & self._hearing.hears(sent)
            if self._losses is not None:
                arrives = arrives & self._losses.arrive(tick)
            arriving = self._past_of(sent[0])[:, None]
        else:
            leaves = np.repeat((tick < self._silent_from)[None], len(self._sent), axis=0)
            if self._hearing is not None:
                leaves = leaves & self._hearing.hears(np.array([[[tick]]]))
            if self._losses is not None:
                leaves = leaves & self._losses.arrive(tick)
            sent = self._jitter.carry(tick, leaves)
            arrives = sent > self._sent
            arriving = self._past_of(sent)
        missed = np.flatnonzero(~arrives)
        _replace(self._known, arriving, missed)
        _replace(self._sent[None], sent, missed)
        age_s = (tick - self._sent) * self._tick_s
        late_s = 0.0 if self._hearing is None else self._hearing.late_s(tick)
        return HeardStates(self._known[:2], self._known[2:], age_s, self._lead_s, late_s)

    def _past_of(self, sent: Indices) -> Floats:
        """What was sent in these ticks (..., n, m): (4, ..., n, m)."""
        ticks, _, n, m = self._past.shape
        flat = np.arange(n * m).reshape(n, m) + 4 * n * m * (sent % ticks)
        fields = n * m * np.arange(4).reshape(4, *([1] * sent.ndim))
        return self._past.ravel().take(flat + fields)


def _replace(known: Floats, arriving: Floats | Ints, missed: Indices) -> None:
    """Take in what arrives, but on the links `missed` (flat places in the last three axes of
    `known`): most states do arrive."""
    flat = known.reshape(len(known), -1)
    kept = flat.take(missed, axis=1)
    known[:] = arriving
    flat[:, missed] = kept


class _Losses:
    """Which links (n, n, m) lose what is sent; a two-state Gilbert channel, in which a burst of no
    length is a single loss."""

    def __init__(self, batch: Batch, tick_s: float) -> None:
        n, m = batch.cell.n, len(batch)
        self._random = _generators(batch, stream=0)
        self._loss = batch.loss
        ends = tick_s / np.maximum(batch.burst_s, tick_s)
        self._stays: Floats = np.maximum(1.0 - ends, batch.loss)
        """The chance of a loss right after one ..."""
        self._begins: Floats = batch.loss * (1.0 - self._stays) / (1.0 - batch.loss)
        """... and after none, so that `loss` is the share of all."""
        self._in_bursts = bool((self._stays > batch.loss).any())
        self._before: Bools | None = None
        self._arrive = np.zeros((max(8, _DRAWN // n), n, n, m), dtype=np.bool_)

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        keep_missions(self, missions, "_random", "_loss", "_stays", "_begins", "_arrive")
        if self._before is not None:
            keep_missions(self, missions, "_before")

    def arrive(self, tick: int) -> Bools:
        """The links that carry the states of this tick."""
        place = tick % len(self._arrive)
        if place == 0:
            self._draw()
        arrive: Bools = self._arrive[place]
        return arrive

    def _draw(self) -> None:
        """Which links get the states of the next ticks."""
        if self._in_bursts:
            self._draw_bursts()
            return
        drawn = np.empty((len(self._loss), *self._arrive.shape[:-1]), dtype=np.bool_)
        for arrive, loss, random in zip(drawn, self._loss, self._random, strict=True):
            np.greater_equal(random.random(arrive.shape, dtype=np.float32), loss, out=arrive)
        self._arrive = np.ascontiguousarray(np.moveaxis(drawn, 0, -1))

    def _draw_bursts(self) -> None:
        lost = self._before
        for place, drawn in enumerate(_uniform(self._random, self._arrive.shape[:-1])):
            chance = self._loss if lost is None else np.where(lost, self._stays, self._begins)
            lost = drawn < chance
            self._arrive[place] = ~lost
        self._before = lost


class _Jitter:
    """Carries what is sent to when it arrives: links (n, n, m) that are late by chance."""

    def __init__(self, batch: Batch, tick_s: float) -> None:
        n, m = batch.cell.n, len(batch)
        self._random = _generators(batch, stream=1)
        self._delay, self._more = batch.delay_s / tick_s, batch.jitter_s / tick_s
        self.latest = int(np.rint((self._delay + self._more).max()))
        """No state takes more ticks."""
        self._late = np.zeros((max(8, _DRAWN // n), n, n, m), dtype=np.int16)
        self._newest = np.full((self.latest + 1, n, n, m), -1, dtype=np.int64)
        """By the tick in which it arrives, a ring: when the newest was sent; -1: none."""

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        keep_missions(self, missions, "_random", "_delay", "_more", "_late", "_newest")

    def carry(self, tick: int, leaves: Bools) -> Ints:
        """When the newest was sent that arrives in this tick (n, n, m), -1: none; `leaves`: the
        links on which a state is sent now."""
        place, ticks = tick % len(self._late), len(self._newest)
        if place == 0:
            drawn = _uniform(self._random, self._late.shape[:-1])
            self._late = np.rint(self._delay + self._more * drawn).astype(np.int16)
        links = leaves.size
        arrives = (tick + self._late[place].astype(np.intp)) % ticks
        flat = arrives * links + np.arange(links).reshape(leaves.shape)
        self._newest.ravel()[flat[leaves]] = tick
        newest: Ints = self._newest[tick % ticks].copy()
        self._newest[tick % ticks] = -1
        return newest


def _uniform(generators: NDArray[np.object_], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """(*shape, m) from 0 to 1, each mission's from its own generator."""
    drawn = np.array([random.random(shape, dtype=np.float32) for random in generators])
    return np.ascontiguousarray(np.moveaxis(drawn, 0, -1))


def _generators(batch: Batch, stream: int) -> NDArray[np.object_]:
    """One for each mission (m,); streams do not meet."""
    keys = [np.array([batch.cell.seed, row], dtype=np.uint64) for row in batch.row.tolist()]
    streams = [np.random.Philox(key=key).jumped(stream) for key in keys]
    return np.array([np.random.Generator(bits) for bits in streams])
