"""Stages of a study's flight one by one, for tests that look between them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from swarm_ctl.core.model.arrays import Complex, Floats
from swarm_ctl.study.batch import flight
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.batch_flight import BatchResult, MissionsFlight
from swarm_ctl.study.batch.compiled import compiled
from swarm_ctl.study.batch.missions import DRAWN, setup_of


def held_alike(one: BatchResult, other: BatchResult, atol: float) -> None:
    """All figures of two flights of the same missions."""
    for field in fields(BatchResult):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        assert np.allclose(ours, theirs, rtol=0.0, atol=atol, equal_nan=True), field.name


class Flown:
    """The missions of a batch, tick by tick."""

    def __init__(self, batch: Batch) -> None:
        self.setup = setup_of(batch)
        self.flight = MissionsFlight(batch, self.setup)
        self.many = self.flight.many
        self.pair, self.agent = self.many.pair, self.many.agent
        self.tick = 0

    def stage(self, stage: int) -> None:
        """One stage of the tick, of all missions."""
        compiled()(self.setup, self.many, self.tick, 1, stage)

    def decide(self) -> None:
        """What is heard in this tick."""
        self.draw()
        self.stage(flight.DECIDE)

    def draw(self) -> None:
        """What is lost and late by chance."""
        if self.tick % DRAWN == 0:
            self.flight.draw(self.flight.flying)

    def end(self) -> None:
        """Vehicles fly, and it is another tick."""
        if self.flight.motion is None:
            self.stage(flight.MOVE)
        else:
            self.flight.motion.move(self.many)
        self.stage(flight.LOOK)
        self.tick += 1

    def steer(self, wish: Complex | complex) -> None:
        """Vehicles alone: a tick of these commands (m, n) [units/s]."""
        self.agent["wish"] = wish
        for agents, sent in zip(self.agent, self.many.sent, strict=True):
            for a, ring in zip(agents, sent, strict=True):
                flight.command(self.setup, a, ring)
        if self.flight.motion is None:
            self.stage(flight.MOVE)
        else:
            self.flight.motion.move(self.many)
        self.tick += 1

    def hear(self, points: Floats, velocity: Floats | float = 0.0) -> None:
        """The channel alone: agents that are at `points` (2, n, m) tell these, and a velocity
        [units/s]."""
        self.draw()
        flies = np.broadcast_to(velocity, points.shape)
        self.agent["point"] = (points[0] + 1j * points[1]).T
        self.agent["command"] = (flies[0] + 1j * flies[1]).T * self.setup.unit_m
        m = self.many
        for k, whole in enumerate(m.whole):
            known = (m.agent[k], m.pair[k], m.past[k], m.losses[k], m.jitter[k], m.newest[k])
            flight.listen(self.setup, whole, *known, self.tick)
        self.tick += 1

    def look_around(self, tick: int) -> None:
        """Agents choose who is near."""
        for k, agents in enumerate(self.agent):
            flight.look_around(self.setup, agents, self.pair[k], self.many.said[k], tick)

    @property
    def told(self) -> Any:
        """Points as they were told last (m, n, n), by (receiver, sender)."""
        return self.pair["told"]

    @property
    def age(self) -> Any:
        """Of what was told [ticks], as it counted in the last tick."""
        return self.tick - 1 - self.pair["sent_at"]
