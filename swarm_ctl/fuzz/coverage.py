"""What drawn flights have really met: in which step, after which fault, what happened or was
ordered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, Final, NamedTuple, get_args

from rich.box import SIMPLE_HEAD
from rich.table import Table

from swarm_ctl.commands.parse import KINDS as ORDERS
from swarm_ctl.mission.sections.simulation_section import Pilot, SimParameters
from swarm_ctl.mission.steps.table import KINDS
from swarm_ctl.virtual.scenario import Happening
from swarm_ctl.virtual.scenario_flight import Met

STEPS: Final = ("prepare", *KINDS, "join")
NOTHING: Final = "nothing"
FAULTS: Final = tuple(kind for kind in Happening.KINDS if kind != "order")
PILOTS: Final = get_args(Pilot)
PARAMETERS: Final = tuple(name.removeprefix("SIM_") for name in SimParameters.model_fields)
_SEVERAL: Final = {"pilot": PILOTS, "vehicle": PARAMETERS}
_FAULTS: Final = tuple(
    f"{kind} {which}".strip() for kind in FAULTS for which in _SEVERAL.get(kind, ("",))
)
WHATS: Final = (*_FAULTS, *(f"order {kind.name}" for kind in ORDERS))
"""All that may happen: pilots by their mode, vehicles by what changes, orders by their command."""


class CoverageCell(NamedTuple):
    """One thing that happened, and when."""

    step: str
    """The step that the swarm was in."""
    after: str
    """The kind of the last fault before it, or `NOTHING`."""
    what: str
    """One of `WHATS`."""


class Coverage:
    """How often each cell was met."""

    def __init__(self, cells: Iterable[CoverageCell] = ()) -> None:
        self.met: Counter[CoverageCell] = Counter(cells)

    def add(self, cells: Iterable[CoverageCell]) -> None:
        """What one more flight met."""
        self.met.update(cells)

    def wants(self, cell: CoverageCell) -> float:
        """How much it is wanted: 1 where it was never met, and less each time."""
        return 1.0 / (1.0 + self.met[cell]) ** 2

    def wants_step(self, step: str) -> float:
        """How much is still to be met in a step, as a share."""
        return sum(self.wants(CoverageCell(step, NOTHING, what)) for what in WHATS) / len(WHATS)

    def count(self, step: str, what: str) -> int:
        """How often this happened in this step, after whatever."""
        return sum(self.met[CoverageCell(step, after, what)] for after in (NOTHING, *FAULTS))

    def as_json(self) -> dict[str, Any]:
        """Step by step, what happened and how often; and each cell with what was before."""
        return {
            "met": {step: {what: self.count(step, what) for what in WHATS} for step in STEPS},
            "cells": [[*cell, times] for cell, times in sorted(self.met.items())],
            "cells_possible": len(STEPS) * (1 + len(FAULTS)) * len(WHATS),
        }

    def table(self) -> Table:
        """For people: a row for all that may happen, a column for each step."""
        data = self.as_json()
        title = f"met: {len(data['cells'])} of {data['cells_possible']} (step, fault before, what)"
        table = Table(
            "",
            title=title,
            title_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
            show_edge=False,
        )
        table.columns[0].no_wrap = True
        for step in STEPS:
            table.add_column(step, justify="right", no_wrap=True)
        for what in WHATS:
            counts = [self.count(step, what) for step in STEPS]
            label = what.replace("vehicle ", "SIM_")
            table.add_row(label, *(str(each) if each else "." for each in counts))
            if what == _FAULTS[-1]:
                table.add_section()
        return table


def what_of(happening: Happening) -> str:
    """Its name in the table."""
    kind, which = happening.kind, ""
    if happening.order:
        which = happening.order.split()[0]
    elif happening.pilot is not None:
        which = happening.pilot.mode
    elif happening.vehicle is not None:
        which = min(happening.vehicle.set.given(), default="").removeprefix("SIM_")
    return f"{kind} {which}".strip()


def cells_of(met: Iterable[Met]) -> list[CoverageCell]:
    """The cells of one flight."""
    cells, after = list[CoverageCell](), NOTHING
    for each in met:
        cells.append(CoverageCell(each.step, after, what_of(each.happening)))
        if not each.happening.order:
            after = each.happening.kind
    return cells
