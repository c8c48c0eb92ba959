"""The vehicles that move alike: one response, one array pass a step. Pure."""

from __future__ import annotations

from swarm_sim.firmware.flying.maneuvers import STILL, Demand, Sensed
from swarm_sim.physics.geodesy import Vector3
from swarm_sim.physics.kinematics import Array, Demands, MotionState, VelocityResponse, advance


class VehicleGroup:
    """State and demands of some vehicles, each a row."""

    def __init__(self, response: VelocityResponse, position: Array, heading: Array) -> None:
        self.response = response
        self.state = MotionState.at_rest(position, response, heading)
        self.demands = Demands.idle(self.state)
        self._rows: list[Sensed] | None = None

    def step(self, dt: float) -> None:
        """Physics of the whole group."""
        advance(self.state, self.demands, self.response, dt)
        self._rows = None

    def sense(self, row: int) -> Sensed:
        """What vehicle `row` feels; worked out for all rows when it is first asked for."""
        if self._rows is None:
            self._rows = self._sense()
        return self._rows[row]

    def _sense(self) -> list[Sensed]:
        s = self.state
        thrust = s.memory[:, -1] if self.response.memory_rows else s.acceleration
        # plain Python numbers, much faster to read one by one than numpy's
        arrays = (s.position, s.velocity, thrust, s.heading, s.landed)
        columns = (array.tolist() for array in arrays)
        return [
            Sensed(tuple(p), tuple(v), tuple(a), h, on)
            for p, v, a, h, on in zip(*columns, strict=True)
        ]

    def obey(
        self, row: int, demand: Demand, before: Demand | None, offset: Vector3 = STILL
    ) -> None:
        """Takes over what differs from the demand `before`, whose positions are those reported:
        `offset` more than the true ones."""
        d = self.demands
        if before is None or demand.velocity_ned_mps != before.velocity_ned_mps:
            d.velocity[row] = demand.velocity_ned_mps
        if before is None or demand.position_ned_m != before.position_ned_m or offset != STILL:
            wanted = demand.position_ned_m
            d.position[row] = [
                0.0 if p is None else p - o for p, o in zip(wanted, offset, strict=True)
            ]
            d.hold[row] = [p is not None for p in wanted]
        if before is None or demand[2:] != before[2:]:
            d.speed[row], d.climb[row], d.descent[row], d.heading[row], d.lift[row] = demand[2:]
