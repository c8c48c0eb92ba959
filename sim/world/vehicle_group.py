"""The vehicles that move alike: one response, one array pass a step. No sockets, no clock."""

from __future__ import annotations

from sim.firmware.flying.maneuvers import Demand, Sensed
from sim.physics.geodesy import Vector3
from sim.physics.vehicle import Array, Demands, Response, State, advance

STILL: Vector3 = (0.0, 0.0, 0.0)


class Group:
    """State and demands of some vehicles, each a row."""

    def __init__(self, response: Response, position: Array, heading: Array) -> None:
        self.response = response
        self.state = State.at_rest(position, response, heading)
        self.demands = Demands.idle(self.state)
        self._rows: list[Sensed] | None = None

    def step(self, dt: float) -> None:
        """Physics of the whole group."""
        advance(self.state, self.demands, self.response, dt)
        self._rows = None

    def sense(self, row: int) -> Sensed:
        """What vehicle `row` feels; worked out for all rows at once, when the first one asks."""
        if self._rows is None:
            self._rows = self._sense()
        return self._rows[row]

    def _sense(self) -> list[Sensed]:
        s = self.state
        thrust = s.memory[:, -1] if self.response.memory_rows else s.acceleration
        columns = (
            s.position.tolist(),
            s.velocity.tolist(),
            thrust.tolist(),
            s.heading.tolist(),
            s.landed.tolist(),
        )
        return [
            Sensed(tuple(p), tuple(v), tuple(a), h, on)
            for p, v, a, h, on in zip(*columns, strict=True)
        ]

    def obey(
        self, row: int, demand: Demand, before: Demand | None, offset: Vector3 = STILL
    ) -> None:
        """Takes over what differs from the demand `before`; positions are wanted `offset` away from
        where they are."""
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
            d.speed[row], d.climb[row], d.descent[row] = (
                demand.speed_mps,
                demand.climb_mps,
                demand.descent_mps,
            )
            d.heading[row], d.lift[row] = demand.heading_rad, demand.lift
