"""What agents hear of each other when news are late and some get lost. Times in ticks, lengths in
units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from swarm_ctl.core.model.arrays import Bools, Floats, keep_missions
from swarm_ctl.core.model.timeouts import lead_s
from swarm_ctl.study.batch.batch import Batch

_DRAWN: Final = 512
"""Agents' ticks whose losses are drawn at once: so many ticks over n."""


@dataclass(frozen=True, slots=True, eq=False)
class HeardStates:
    """What each receiver (n, or 1 where all hear the same) knows of each sender."""

    points: Floats
    """As told, (2, receivers, senders, m)."""
    velocity: Floats
    """Commanded by the senders (2, receivers, senders, m) [units/s]."""
    age_s: Floats
    """(receivers, senders, m)."""
    lead_s: Floats
    """For how long the law carries the points on, (m,)."""

    def carried(self, at_most_s: Floats | float) -> Floats:
        """The points, carried on with the senders' commands for their age, or this long."""
        carried: Floats = self.points + self.velocity * np.minimum(self.age_s, at_most_s)
        return carried


class LossyChannel:
    """Carries (point, command) of each agent to each other one every tick; links lose news
    independently. Silent agents send no more from their tick on.

    Each mission draws its losses from a Philox generator of its own, keyed by seed and row: it
    loses the same news whatever missions it is flown beside.
    """

    def __init__(self, batch: Batch, tick_s: float) -> None:
        self._tick_s = tick_s
        self._delay = np.rint(batch.delay_s / tick_s).astype(np.intp)
        self._loss = batch.loss
        self._lead_s: Floats = lead_s(batch.kappa * batch.h, np.minimum)
        _, n, m = batch.starts.shape
        self._silent_from = batch.silent_from(tick_s)
        self._past = np.zeros((int(self._delay.max()) + 1, 4, n, m))
        self._past[:, :2] = batch.starts
        self._lossy = bool(batch.loss.any())
        links = n if self._lossy else 1
        self._known = np.zeros((4, links, n, m))
        self._known[:2] = batch.starts[:, None]
        self._sent = np.zeros((links, n, m))
        self._random = np.array([_generator(batch.cell.seed, row) for row in batch.row.tolist()])
        self._arrive = np.zeros((max(8, _DRAWN // n), links, n, m), dtype=np.bool_)

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        keep_missions(self, missions, "_delay", "_loss", "_past", "_known", "_sent")
        keep_missions(self, missions, "_silent_from", "_lead_s", "_random", "_arrive")

    def exchange(self, tick: int, points: Floats, velocity: Floats) -> HeardStates:
        """Send `points` and `velocity` [units/s] (2, n, m); what is heard."""
        place = tick % len(self._past)
        self._past[place, :2], self._past[place, 2:] = points, velocity
        # what was sent `delay` ticks ago, by mission
        missions, sent = np.arange(len(self._delay)), tick - self._delay
        arriving = np.moveaxis(self._past[sent % len(self._past), :, :, missions], 0, -1)
        arrives = (sent < self._silent_from)[None]
        if self._lossy:
            place = tick % len(self._arrive)
            if place == 0:
                self._draw()
            arrives = arrives & self._arrive[place]
        self._known = np.where(arrives, arriving[:, None], self._known)
        self._sent = np.where(arrives, sent, self._sent)
        age_s = (tick - self._sent) * self._tick_s
        return HeardStates(self._known[:2], self._known[2:], age_s, self._lead_s)

    def _draw(self) -> None:
        """Which links get the news of the next ticks."""
        drawn = np.empty((len(self._loss), *self._arrive.shape[:-1]), dtype=np.bool_)
        for arrive, loss, random in zip(drawn, self._loss, self._random, strict=True):
            np.greater_equal(random.random(arrive.shape, dtype=np.float32), loss, out=arrive)
        self._arrive = np.ascontiguousarray(np.moveaxis(drawn, 0, -1))


def _generator(seed: int, row: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=np.array([seed, row], dtype=np.uint64)))
