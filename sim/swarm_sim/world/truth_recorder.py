"""Writes what truly happens in a world to the truth file, as it happens."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, Protocol

from swarm_sim.config import SimConfig
from swarm_sim.world.world import World

_DECIMALS = 4
"""Of positions and velocities: a tenth of a millimetre."""


class TruthSink(Protocol):
    """Where the lines go: a file, or what keeps them."""

    def write(self, line: dict[str, Any]) -> None:
        """One object."""

    def close(self) -> None:
        """After the last one."""


class TruthRecorder:
    """Call `after_step` after each step of the world, and `close` at the end.

    `clocked`: the world goes by this computer's clock, and the header says how; else the same seed
    has the same file.
    """

    def __init__(
        self, world: World, config: SimConfig, file: TruthSink, *, clocked: bool = False
    ) -> None:
        self._world = world
        self._file = file
        self._interval_s = 1.0 / config.truth_rate_hz
        self._due_s = world.next_s
        self._written_s = -math.inf
        self._sysids = [vehicle.sysid for vehicle in world.vehicles]
        clock = {"epoch_s": config.epoch_s, "speedup": config.speedup} if clocked else {}
        self._write(
            "header", version=1, origin=config.origin.model_dump(), sysids=self._sysids, **clock
        )

    def after_step(self) -> None:
        """Events at once; states and shrunken pair minima at the configured rate."""
        for event in self._world.events:
            line = {name: x for name, x in asdict(event).items() if x is not None}
            line["t"] = _t(line.pop("time_s"))
            for name in {"impact_mps", "height_m"} & line.keys():
                line[name] = round(line[name], _DECIMALS)
            self._file.write({"type": "event"} | line)
        self._world.events.clear()
        if self._world.time_s >= self._due_s - 1e-6:
            self._due_s += self._interval_s
            self._state()
            self._minima()

    def close(self) -> None:
        """Writes the last state, whatever the rate, the minima and the end line."""
        self.after_step()
        if self._world.time_s > self._written_s:
            self._state()
        self._minima()
        self._write("end")
        self._file.close()

    def _state(self) -> None:
        world = self._world
        self._written_s = world.time_s
        self._write(
            "state",
            sysids=self._sysids,
            ned=world.positions().round(_DECIMALS).tolist(),
            vel=world.velocities().round(_DECIMALS).tolist(),
            armed=[int(x) for x in world.armed()],
            airborne=[int(x) for x in world.airborne()],
        )

    def _minima(self) -> None:
        ids = self._sysids
        pairs = [[ids[i], ids[j], round(d, _DECIMALS)] for i, j, d in self._world.pairs.shrunk()]
        if pairs:
            self._write("min", pairs=pairs)

    def _write(self, kind: str, **fields: Any) -> None:
        self._file.write({"type": kind, "t": _t(self._world.time_s)} | fields)


def _t(time_s: float) -> float:
    return round(time_s, 4)
