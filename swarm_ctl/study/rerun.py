"""One row of a study flown again alone: its numbers, its track, and the same mission for a real
run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from rich.table import Table

from swarm_ctl.core.law.swarm_law import NearPairs
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.errors import InputError
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.executor import again
from swarm_ctl.study.parameter_space import LEVELS, Cell
from swarm_ctl.study.rows import Row, read_rows, rows_of, study_of

_ORIGIN = {"lat_deg": -35.363262, "lon_deg": 149.165237, "alt_m": 584}


@dataclass(slots=True)
class Trace:
    """Everything about one mission tick by tick; a `flight.Watch` for a batch whose first mission
    is meant."""

    time_s: list[float] = field(default_factory=list)
    position: list[Floats] = field(default_factory=list)
    """(2, n) each."""
    pairs: list[tuple[float, int, int, float, float, float, int]] = field(default_factory=list)
    """(time, i, j, distance, sigma, D_ub - D_lb, status): how i sees j."""

    def __call__(
        self, time_s: float, place: NDArray[np.intp], position: Floats, near: NearPairs | None
    ) -> None:
        """Take a tick in."""
        if not len(place) or place[0] != 0:
            return
        self.time_s.append(time_s)
        self.position.append(position[..., 0].copy())
        if near is None:
            return
        numbers = near.numbers
        for k in np.flatnonzero(near.mission == 0):
            ends = (int(near.first[k]), int(near.second[k]))
            for side, (i, j) in enumerate((ends, ends[::-1])[: len(numbers.sigma)]):
                gap = float(numbers.d_ub[side, k] - numbers.d_lb[side, k])
                self.pairs.append(
                    (
                        time_s,
                        i,
                        j,
                        float(near.distance[k]),
                        float(numbers.sigma[side, k]),
                        gap,
                        int(numbers.status[side, k]),
                    )
                )

    def positions(self) -> Floats:
        """(T, 2, n) in units."""
        return np.array(self.position)


@dataclass(frozen=True, slots=True)
class Flown:
    """A mission that was flown again."""

    batch: Batch
    row: Row
    before: Row | None
    """The row in the file, where the study has come that far."""
    trace: Trace

    def table(self) -> Table:
        """The row beside what the file has."""
        found = Table("column", "flown again", "in the file")
        for name, value in self.row.items():
            found.add_row(name, str(value), "-" if self.before is None else str(self.before[name]))
        return found


def fly_again(path: Path, row: int) -> Flown:
    """Fly row `row` of the study at `path` again. InputError where the study has no such row."""
    study = study_of(path)
    if row >= study.rows:
        raise InputError(f"--row {row}: {path} has the rows 0 to {study.rows - 1}")
    batch, trace = again(study, row), Trace()
    outcome = fly(batch, trace)
    before = next((found for found in read_rows(path) if found["row"] == row), None)
    return Flown(batch, rows_of(batch, outcome)[0], before, trace)


def write_mission(flown: Flown, path: Path) -> None:
    """The mission as a file for `swarm-ctl run`: starts, slots, law, safety; not delay, loss, wind
    and who dies."""
    batch, cell = flown.batch, flown.batch.cell
    law = cell.law
    document: dict[str, Any] = {
        "version": 1,
        "name": f"row-{batch.row[0]}",
        "origin": _ORIGIN,
        "unit_m": cell.unit_m,
        "tick_s": cell.tick_s,
        "law": {
            "r": law.r,
            "r_out": law.r_out,
            "r_in": law.r_in,
            "kappa": float(batch.kappa[0]),
            "h": float(batch.h[0]),
            "compensation": cell.compensation.value,
        },
        "safety": _safety(cell),
        "agents": [{"id": k + 1, "start": start} for k, start in enumerate(_pairs(batch.starts))],
        "shapes": {"shape": {"kind": "offsets", "offsets": _pairs(batch.slots)}},
        "steps": [
            {"takeoff": {"height_m": 10}},
            {"form": {"shape": "shape", "slots": "fixed", "exchange": cell.safety == "exchange",
                      "tolerance_m": cell.tolerance * cell.unit_m, "settle_s": cell.settle_s,
                      "timeout_s": cell.limit_s}},
            "land",
        ],
        "fleet": {"agents": [{"id": k + 1, "sysid": k + 1, "autopilot": _autopilot(batch)} for k in range(cell.n)]},
    }  # fmt: skip
    path.write_text(yaml.safe_dump(document, sort_keys=False))


def _safety(cell: Cell) -> dict[str, bool]:
    """As the row was flown; slot exchange is a form step's."""
    level = LEVELS.index(cell.safety)
    return {name: level >= LEVELS.index(name) for name in ("filter", "guard", "release", "align")}


def _autopilot(batch: Batch) -> str:
    return "px4" if batch.cell.vehicle == "px4" else "ardupilot"


def _pairs(points: Floats) -> list[list[float]]:
    return [[float(north), float(east)] for north, east in points[..., 0].T]
