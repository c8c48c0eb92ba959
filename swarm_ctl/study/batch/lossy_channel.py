"""What agents hear of each other when news are late and some get lost. Times in ticks, lengths in
units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.timeouts import lead_s
from swarm_ctl.study.batch.batch import Batch, Bools, Floats

_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB), np.uint64(0x9E3779B97F4A7C15))


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What each receiver (n, or 1 where all hear the same) knows of each sender."""

    points: Floats
    """As told, (2, receivers, senders, m)."""
    velocity: Floats
    """Their commands [units/s]."""
    age_s: Floats
    """(receivers, senders, m)."""
    lead_s: Floats
    """For how long the law carries the points on, (m,)."""

    def carried(self) -> Floats:
        """The points, carried on with the commands for as long as the agents do."""
        carried: Floats = self.points + self.velocity * np.minimum(self.age_s, self.lead_s)
        return carried


class News:
    """Each agent sends (point, velocity) every tick; every link loses news on its own.

    Loss comes from a hash of (seed, row, tick, link) and not from a generator: a mission loses the
    same news whatever it is flown beside. Silent agents send no more from their tick on.
    """

    def __init__(self, batch: Batch, tick_s: float) -> None:
        self._tick_s = tick_s
        self._delay = np.rint(batch.delay_s / tick_s).astype(np.intp)
        self._loss = batch.loss
        self._lead_s: Floats = lead_s(batch.kappa * batch.h, np.minimum)
        self._row = batch.row.astype(np.uint64)
        self._seed = np.array(
            [batch.cell.seed], dtype=np.uint64
        )  # arrays wrap around, scalars warn
        _, n, m = batch.starts.shape
        self._silent_from = batch.silent_from(tick_s)
        self._past = np.zeros((int(self._delay.max()) + 1, 4, n, m))
        self._past[:, :2] = batch.starts
        self._lossy = bool(batch.loss.any())
        links = n if self._lossy else 1
        self._known = np.zeros((4, links, n, m))
        self._known[:2] = batch.starts[:, None]
        self._sent = np.zeros((links, n, m))

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        for name in (
            "_delay",
            "_loss",
            "_row",
            "_past",
            "_known",
            "_sent",
            "_silent_from",
            "_lead_s",
        ):
            setattr(self, name, getattr(self, name)[..., missions])

    def exchange(self, tick: int, points: Floats, velocity: Floats) -> Told:
        """Send `points` and `velocity` [units/s] (2, n, m); what is heard."""
        place = tick % len(self._past)
        self._past[place, :2], self._past[place, 2:] = points, velocity
        missions = np.arange(len(self._delay))
        arriving = np.moveaxis(
            self._past[(tick - self._delay) % len(self._past), :, :, missions], 0, -1
        )
        sent = tick - self._delay
        arrives = (sent < self._silent_from)[None]
        if self._lossy:
            arrives = arrives & self._arrives(tick)
        self._known = np.where(arrives, arriving[:, None], self._known)
        self._sent = np.where(arrives, sent, self._sent)
        return Told(
            self._known[:2], self._known[2:], (tick - self._sent) * self._tick_s, self._lead_s
        )

    def _arrives(self, tick: int) -> NDArray[np.bool_]:
        """Which links (n, n, m) get this tick's news: splitmix64 of all that names it, as a share
        of 1."""
        _, n, _, _ = self._known.shape
        link = np.arange(n * n, dtype=np.uint64).reshape(n, n, 1)
        z = (
            (self._row * _MIX[2] ^ self._seed * _MIX[0])
            + (link << np.uint64(32))
            + np.uint64(tick + 1)
        )
        for shift, factor in ((30, _MIX[0]), (27, _MIX[1]), (30, _MIX[0]), (27, _MIX[1])):
            z = (z ^ (z >> np.uint64(shift))) * factor
        z ^= z >> np.uint64(31)
        arrives: NDArray[np.bool_] = (z >> np.uint64(11)) * 2.0**-53 >= self._loss
        return arrives
