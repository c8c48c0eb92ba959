"""Missions drawn for one block of a study, from the block's number: all that is random but lost
news.

A block is flown as one batch. Its size depends on n alone, so a row is the same for any number of
processes, and it can be drawn again alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.law.formation import centred
from swarm_ctl.core.model.arrays import Bools, Floats, Indices, Ints, complex_of
from swarm_ctl.errors import InputError
from swarm_ctl.mission.geometry.shapes import slots_of
from swarm_ctl.mission.sections import shape_sections
from swarm_ctl.slot_assignment import nearest
from swarm_ctl.study.batch.woods import grow
from swarm_ctl.study.parameter_space import (
    AGENT_RANGES,
    FIRST_RANGES,
    LATER_RANGES,
    RANGES,
    WOOD_RANGES,
    Cell,
    Range,
    Study,
)

_BLOCK_AGENTS: Final = 12288
"""Agents per block: enough for numpy to be quick, few enough for a core's cache."""
_TRIES: Final = 2000
_JITTER: Final = 0.05
"""Of the spacing: what keeps the missions that start on a shape apart."""
_DIES_BY_S: Final = 20.0
_FACING: Final = 1.5
"""Between the two columns of a crossing, in spacings."""
_LEAST_LAG_S: Final = 1e-3
OPPOSITE: Final = ("crossing", "antipodal")
TABLE_II: Final = ((14, 16), (12, 12), (10, 18), (6, 12), (6, 16), (14, 10))


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """m missions of one cell, on the last axis. Lengths in units, north and east."""

    cell: Cell
    row: Ints
    """Number in the study; all others (m,) by mission, too, unless they say more."""
    starts: Floats
    """(2, n, m)."""
    slots: Floats
    """(2, n, m)."""
    links: Bools
    """(n, n, m)."""
    h: Floats
    kappa: Floats
    lag_s: Floats
    """(n, m), by vehicle or sender, as are the next five."""
    dead_time_s: Floats
    late_s: Floats
    lag_error_s: Floats
    acceleration_mps2: Floats
    delay_s: Floats
    jitter_s: Floats
    loss: Floats
    burst_s: Floats
    wind_mps: Floats
    area: Floats
    spacing: Floats
    silent: Floats
    wind_from_rad: Floats
    silent_agents: Ints
    """How many agents' processes die."""
    silent_s: Floats
    """When each does, (n, m); infinity for most."""
    trunks: Floats
    trunk: Floats
    gap: Floats
    woods: NDArray[Any]
    """Each mission's `Wood`; None without one."""

    def silent_from(self, tick_s: float) -> Floats:
        """The tick from which each agent is silent, (n, m)."""
        return np.rint(self.silent_s / tick_s)

    @property
    def flown_h(self) -> Floats:
        """The gain `h` as agents fly it: less where their model is too slow for it (m,)."""
        return np.minimum(self.h, self.cell.model.most_rate / self.kappa)

    @property
    def true_lag_s(self) -> Floats:
        """With its error (n, m)."""
        return np.maximum(self.lag_s + self.lag_error_s, _LEAST_LAG_S)

    @property
    def true_dead_time_s(self) -> Floats:
        """From a command to the answer of a vehicle `lag`, lateness included (n, m)."""
        return np.maximum(self.dead_time_s + self.late_s, 0.0)

    def __len__(self) -> int:
        return len(self.row)

    def only(self, missions: Bools | Indices) -> Batch:
        """Some of the missions."""
        arrays = {
            f.name: getattr(self, f.name)[..., missions] for f in fields(self) if f.name != "cell"
        }
        return replace(self, **arrays)


def joined(batches: Sequence[Batch]) -> Batch:
    """The missions of batches that are flown alike, in one; its cell is the first one's."""
    names = [f.name for f in fields(Batch) if f.name != "cell"]
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(batch, name) for batch in batches], axis=-1) for name in names
    }
    return replace(batches[0], **arrays)


def flown_alike(cell: Cell) -> tuple[object, ...]:
    """What has to be the same for cells whose missions fly in one batch: all that is not drawn."""
    drawn = {"index", "shape", "slots", "start", *RANGES}
    none = tuple(getattr(cell, name).high > 0 for name in RANGES)
    return cell.model_dump_json(exclude=drawn), cell.model, none


def block_size(n: int) -> int:
    """Missions drawn together."""
    return max(32, _BLOCK_AGENTS // n)


def blocks(study: Study) -> list[tuple[Cell, int, int]]:
    """(cell, first mission in the cell, missions) of every block, in the order of the rows."""
    return [
        (cell, first, min(size, study.missions - first))
        for cell in study.cells()
        for size in (block_size(cell.n),)
        for first in range(0, study.missions, size)
    ]


def draw(cell: Cell, first: int, count: int) -> Batch:
    """The missions `first` to `first + count` of a cell. InputError where the area is too small."""
    random = np.random.default_rng([cell.seed, cell.index, first])
    values = {name: _draw(getattr(cell, name), count, random) for name in FIRST_RANGES}
    # area 0: six in a square of 10 x 10, more a little denser: as sparse as six, many agents are
    # hardly ever connected
    values["area"] = np.where(values["area"] == 0, 10.0 * (cell.n / 6) ** 0.375, values["area"])
    in_wood = cell.wood != "none"
    # in a wood agents stand in their shape
    starts = None if in_wood else _starts(cell, values["area"], values["spacing"], random)
    slots = _slots(cell, starts, values["spacing"], random)
    wind_from_rad = random.uniform(0.0, 2 * np.pi, count)
    dies = random.random(count) < values["silent"]
    agent, when = random.integers(cell.n, size=count), random.uniform(0.0, _DIES_BY_S, count)
    values |= {name: _draw(getattr(cell, name), count, random) for name in LATER_RANGES}
    silent_s = _deaths(np.where(dies, agent, -1), when, values.pop("silent_agents"), cell.n, random)
    for name in AGENT_RANGES:
        # the lag's error last of all: studies without one have the same missions as ever
        drawn = values[name] if name in values else _draw(getattr(cell, name), count, random)
        values[name] = _by_agent(cell, name, drawn, random)
    values |= {name: _draw(getattr(cell, name), count, random) for name in WOOD_RANGES}
    row = cell.index * cell.missions + first + np.arange(count)
    woods = np.full(count, None, dtype=object)
    if starts is None:
        off = random.uniform(-1.0, 1.0, (2, cell.n, count))
        starts = slots + _JITTER * values["spacing"] * off
        at = complex_of(np.ascontiguousarray(slots.transpose(2, 1, 0)))
        of = zip(row.tolist(), at, *(values[name].tolist() for name in WOOD_RANGES), strict=True)
        woods[:] = [grow(cell, *each) for each in of]
    return Batch(
        cell=cell,
        row=row,
        starts=starts,
        slots=slots,
        links=_links(starts, cell.law.r),
        wind_from_rad=wind_from_rad,
        silent_agents=np.count_nonzero(np.isfinite(silent_s), axis=0),
        silent_s=silent_s,
        woods=woods,
        **values,
    )


def _draw(span: Range, count: int, random: np.random.Generator) -> Floats:
    """A fixed value takes its share of random numbers, too: the other ranges then draw the same."""
    return span.low + (span.high - span.low) * random.random(count)


def _deaths(
    agent: Ints, when: Floats, dying: Floats, n: int, random: np.random.Generator
) -> Floats:
    """When each agent dies (n, m): `agent` (-1: none in this mission) at `when`, and as many others
    as there are to be, `dying` being their number or, under 1, their share."""
    count = len(agent)
    number = np.where(dying < 1, np.ceil(dying * n), np.rint(dying)).clip(1, n - 1)
    place, also_s = random.random((n, count)), random.uniform(0.0, _DIES_BY_S, (n, count))
    first = np.arange(n)[:, None] == agent
    order = np.where(first, -1.0, place).argsort(axis=0).argsort(axis=0)
    silent_s: Floats = np.where(order < number, np.where(first, when, also_s), np.inf)
    return np.where(agent >= 0, silent_s, np.inf)


def _by_agent(cell: Cell, name: str, drawn: Floats, random: np.random.Generator) -> Floats:
    """Each agent's value (n, m): the mission's, or one of its own from the same range."""
    if cell.spread == "mission":
        return np.repeat(drawn[None], cell.n, axis=0)
    own = _draw(getattr(cell, name), cell.n * len(drawn), random)
    return own.reshape(cell.n, len(drawn))


def _links(starts: Floats, r: float) -> Bools:
    """Which agents start within r of each other, (n, n, m)."""
    apart = starts[:, :, None] - starts[:, None]
    links: Bools = (apart**2).sum(axis=0) <= r * r
    links[np.arange(len(links)), np.arange(len(links))] = False
    return links


def connected(links: Bools) -> Bools:
    """Which of the graphs (n, n, m) are connected, (m,)."""
    # squaring doubles the length of the paths that count
    reach = np.moveaxis(links, -1, 0).astype(np.float32) + np.eye(len(links), dtype=np.float32)
    for _ in range(max(1, len(links) - 1).bit_length()):
        reach = np.minimum(reach @ reach, 1.0)
    return np.asarray((reach > 0).all(axis=(1, 2)))


def _starts(cell: Cell, area: Floats, spacing: Floats, random: np.random.Generator) -> Floats:
    count = len(area)
    if cell.start == "random":
        return _scattered(cell, area, random)
    if cell.start == "table2":
        places = np.array(TABLE_II, dtype=np.float64)[:, :, None] * np.ones(count)
    else:
        places = start_shape(cell.start, cell.n)[:, :, None] * spacing
        if cell.start in OPPOSITE:
            places = places + _JITTER * spacing * random.uniform(-1.0, 1.0, (cell.n, 2, count))
            return np.ascontiguousarray(places.transpose(1, 0, 2))
        order = random.permuted(np.tile(np.arange(cell.n), (count, 1)), axis=1)
        places = np.take_along_axis(places, order.T[:, None], axis=0)
    starts = np.ascontiguousarray(places.transpose(1, 0, 2))
    if not connected(_links(starts, cell.law.r)).all():
        raise InputError(
            f"start {cell.start}: the agents are not connected within r {cell.law.r:g}"
        )
    return starts


def _scattered(cell: Cell, area: Floats, random: np.random.Generator) -> Floats:
    """Random in the square, no two closer than the spacing, and connected."""
    apart = cell.start_spacing or 2 * cell.law.r_in
    starts = random.random((2, cell.n, len(area))) * area
    bad = np.arange(len(area))
    for _ in range(_TRIES):
        # draw again: agents too close to one with a higher number, and whole missions that are not
        # connected
        crowded = np.triu(_links(starts[..., bad], apart).transpose(2, 0, 1), 1).any(axis=1).T
        apart_missions = ~connected(_links(starts[..., bad], cell.law.r)) & ~crowded.any(axis=0)
        again = crowded | apart_missions
        keep = again.any(axis=0)
        bad, again = bad[keep], again[:, keep]
        if not len(bad):
            return starts
        fresh = random.random((2, cell.n, len(bad))) * area[bad]
        starts[..., bad] = np.where(again, fresh, starts[..., bad])
    raise InputError(
        f"area {cell.area}: found no {cell.n} starts {apart:g} apart that are connected within r"
        f" {cell.law.r:g}; a larger or smaller area may do"
    )


def _slots(
    cell: Cell, starts: Floats | None, spacing: Floats, random: np.random.Generator
) -> Floats:
    """The shape, turned at random, given out as the cell says, (2, n, m)."""
    count = len(spacing)
    angle = random.uniform(0.0, 2 * np.pi, count)
    order = random.permuted(np.tile(np.arange(cell.n), (count, 1)), axis=1).T
    if starts is not None and cell.slots == "given" and cell.start in OPPOSITE:
        mirror = (-1.0, -1.0) if cell.start == "antipodal" else (1.0, -1.0)
        places = start_shape(cell.start, cell.n) * mirror
        return np.ascontiguousarray((places[:, :, None] * spacing).transpose(1, 0, 2))
    north, east = unit_shape(cell.shape, cell.n).T[:, :, None] * spacing
    slots = np.stack(
        (north * np.cos(angle) - east * np.sin(angle), north * np.sin(angle) + east * np.cos(angle))
    )
    if cell.slots == "random":
        slots = np.take_along_axis(slots, order[None], axis=1)
    elif starts is not None and cell.slots == "nearest":
        # slots are dealt to one swarm at a time
        chosen = [nearest(starts[..., k].T, slots[..., k].T) for k in range(count)]
        slots = np.stack(chosen, axis=-1).transpose(1, 0, 2)
    return np.ascontiguousarray(slots)


def start_shape(name: str, n: int) -> Floats:
    """Where agents start, with spacing 1, (n, 2): one of the shapes, or opposite each other."""
    if name == "antipodal":
        return unit_shape("ring", n)
    if name == "crossing":
        row, side = np.divmod(np.arange(n), 2)
        return np.stack((row - (n - 1) // 2 / 2, _FACING * (side - 0.5)), axis=-1)
    return unit_shape(name, n)


def unit_shape(name: str, n: int) -> Floats:
    """Slots of a shape with spacing 1, centred, (n, 2)."""
    kinds: dict[str, shape_sections.Shape] = {
        "ring": shape_sections.RingShape(kind="ring", side=1.0),
        "line": shape_sections.LineShape(kind="line", spacing=1.0),
        "grid": shape_sections.GridShape(kind="grid", spacing=1.0),
        "vee": shape_sections.VeeShape(kind="vee", spacing=1.0),
        "wedge": shape_sections.WedgeShape(kind="wedge", spacing=1.0),
    }
    return centred(slots_of(kinds[name], n))
