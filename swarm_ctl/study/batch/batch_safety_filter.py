"""The safety of `core.safety.constraints` and `core.safety.deadlock` for whole batches. Lengths in
units, speeds in units/s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.law import mean_error_feedback
from swarm_ctl.core.law.swarm_law import SwarmLaw
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S, PREDICT_S, SILENT_FLIES_S
from swarm_ctl.core.safety import constraints, deadlock
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.deadlock import swirled
from swarm_ctl.core.safety.velocity_qp import UNBOUND, relaxed_many
from swarm_ctl.study.batch.batch import Batch, Bools, Floats
from swarm_ctl.study.batch.batch_slot_exchange import BatchSlotExchange
from swarm_ctl.study.batch.lossy_channel import Told
from swarm_ctl.study.parameter_space import LEVELS, Safety

Complex: TypeAlias = NDArray[np.complex128]


@dataclass(slots=True, eq=False)
class Counts:
    """Agent-ticks by mission, (m,) each."""

    flown: Floats
    touched: Floats
    """The filter changed the wish."""
    yielded: Floats
    """The keep-outs excluded each other."""


class BatchSafetyFilter:
    """Between the law's wish and the vehicles."""

    def __init__(self, batch: Batch) -> None:
        cell = batch.cell
        _, n, m = batch.starts.shape
        self._level = LEVELS.index(cell.safety)
        self._tick_s = cell.tick_s
        self._speed = cell.speed_mps / cell.unit_m
        self.margins = Margins.of(cell.law, cell.model, self._speed)
        self._r_out = cell.law.r_out
        self._release = (
            _BatchDeadlockRelease((n, m), self._speed, cell.tick_s) if self._on("release") else None
        )
        self._row = batch.row
        self.counts = Counts(np.zeros(m), np.zeros(m), np.zeros(m))
        self.dealing = BatchSlotExchange(batch) if self._on("exchange") else None

    def _on(self, level: Safety) -> bool:
        return self._level >= LEVELS.index(level)

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        for part in (self._release, self.dealing):
            if part is not None:
                part.only(missions)
        self._row = self._row[missions]
        counts = self.counts
        self.counts = Counts(
            counts.flown[missions], counts.touched[missions], counts.yielded[missions]
        )

    def velocity(
        self, law: SwarmLaw, kappa: Floats, points: Floats, told: Told, slots: Floats, talks: Bools
    ) -> Floats:
        """What is commanded instead of the law's wish (its last step's terms times `kappa`), (2, n,
        m)."""
        consensus, avoidance = _complex(law.consensus) * kappa, _complex(law.avoidance) * kappa
        own, told_points, told_speed = (
            _complex(points),
            _complex(told.points),
            _complex(told.velocity),
        )
        apart = own[:, None] - told_points
        distance = np.abs(apart)
        lost = (told.age_s > FRESH_S) & np.ones_like(distance, dtype=np.bool_)
        itself = np.arange(len(own))
        distance[itself, itself] = np.inf
        if self._on("align"):
            consensus = consensus + self._aligned(own, told, slots, lost)
        if self._on("release"):
            unheard = (lost & (distance < self._r_out + deadlock.SWIRL_OFF)).any(axis=1)
            avoidance = np.where(unheard, avoidance, swirled(consensus, avoidance))
        wish = _limited(consensus + avoidance, self._speed)
        if self._release is not None:
            wish = self._release.turn(wish, consensus, self._dice(self._release.fails))
        flown = self._filtered(
            wish, apart, told_speed, told.age_s, distance, lost, law, slots, talks
        )
        if self._release is not None:
            self._release.note(consensus, flown)
        return np.stack((flown.real, flown.imag))

    def _aligned(self, own: Complex, told: Told, slots: Floats, lost: Bools) -> Complex:
        """The pull to the average of all who are heard."""
        z = _complex(slots)
        told_z = _complex(self.dealing.told_slots) if self.dealing is not None else z[None]
        counted = ~lost
        counted[np.arange(len(own)), np.arange(len(own))] = False
        return mean_error_feedback.pull(own - z, _complex(told.carried()) - told_z, counted, axis=1)

    def _filtered(
        self,
        wish: Complex,
        apart: Complex,
        commanded: Complex,
        age_s: Floats,
        distance: Floats,
        lost: Bools,
        law: SwarmLaw,
        slots: Floats,
        talks: Bools,
    ) -> Complex:
        margins, n = self.margins, len(wish)
        reach = margins.keep_out + margins.reach
        near = distance < np.where(
            lost, reach + 3 * margins.growth + self._speed * (SILENT_FLIES_S + 1), reach + 0.5
        )
        i, j, mission = np.nonzero(near)
        agent = i * wish.shape[1] + mission
        receiver = i if commanded.shape[0] > 1 else np.zeros_like(i)
        age = np.broadcast_to(age_s, (commanded.shape[0], *age_s.shape[1:]))[receiver, j, mission]
        gone = lost[i, j, mission]
        normal, bound, room = constraints.half_plane(
            apart[i, j, mission],
            commanded[receiver, j, mission],
            np.where(gone, SILENT_FLIES_S, age),
            margins.out(age, np.minimum),
            np.where(gone, 1.0, 0.5),
            self._speed,
            np.minimum,
            np.maximum,
        )
        nearest_room = np.full(wish.size, np.inf)
        np.minimum.at(nearest_room, agent, room)
        cap = constraints.cap(nearest_room, margins, np.maximum, np.minimum)
        soft = np.zeros(len(agent), dtype=np.bool_)
        if self._on("guard"):
            a, b, c = self._guards(apart, distance, commanded, age_s, law, slots)
            agent, normal = np.concatenate((agent, a)), np.concatenate((normal, b))
            bound, soft = (
                np.concatenate((bound, c)),
                np.concatenate((soft, np.ones(len(a), dtype=np.bool_))),
            )
        flown, touched, yielded = _solved(wish.ravel(), agent, normal, bound, soft, cap)
        counts = self.counts
        counts.flown += np.count_nonzero(talks, axis=0)
        counts.touched += np.count_nonzero(touched.reshape(n, -1) & talks, axis=0)
        counts.yielded += np.count_nonzero(yielded.reshape(n, -1) & talks, axis=0)
        return flown.reshape(wish.shape)

    def _guards(
        self,
        apart: Complex,
        distance: Floats,
        commanded: Complex,
        age_s: Floats,
        law: SwarmLaw,
        slots: Floats,
    ) -> tuple[NDArray[np.intp], Complex, Floats]:
        z = _complex(slots)
        slot_gap = np.abs(z[:, None] - z)
        # far from its end a link forbids nothing
        far = distance > constraints.guards_from(self.margins) - self._speed * PREDICT_S
        minded = law.links & far & (age_s <= NEIGHBOUR_S)
        if self._release is not None:
            minded &= ~(
                self._release.releasing[:, None] & constraints.tight(slot_gap, self.margins)
            )
        i, j, mission = np.nonzero(minded)
        receiver = i if commanded.shape[0] > 1 else np.zeros_like(i)
        age = np.broadcast_to(age_s, (commanded.shape[0], *age_s.shape[1:]))[receiver, j, mission]
        now = apart[i, j, mission] - commanded[receiver, j, mission] * np.minimum(age, PREDICT_S)
        minded = constraints.guarded(slot_gap[i, j, mission], np.abs(now), self.margins)
        i, j, mission, receiver, now = (
            i[minded],
            j[minded],
            mission[minded],
            receiver[minded],
            now[minded],
        )
        normal, bound = constraints.guard_plane(
            now, commanded[receiver, j, mission], self.margins, np.minimum, np.maximum
        )
        return i * distance.shape[-1] + mission, normal, bound

    def _dice(self, fails: Floats) -> Floats:
        """Two numbers in 0..1 for each agent and number of fails, whatever it is flown beside."""
        agent = np.arange(fails.shape[0])[:, None]
        seed = self._row * 7919.0 + agent * 104729.0 + fails * 1299709.0
        return np.stack([np.modf(np.abs(np.sin(seed + k) * 43758.5453))[0] for k in (0.0, 0.5)])


def _solved(
    wish: Complex, agent: NDArray[np.intp], normal: Complex, bound: Floats, soft: Bools, cap: Floats
) -> tuple[Complex, Bools, Bools]:
    """The program of each agent that has something to obey; agent-wise arrays (A,), plane-wise ones
    (K,)."""
    violated = (normal.real * wish.real[agent] + normal.imag * wish.imag[agent]) < bound - 1e-9
    busy = np.zeros(len(wish), dtype=np.bool_)
    busy[agent[violated]] = True
    busy |= np.abs(wish) > cap + 1e-9
    flown, yielded = wish.copy(), np.zeros(len(wish), dtype=np.bool_)
    if not busy.any():
        return flown, busy, yielded
    keep = busy[agent]
    agent, normal, bound, soft = agent[keep], normal[keep], bound[keep], soft[keep]
    order = np.argsort(agent, kind="stable")
    agent, normal, bound, soft = agent[order], normal[order], bound[order], soft[order]
    who = np.flatnonzero(busy)
    column = np.searchsorted(who, agent)
    first = np.searchsorted(agent, who)
    rank = np.arange(len(agent)) - first[column]
    size = int(rank.max(initial=-1)) + 1
    normals, bounds = np.zeros((size, 2, len(who))), np.full((size, len(who)), UNBOUND)
    normals[:, 0] = 1.0
    is_soft = np.zeros((size, len(who)), dtype=np.bool_)
    normals[rank, 0, column], normals[rank, 1, column] = normal.real, normal.imag
    bounds[rank, column], is_soft[rank, column] = bound, soft
    v, slack = relaxed_many(
        np.stack((wish[who].real, wish[who].imag)), normals, bounds, is_soft, cap[who]
    )
    flown[who] = v[0] + 1j * v[1]
    yielded[who] = slack > 0
    return flown, busy, yielded


def _complex(vectors: Floats) -> Complex:
    combined: Complex = vectors[0] + 1j * vectors[1]
    return combined


def _limited(wish: Complex, speed: float) -> Complex:
    limited: Complex = wish * (speed / np.maximum(np.abs(wish), speed))
    return limited


class _BatchDeadlockRelease:
    """`core.safety.deadlock.Release` for arrays (n, m) of agents."""

    def __init__(self, shape: tuple[int, ...], speed: float, tick_s: float) -> None:
        self._speed, self._tick_s = speed, tick_s
        self._wanted, self._got = np.zeros(shape), np.zeros(shape)
        self._left_s, self._side = np.zeros(shape), np.ones(shape, dtype=np.complex128)
        self.fails = np.zeros(shape)

    def only(self, chosen: Bools) -> None:
        """Go on with some of the missions."""
        for name in ("_wanted", "_got", "_left_s", "_side", "fails"):
            setattr(self, name, getattr(self, name)[..., chosen])

    @property
    def releasing(self) -> Bools:
        """Who goes sideways just now."""
        going: Bools = self._left_s > 0.0
        return going

    def turn(self, wish: Complex, consensus: Complex, dice: Floats) -> Complex:
        """As `Release.turn`; `dice` (2, n, m) is looked at where one begins."""
        pull = np.abs(consensus)
        stuck = (self._left_s <= 0.0) & (self._wanted > deadlock.WANTS * self._speed)
        stuck &= self._got < deadlock.GETS * self._wanted
        if stuck.any():
            lasts = (deadlock.AVERAGE_S + np.minimum(self.fails, deadlock.LONGER_S)) * (
                0.7 + 0.6 * dice[0]
            )
            other = (self.fails >= deadlock.OTHER_SIDE[0]) & (dice[1] < deadlock.OTHER_SIDE[1])
            self._left_s = np.where(stuck, lasts, self._left_s)
            self._side = np.where(
                stuck, np.where(other, deadlock.SIDEWAYS.conjugate(), deadlock.SIDEWAYS), self._side
            )
            self.fails = self.fails + stuck
            self._wanted, self._got = (
                np.where(stuck, 0.0, self._wanted),
                np.where(stuck, 0.0, self._got),
            )
        releasing = self._left_s > 0.0
        self._left_s = self._left_s - self._tick_s * releasing
        size = np.maximum(0.2 * self._speed, np.minimum(pull, 0.5 * self._speed))
        away = consensus / np.maximum(pull, 1e-300) * size * self._side
        return np.where(releasing & (pull > 0.0), away, wish)

    def note(self, consensus: Complex, flown: Complex) -> None:
        """As `Release.note`."""
        pull = np.abs(consensus)
        share = self._tick_s / deadlock.AVERAGE_S * ((self._left_s <= 0.0) & (pull > 0.0))
        along = (flown * np.conjugate(consensus)).real / np.maximum(pull, 1e-300)
        self._wanted = self._wanted + share * (np.minimum(pull, self._speed) - self._wanted)
        self._got = self._got + share * (along - self._got)
