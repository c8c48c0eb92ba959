"""Writes what truly happens in a world to the truth file, as it happens."""

from __future__ import annotations

import errno
import itertools
import json
import logging
import math
import os
from dataclasses import asdict
from pathlib import Path
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


log = logging.getLogger(__name__)


class TruthFile:
    """Writes lines to `path` without buffering. A full disk ends the file, not the flight. An older
    file of that name is kept, with a number before its suffix."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file() and path.stat().st_size:
            numbered = (path.with_suffix(f".{k}{path.suffix}") for k in itertools.count(1))
            path.rename(next(each for each in numbered if not each.exists()))
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        self.failure = ""
        """Why it has ended early."""

    def write(self, line: dict[str, Any]) -> None:
        """One object, one line, one system call."""
        if self.failure:
            return
        data = json.dumps(line, separators=(",", ":")).encode() + b"\n"
        try:
            if os.write(self._fd, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            self.failure = error.strerror or str(error)
            log.warning("the truth file ends here: %s; flying on", self.failure)

    def close(self) -> None:
        os.close(self._fd)
