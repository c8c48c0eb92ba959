"""The rows of `faults.py`: no two vehicles too near, nothing hangs, all come down, and the log says
why."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.mesh.impaired import Impairment
from tests.scenarios.faults import GUSTY, ROWS, SAFE, Faulty, Row, flown

IN_OTHERS = {
    "a tenth is lost",
    "0.2 s late",
    "a third comes twice",
    "lost, late, twice",
    "parted for 3 s",
    "clocks apart by 0.3 s",
    "clocks apart by 0.7 s",
    "clocks apart by seconds",
    "clocks drift",
    "a clock jumps ahead",
    "a clock jumps back",
    "GPS jumps by 3 m",
    "gusts",
    "0.1 to 0.5 s late, out of order",
    "clocks apart by an hour",
    "clocks apart; 0.2 s late, a fifth is lost",
    "frozen for 2 s",
    "dies",  # so in test_hexagon.py
}
"""A harder row has the same in it, if no other test is named: these are flown on demand."""

AT_OWN_RATE = {"one has lost the mesh"}
"""At half of it, what it lost first is lost in one tick with the rest."""


def wrong(row: Row, seed: int) -> list[str]:
    """What the row's checks find."""
    faulty = flown(row, seed)
    return [found for check in row.checks if (found := check(faulty))]


@pytest.mark.parametrize(
    "row",
    [pytest.param(r, marks=pytest.mark.long if r.name in IN_OTHERS else ()) for r in ROWS],
    ids=str,
)
def test_fault(row: Row) -> None:
    """One of the rows, one seed, at half the rate; at the whole one with other dice below."""
    flown = row if row.name in AT_OWN_RATE else replace(row, rate_hz=10)
    assert wrong(flown, 1) == []


def test_same_seed_same_trace() -> None:
    """A flight in bad weather over a bad mesh is repeated to the last bit, while they form;
    another seed is another flight."""
    row = next(row for row in ROWS if row.name == "gusts, lost, late")
    row = replace(row, within_s=10.0, rate_hz=10)
    flights = [Faulty(row, seed) for seed in (1, 1, 2)]
    for flight in flights:
        flight.fly()
    assert flights[0].trace() == flights[1].trace()
    assert flights[0].trace() != flights[2].trace()


@pytest.mark.long
@pytest.mark.parametrize("row", ROWS, ids=str)
def test_same_seed_same_trace_of_every_row(row: Row) -> None:
    """Whatever goes wrong, it goes wrong in the same way again."""
    flights = [Faulty(row, 1) for _ in range(2)]
    for flight in flights:
        flight.fly()
    assert flights[0].trace() == flights[1].trace()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 12))
@pytest.mark.parametrize("row", ROWS, ids=str)
def test_fault_again(row: Row, seed: int) -> None:
    """The same with other dice."""
    assert wrong(row, seed) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("row", [row for row in ROWS if row.happenings and not row.falls], ids=str)
def test_fault_on_a_bad_day(row: Row, seed: int) -> None:
    """What happens to one agent, over a mesh that loses a fifth and is late, in gusts: safe
    whatever the outcome."""
    bad = replace(row, checks=SAFE, mesh=Impairment(0.2, 0.05, 0.1, 0.05), vehicles=GUSTY)
    assert wrong(bad, seed) == []
