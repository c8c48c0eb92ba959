"""What agents hear of each other when news are late and some get lost. Times in ticks, lengths in units."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.freshness import PREDICT_S
from swarm_ctl.study.batch import Batch, Floats

_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB), np.uint64(0x9E3779B97F4A7C15))


class News:
    """Each agent sends (point, velocity) every tick; every link loses news on its own.

    Loss comes from a hash of (seed, row, tick, link) and not from a generator: a mission loses the same news whatever
    it is flown beside. News older than `PREDICT_S` are carried on by that long only, as the agents do.
    """

    def __init__(self, batch: Batch, tick_s: float, carry_on: bool) -> None:
        self._tick_s, self._carry_on = tick_s, carry_on
        self._delay = np.rint(batch.delay_s / tick_s).astype(np.intp)
        self._loss = batch.loss
        self._row = batch.row.astype(np.uint64)
        self._seed = np.uint64(batch.cell.seed)
        _, n, m = batch.starts.shape
        self._past = np.zeros((int(self._delay.max()) + 1, 4, n, m))
        self._past[:, :2] = batch.starts
        self._lossy = bool(batch.loss.any())
        links = n if self._lossy else 1
        self._known = np.zeros((4, links, n, m))
        self._known[:2] = batch.starts[:, None]
        self._sent = np.zeros((links, n, m))

    def only(self, missions: NDArray[np.bool_]) -> None:
        """Go on with some of the missions."""
        for name in ("_delay", "_loss", "_row", "_past", "_known", "_sent"):
            setattr(self, name, getattr(self, name)[..., missions])

    def exchange(self, tick: int, points: Floats, velocity: Floats) -> Floats:
        """Send `points` and `velocity` [units/s] (2, n, m); what is heard: (2, receivers or 1, senders, m)."""
        place = tick % len(self._past)
        self._past[place, :2], self._past[place, 2:] = points, velocity
        missions = np.arange(len(self._delay))
        arriving = np.moveaxis(self._past[(tick - self._delay) % len(self._past), :, :, missions], 0, -1)
        sent = tick - self._delay
        if self._lossy:
            arrives = self._arrives(tick)
            self._known = np.where(arrives, arriving[:, None], self._known)
            self._sent = np.where(arrives, sent, self._sent)
        else:
            self._known, self._sent = arriving[:, None], np.broadcast_to(sent, (1, 1, len(sent)))
        if not self._carry_on:
            return self._known[:2]
        ahead = np.minimum((tick - self._sent) * self._tick_s, PREDICT_S)
        heard: Floats = self._known[:2] + self._known[2:] * ahead
        return heard

    def _arrives(self, tick: int) -> NDArray[np.bool_]:
        """Which links (n, n, m) get this tick's news: splitmix64 of all that names it, as a share of 1."""
        _, n, _, _ = self._known.shape
        link = np.arange(n * n, dtype=np.uint64).reshape(n, n, 1)
        z = (self._row * _MIX[2] ^ self._seed * _MIX[0]) + (link << np.uint64(32)) + np.uint64(tick + 1)
        for shift, factor in ((30, _MIX[0]), (27, _MIX[1]), (30, _MIX[0]), (27, _MIX[1])):
            z = (z ^ (z >> np.uint64(shift))) * factor
        z ^= z >> np.uint64(31)
        return (z >> np.uint64(11)) * 2.0**-53 >= self._loss
