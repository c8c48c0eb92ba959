"""One row of a study flown again alone: its numbers, its track, and the same mission for a real
run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.table import Table

from swarm_ctl.core.kernel.law import STATUSES
from swarm_ctl.core.model.arrays import Floats, Indices
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.errors import InputError
from swarm_ctl.files import named
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.executor import batch_of_row
from swarm_ctl.study.parameter_space import LEVELS, Cell, Study
from swarm_ctl.study.rows import Row, has_rows, read_rows, rows_of, study_of

_ORIGIN = {"lat_deg": -35.363262, "lon_deg": 149.165237, "alt_m": 584}


@dataclass(slots=True)
class Trace:
    """The first mission of a batch, tick by tick; a `TickObserver`."""

    time_s: list[float] = field(default_factory=list)
    position: list[Floats] = field(default_factory=list)
    """(2, n) each."""
    pairs: list[tuple[float, int, int, float, float, float, int]] = field(default_factory=list)
    """(time, i, j, distance, sigma, D_ub - D_lb, status): how i sees j."""

    def __call__(self, time_s: float, place: Indices, position: Floats, pairs: Floats) -> None:
        """Take a tick in."""
        if not len(place) or place[0] != 0:
            return
        self.time_s.append(time_s)
        self.position.append(position[..., 0].copy())
        for i, j in np.argwhere(pairs[0, ..., 0] > 0.0).tolist():
            distance, sigma, _, _, gap, status = pairs[0, i, j].tolist()
            self.pairs.append((time_s, i, j, distance, sigma, gap, int(status)))

    def positions(self) -> Floats:
        """(T, 2, n) in units."""
        return np.array(self.position)

    def statuses(self) -> dict[str, int]:
        """How often each sigma status was given."""
        given = [status for *_, status in self.pairs]
        return {name: given.count(k) for k, name in enumerate(STATUSES)}

    def busiest(self) -> tuple[int, ...]:
        """The three agents with most pair-ticks."""
        counts = np.bincount([i for _, i, *_ in self.pairs] or [0])
        return tuple(sorted(int(i) for i in np.argsort(-counts, kind="stable")[:3]))


@dataclass(frozen=True, slots=True)
class Rerun:
    """A mission that was flown again."""

    batch: Batch
    row: Row
    before: Row | None
    """The row in the file; None where the study has not come that far."""
    trace: Trace

    def table(self) -> Table:
        """The row; beside what the file has, where that is another value."""
        there = self.before or {}
        other = {name for name in there if str(there[name]) != str(self.row[name])}
        found = Table("column", "flown again", *(("in the file",) if other else ()))
        for name, value in self.row.items():
            beside = str(there.get(name, "-")) if name in other else ""
            found.add_row(name, str(value), *((beside,) if other else ()))
        if there and not other:
            found.caption = "every value is the file's"
        return found


def rerun(path: Path, row: int, study: Study | None = None) -> Rerun:
    """Fly row `row` of the study at `path` again, or of `study`, whether `path` has its rows or is
    not there. InputError where the study has no such row, or `path` has another one's."""
    study = study or study_of(path)
    there = has_rows(path, study)
    if row >= study.rows:
        raise InputError(f"--row {row}: the study has the rows 0 to {study.rows - 1}")
    batch, trace = batch_of_row(study, row), Trace()
    flown = fly(batch, trace)
    rows = read_rows(path) if there else iter(())
    before = next((found for found in rows if found["row"] == row), None)
    return Rerun(batch, rows_of(batch, flown)[0], before, trace)


def write_mission(flown: Rerun, path: Path, form_begins_s: Callable[[Path], float]) -> list[str]:
    """The mission as a file for `swarm-ctl run`: a scenario where states were lost or late, or
    agents died. `form_begins_s` says of a mission's file when its form step begins [s]: deaths are
    counted from there. Returns what the row flew and the file cannot carry, by name and value."""
    batch, mission = flown.batch, _mission(flown)
    with named(path):
        path.write_text(yaml.safe_dump(mission, sort_keys=False))
    mesh = {name: float(getattr(batch, name)[0]) for name in ("loss", "jitter_s")}
    if len(delays := set(batch.delay_s[:, 0].tolist())) == 1:
        mesh["delay_s"] = delays.pop()
    mesh = {name: number for name, number in mesh.items() if number > 0.0}
    silent_s = {k: float(s) for k, s in enumerate(batch.silent_s[:, 0], start=1) if np.isfinite(s)}
    if mesh or silent_s:
        from_s = form_begins_s(path) if silent_s else 0.0
        deaths = [{"at_s": round(from_s + s, 3), "kill": [k]} for k, s in silent_s.items()]
        scenario = {"version": 1, "name": mission["name"], "mission": mission}
        scenario |= {"mesh": mesh} if mesh else {}
        scenario |= {"happens": deaths} if deaths else {}
        with named(path):
            path.write_text(yaml.safe_dump(scenario, sort_keys=False))
    return list(_not_carried(batch))


def _mission(flown: Rerun) -> dict[str, Any]:
    """Of the row, without what befell its mesh and its agents."""
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
            "delta_l": law.delta_l,
            "delta_a": law.delta_a,
        }
        | _own_law(law),
        "vehicle": {"limits": {"speed_mps": cell.speed_mps}},
        "safety": _safety(cell),
        "policies": {"agent_lost": "continue"},
        "agents": [{"id": k + 1, "start": start} for k, start in enumerate(_pairs(batch.starts))],
        "shapes": {"shape": {"kind": "offsets", "offsets": _pairs(batch.slots)}},
        "steps": [{"takeoff": {"height_m": 10}}, {"form": _form_step(cell)}, "land"],
        "fleet": {"agents": [_vehicle(k, batch) for k in range(cell.n)]},
    }
    if (wood := batch.woods[0]) is not None:
        trunks = zip(wood.at.tolist(), wood.radius.tolist(), strict=True)
        document["zones"] = {
            f"trunk-{k}": {"circle": [at.real, at.imag], "radius": radius}
            for k, (at, radius) in enumerate(trunks)
        }
        to = [wood.goal.real, wood.goal.imag]
        document["steps"].insert(2, {"move": {"to": to, "settle_s": cell.settle_s}})
    if batch.wind_mps[0]:
        from_deg = float(np.degrees(batch.wind_from_rad[0]))
        wind = {"SIM_WIND_SPD": float(batch.wind_mps[0]), "SIM_WIND_DIR": from_deg}
        document["simulation"] = {"parameters": wind}
    return document


def _own_law(law: LawParameters) -> dict[str, Any]:
    if not law.own:
        return {}
    numbers = {each.name: each.value for each in law.parameters}
    return {"own": law.own.partition("@")[0]} | ({"parameters": numbers} if numbers else {})


def _not_carried(batch: Batch) -> Iterator[str]:
    delay_s = batch.delay_s[:, 0]
    if delay_s.min() < delay_s.max():
        yield f"delay_s {_ends(delay_s)}, of each agent its own"
    if batch.cell.vehicle in AUTOPILOT_KINDS and (late_s := batch.late_s[:, 0]).any():
        yield f"late_s {_ends(late_s)}"
    if batch.woods[0] is not None:
        yield "a move in file whatever room there is (where all have a way together, they take it)"
    if (burst_s := float(batch.burst_s[0])) > 0:
        yield f"burst_s {burst_s:.3g}"
    if batch.cell.vehicle == "ideal":
        yield "vehicles that answer at once (simulated ArduCopters fly instead)"


def _ends(values: Floats) -> str:
    least, most = f"{values.min():.3g}", f"{values.max():.3g}"
    return least if least == most else f"{least} to {most}"


def _safety(cell: Cell) -> dict[str, bool]:
    """As the row was flown, but slot exchange: that is the form step's."""
    return {level: cell.has(level) for level in LEVELS if level not in ("off", "exchange")}


def _form_step(cell: Cell) -> dict[str, Any]:
    slots = {"shape": "shape", "slots": "fixed", "exchange": cell.has("exchange")}
    tolerance_m = cell.tolerance * cell.unit_m
    return slots | {
        "tolerance_m": tolerance_m,
        "settle_s": cell.settle_s,
        "timeout_s": cell.limit_s,
    }


def _vehicle(k: int, batch: Batch) -> dict[str, Any]:
    """What the agent believes of its vehicle, and what that truly does."""
    cell = batch.cell
    entry = {"id": k + 1, "sysid": k + 1, "response": asdict(cell.model)}
    if cell.vehicle == "lag":
        true = {
            "dead_time_s": float(batch.true_dead_time_s[k, 0]),
            "lag_s": float(batch.true_lag_s[k, 0]),
            "acceleration_mps2": float(batch.acceleration_mps2[k, 0]),
        }
        return entry | {"autopilot": "ardupilot", "simulated_response": true}
    return entry | {"autopilot": "px4" if cell.vehicle == "px4" else "ardupilot"}


def _pairs(points: Floats) -> list[list[float]]:
    return [[float(north), float(east)] for north, east in points[..., 0].T]
