"""The worst mission of a study, searched within a budget: the ranges narrowed again and again
around the worst missions, the lists' values drawn anew or kept.

Missions are flown by region: one value of each list, and a range of each range. A region's missions
have a seed of their own, so each mission is a row of a study of its own and flies again as such.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final, TypeAlias

import numpy as np

from swarm_ctl.errors import InputError
from swarm_ctl.study.batch.batch import block_size
from swarm_ctl.study.parameter_space import AGENT_RANGES, LISTS, MODEL, RANGES, Range, Study
from swarm_ctl.study.rows import WITH_UNIT, Row

Fly: TypeAlias = Callable[[Sequence[Study]], Iterator[list[Row]]]
"""The rows of studies of one cell and one block each, in their order."""

_ROUNDS: Final = 8
_REGIONS: Final = 16
"""In a round, where the budget is for so many."""
_MISSIONS: Final = (16, 256)
"""In a region, at least and at most."""
_WHOLE: Final = 4
"""One region in so many is drawn from all of the study; as many regions are parents of the
others."""
_ELITES: Final = 8
"""One mission in so many says where its region goes on."""
_WIDER: Final = 0.1
"""Of the region's width, on either side of its elites."""
_UNFORMED: Final = 1e6
_TORN: Final = 1e3


class Goal(StrEnum):
    """What the worst mission is worst at."""

    SMALLEST = "smallest"
    """Two live agents come nearest to each other."""
    SILENT = "silent"
    """A live agent comes nearest to the vehicle of a silent one."""
    SLOWEST = "slowest"
    """Takes longest to form; worst: does not."""
    ZONE = "zone"
    """A live agent comes nearest to a zone, or deepest into one."""
    LINK = "link"
    """A link whose slots fit is torn; where none is, has the longest link."""

    def require_in(self, study: Study) -> None:
        """InputError where no mission of the study can have one, so that none is worse."""
        if self is Goal.ZONE and set(study.wood) == {"none"}:
            raise InputError("--search zone: no zones in this study; allowed: with --wood trunks")
        if self is Goal.SILENT and not any(share.high for share in study.silent):
            raise InputError("--search silent: no agent dies here; allowed: with --silent 0.2")

    def badness(self, row: Row) -> float:
        """Of a mission; more is worse."""
        match self:
            case Goal.SMALLEST:
                return -float(row["smallest_units"])
            case Goal.SILENT:
                return -float(row["smallest_silent_units"])
            case Goal.ZONE:
                return -float(row["smallest_zone_units"])
            case Goal.SLOWEST:
                unformed = _UNFORMED + row["error_units"]
                return float(row["time_s"] if row["converged"] else unformed)
            case Goal.LINK:
                return float(_TORN * row["kept_broken"] + row["longest_link_units"])

    def told(self, row: Row) -> str:
        """How bad a mission is, in words."""
        match self:
            case Goal.SMALLEST:
                return f"smallest distance {row['smallest_units']:.3f} units"
            case Goal.SILENT:
                return f"smallest distance to a silent one {row['smallest_silent_units']:.3f} units"
            case Goal.ZONE:
                return f"smallest distance to a zone {row['smallest_zone_units']:.3f} units"
            case Goal.SLOWEST if row["converged"]:
                return f"formed after {row['time_s']:.1f} s"
            case Goal.SLOWEST:
                return f"not formed after {row['time_s']:.1f} s, error {row['error_units']:.2f}"
            case Goal.LINK:
                torn, longest = row["kept_broken"], row["longest_link_units"]
                return f"{torn} links torn whose slots fit, longest link {longest:.2f} units"


@dataclass(frozen=True, slots=True)
class Region:
    """A part of a study in which missions are flown together."""

    chosen: Mapping[str, Any]
    """One entry of each list."""
    spans: Mapping[str, Range]
    """Of each range, within the chosen entry."""

    def study(self, whole: Study, seed: int, missions: int) -> Study:
        """A study of this region alone. What agents believe stays what it is in the whole."""
        one = whole.model_copy(update={name: (entry,) for name, entry in self.chosen.items()})
        (cell,) = one.cells()
        believed = {name: getattr(cell.model, name.removeprefix("model_")) for name in MODEL}
        values = {**self.spans, **believed}
        size = min(missions, block_size(cell.n))
        narrow = {name: (entry,) for name, entry in values.items()}
        return one.model_copy(update=narrow | {"seed": seed, "missions": size})


@dataclass(frozen=True, slots=True)
class Find:
    """A mission, as a row of a study."""

    study: Study
    row: Row
    badness: float


@dataclass(frozen=True, slots=True)
class _Flown:
    region: Region
    elites: list[Row]
    badness: float
    """Mean of the elites'."""


def worst(
    study: Study,
    goal: Goal,
    budget: int,
    fly: Fly,
    *,
    narrow: bool = True,
    say: Callable[[str], None] | None = None,
) -> Find:
    """The worst mission found.

    Args:
        study: its lists and ranges are searched; its number of missions does not matter.
        goal: what is worst.
        budget: missions to fly.
        fly: flies regions.
        narrow: else all regions are drawn from the whole study: plain random sampling.
        say: takes a line after each round, if there is one.
    """
    random = np.random.default_rng([study.seed, int(narrow)])
    size = int(np.clip(budget // (_ROUNDS * _REGIONS), *_MISSIONS))
    count = max(1, math.ceil(budget / (_ROUNDS * size)))
    flown: list[_Flown] = []
    best: Find | None = None
    left = budget
    while left > 0:
        regions = _next_regions(study, flown if narrow else [], count, random)
        studies: list[Study] = []
        for region in regions:
            if left > 0:
                seed = int(random.integers(2**32))
                studies.append(region.study(study, seed, min(size, left)))
                left -= studies[-1].missions
        for region, part, rows in zip(regions, studies, fly(studies), strict=False):
            ordered = sorted(rows, key=goal.badness, reverse=True)
            elites = ordered[: max(2, len(rows) // _ELITES)]
            flown.append(_Flown(region, elites, float(np.mean([*map(goal.badness, elites)]))))
            bad = goal.badness(ordered[0])
            if best is None or bad > best.badness:
                best = Find(part, ordered[0], bad)
        if best is not None and say is not None:
            say(f"{budget - left} of {budget} missions: {goal.told(best.row)}")
    if best is None:
        raise ValueError(f"budget {budget}: allowed: 1 or more")
    return best


def _next_regions(
    study: Study, flown: Sequence[_Flown], count: int, random: np.random.Generator
) -> list[Region]:
    """A quarter is drawn from the whole study, all in the first round; the others are around the
    elites of the worst regions so far, half of them with another entry of one list."""
    quarter = math.ceil(count / _WHOLE)
    fresh = quarter if flown else count
    parents = sorted(flown, key=lambda part: part.badness, reverse=True)[:quarter]
    regions = [_drawn(study, random) for _ in range(fresh)]
    for k in range(count - fresh):
        child = _around(parents[k % len(parents)])
        regions.append(_changed(study, child, random) if random.random() < 0.5 else child)
    return regions


def _drawn(study: Study, random: np.random.Generator) -> Region:
    chosen = {name: _one(getattr(study, name), random) for name in (*LISTS, *RANGES)}
    return Region(chosen, {name: chosen[name] for name in RANGES})


def _one(entries: Sequence[Any], random: np.random.Generator) -> Any:
    return entries[int(random.integers(len(entries)))]


def _changed(study: Study, region: Region, random: np.random.Generator) -> Region:
    """With a new entry of one list."""
    if not study.varied:
        return region
    name = _one(study.varied, random)
    entry = _one(getattr(study, name), random)
    spans = {**region.spans, name: entry} if name in RANGES else region.spans
    return replace(region, chosen={**region.chosen, name: entry}, spans=spans)


def _around(part: _Flown) -> Region:
    """The region's ranges narrowed to its elites."""
    region = part.region
    spans = {name: _narrowed(name, region, part.elites) for name in RANGES}
    return replace(region, spans=spans)


def _narrowed(name: str, region: Region, elites: Sequence[Row]) -> Range:
    span, whole = region.spans[name], region.chosen[name]
    if span.low == span.high:
        return span
    column = WITH_UNIT.get(name, name)
    ends = (f"least_{name}", f"most_{name}") if name in AGENT_RANGES else (column, column)
    margin = _WIDER * (span.high - span.low)
    low = min(float(row[ends[0]]) for row in elites) - margin
    high = max(float(row[ends[1]]) for row in elites) + margin
    return Range(
        low=min(max(low, whole.low), whole.high), high=max(min(high, whole.high), whole.low)
    )
