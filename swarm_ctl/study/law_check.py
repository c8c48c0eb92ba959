"""What a law must do before it flies: checks of its terms on drawn places, and small studies.

The checks are of the function that agents call, with the receiver and the rows that they give it.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from swarm_ctl.core.kernel.law import Law
from swarm_ctl.core.kernel.receiver import NO_ONE, SOMEONE, Known, Me
from swarm_ctl.core.law.formation_law import PAPER, FormationLaw
from swarm_ctl.core.model.plan import LawParameter, LawParameters
from swarm_ctl.law_loader import LawError, own_law
from swarm_ctl.study.batch.batch import draw
from swarm_ctl.study.batch.batch_flight import BatchResult, fly
from swarm_ctl.study.batch.compiled import available, interpreted, law_compiled
from swarm_ctl.study.parameter_space import Study

_KAPPA: Final = 20.0
_SWARMS: Final = 60
_EQUAL: Final = 1e-6
"""[units/s]: terms that differ by less are the same."""
_SHARE: Final = 0.05
"""Of a tick, that a call may take."""
_FLOWN: Final = 20
"""Missions of a small study."""


@dataclass(frozen=True, slots=True)
class Checked:
    """One check of a law."""

    name: str
    good: bool | None
    """None: it says something, and fails nothing."""
    found: str


_Place: TypeAlias = tuple[Me, list[Known]]
_Terms: TypeAlias = tuple[complex, complex]


class _Subject:
    """A law with its numbers, called as agents call it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: tuple[LawParameter, ...] = ()
        self.law: FormationLaw = PAPER
        self.numbers: Any = Law(4.5, 1.5, 0.5, 0.2, 2.0, 0.1)
        if name != PAPER.name:
            found = own_law(name)
            self.law, self.parameters = found.law, found.parameters
            self.numbers = found.law.numbers(*(each.value for each in found.parameters))

    def memory(self) -> list[float]:
        return [0.0] * self.law.memory

    def terms(
        self, place: _Place, memory: list[float] | None = None, numbers: Any = None
    ) -> _Terms:
        """[units/s]; of a new agent unless `memory` says more. The law is told of those within its
        reach."""
        me, rows = place
        numbers = self.numbers if numbers is None else numbers
        reach, rate = self.law.reach(numbers), self.law.rate(_KAPPA)
        told = [other for other in rows if other.neighbour or abs(other.at - me.at) < reach]
        kept = self.memory() if memory is None else memory
        consensus, avoidance, _ = self.law.form(me, told, numbers, kept, [])
        return consensus * rate, avoidance * rate


def places(count: int, seed: int, *, width: float = 8.0) -> Iterator[_Place]:
    """So many receivers, each with 0 to 12 others around it."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        others = int(random.integers(0, 13))
        at, slots, flies = (
            (random.uniform(-w, w, others + 1) + 1j * random.uniform(-w, w, others + 1)).tolist()
            for w in (width, width, 0.7 * SOMEONE.speed)
        )
        me = SOMEONE._replace(at=at[0], slot=slots[0], flies=flies[0])
        rows = [
            NO_ONE._replace(
                id=j + 1,
                at=at[j],
                slot=slots[j],
                flies=flies[j],
                age_s=float(random.uniform(0, 0.3)),
                neighbour=bool(near),
                lower=True,
            )
            for j, near in zip(range(1, others + 1), random.random(others) < 0.6, strict=True)
        ]
        yield me, rows


def checked(name: str, now: Callable[[], float], *, flies: bool = True) -> Iterator[Checked]:
    """All checks of the law of this name, as they come; InputError where there is none. `now`: a
    clock [s]; `flies`: with the small studies."""
    law = _Subject(name)
    for about, check in (_CHECKS | (_FLIGHTS if flies else {})).items():
        try:
            good, found = check(law, now)
        except LawError as error:
            good, found = False, str(error)
        yield Checked(about, good, found)


_Check: TypeAlias = Callable[[_Subject, Callable[[], float]], tuple[bool | None, str]]


def _shapes(law: _Subject, _now: Any) -> tuple[bool, str]:
    """Its own function looks at what it gives: two numbers, whoever is there."""
    count = 0
    for width in (0.5, 8.0, 1000.0):
        for place in places(_SWARMS, 1, width=width):
            law.terms(place)
            count += 1
    return True, f"two velocities each, {count} places of 0 to 12 others, up to 1000 units apart"


def _alike(pairs: Iterator[tuple[_Terms, _Terms]], what: str) -> tuple[bool, str]:
    worst = 0.0
    for one, other in pairs:
        scale = max(1.0, *map(abs, one))
        worst = max(worst, *(abs(a - b) / scale for a, b in zip(one, other, strict=True)))
    if worst <= _EQUAL:
        return True, f"{what}: no difference"
    return False, f"{what}: the terms differ by {worst:.3g} units/s; allowed: {_EQUAL:g}"


def _moved(place: _Place, at: complex, slot: complex) -> _Place:
    me, rows = place
    mine = me._replace(at=me.at + at, slot=me.slot + slot)
    return mine, [o._replace(at=o.at + at, slot=o.slot + slot) for o in rows]


def _translation(law: _Subject, _now: Any) -> tuple[bool, str]:
    drawn = ((law.terms(p), law.terms(_moved(p, 31 - 17j, 0j))) for p in places(_SWARMS, 2))
    return _alike(drawn, "all of it moved by 31, -17 units")


def _slots(law: _Subject, _now: Any) -> tuple[bool, str]:
    drawn = ((law.terms(p), law.terms(_moved(p, 0j, 5 + 9j))) for p in places(_SWARMS, 3))
    return _alike(drawn, "the shape moved by 5, 9 units")


def _order(law: _Subject, _now: Any) -> tuple[bool, str]:
    drawn = ((law.terms(p), law.terms((p[0], p[1][::-1]))) for p in places(_SWARMS, 4))
    return _alike(drawn, "the others in another order")


def _determinism(law: _Subject, _now: Any) -> tuple[bool, str]:
    drawn = ((law.terms(p), law.terms(p)) for p in places(_SWARMS, 5))
    return _alike(drawn, "the same place again")


def _unchanged(law: _Subject, _now: Any) -> tuple[bool, str]:
    for me, rows in places(_SWARMS, 6):
        told = list(rows)
        law.law.form(me, told, law.numbers, law.memory(), [])
        if told != rows:
            return False, "it changed the rows that it was given; allowed: to read them"
    return True, "it leaves the rows as they are"


def _state(law: _Subject, _now: Any) -> tuple[bool, str]:
    """What it remembers is in its memory alone: beside another agent it flies as without."""
    drawn = list(places(_SWARMS, 7))
    alone, memory = list[_Terms](), law.memory()
    for place in drawn:
        alone.append(law.terms(place, memory))
    if len(memory) != law.law.memory or not all(map(math.isfinite, memory)):
        return False, f"its memory is {memory!r}; allowed: {law.law.memory} finite numbers"
    mine, other = law.memory(), law.memory()

    def beside() -> Iterator[_Terms]:
        for k, place in enumerate(drawn):
            yield law.terms(place, mine)
            law.terms(drawn[k - 1], other)

    good, found = _alike(zip(alone, beside(), strict=True), "beside another agent")
    return good, f"{law.law.memory} numbers; {found}"


def _units(law: _Subject, _now: Any) -> tuple[bool, str]:
    """A velocity does not depend on how often it is asked for."""

    def slower(place: _Place) -> _Place:
        return place[0]._replace(tick_s=2 * SOMEONE.tick_s), place[1]

    apart = (p for p in places(_SWARMS, 8) if all(abs(o.at - p[0].at) > 1.5 for o in p[1]))
    return _alike(((law.terms(p), law.terms(slower(p))) for p in apart), "at half as many ticks")


def _bounds(law: _Subject, _now: Any) -> tuple[bool | None, str]:
    if not law.parameters:
        return None, "it has no parameters"
    for place in places(_SWARMS // 4, 9):
        for each in law.parameters:
            for end in (each.least, each.most):
                values = [end if p is each else p.value for p in law.parameters]
                try:
                    law.terms(place, numbers=law.law.numbers(*values))
                except LawError as error:
                    return False, f"{each.name} {end:g}: {error}"
    return True, f"{len(law.parameters)} parameters, each at both of its ends"


def _wishes(law: _Subject, _now: Any) -> tuple[bool | None, str]:
    sizes = [abs(sum(law.terms(place))) / SOMEONE.speed for place in places(_SWARMS, 10)]
    over = sum(size > 1.0 for size in sizes)
    return None, (
        f"median {statistics.median(sizes):.2g}, most {max(sizes):.3g} times the speed limit;"
        f" {100 * over / len(sizes):.0f} % are cut to it"
    )


def _time(law: _Subject, now: Callable[[], float]) -> tuple[bool, str]:
    random = np.random.default_rng(11)
    at = (random.uniform(-8, 8, 33) + 1j * random.uniform(-8, 8, 33)).tolist()
    me = SOMEONE._replace(at=at[0])
    rows = [
        NO_ONE._replace(id=j + 1, at=at[j], slot=at[-j], neighbour=j < 12) for j in range(1, 33)
    ]
    each, memory = list[float](), law.memory()
    for _ in range(200):
        begun = now()
        law.terms((me, rows), memory)
        each.append(now() - begun)
    half, most = 1e6 * statistics.median(each), 1e6 * _SHARE * SOMEONE.tick_s
    found = f"{half:.0f} us a call among 32 others (median); allowed: {most:.0f}, 5 % of a tick"
    return half <= most, found


def _one_spot(law: _Subject, _now: Any) -> tuple[bool, str]:
    """Two exactly on one spot, for both of them; and twelve."""
    for count in (1, 12):
        for lower in (True, False):
            me = SOMEONE._replace(id=5, at=1 + 1j)
            one = NO_ONE._replace(at=1 + 1j, slot=1j, neighbour=True, lower=lower)
            rows = [one._replace(id=j + 6) for j in range(count)]
            law.terms((me, rows))
    return True, "finite, for the lower and for the higher id, and for thirteen on one spot"


def _silence(law: _Subject, _now: Any) -> tuple[bool, str]:
    """Who hears nobody stands still; of those that were heard long ago, nothing worse comes."""
    for me, rows in places(_SWARMS, 12):
        alone = sum(law.terms((me, [])))
        if abs(alone) > _EQUAL:
            return False, (
                f"an agent that hears nobody is told to fly {abs(alone):.3g} units/s; allowed: 0"
            )
        law.terms((me, [o._replace(age_s=30.0, neighbour=False) for o in rows]))
    return True, "an agent that hears nobody stands; old news of all others is borne"


def _study(law: _Subject, **settings: Any) -> BatchResult:
    fields = {"law": {"own": law.name}, "h": "0.2", "n": 8, "missions": _FLOWN, "limit_s": 60.0}
    late = {"delay_s": "0:0.2", "loss": "0:0.2", "lag_s": "0.3:0.6", "dead_time_s": "0.2:0.5"}
    study = Study.model_validate({**fields, **late, **settings})
    return fly(draw(study.cells()[0], 0, _FLOWN))


def _under_filter(law: _Subject, _now: Any) -> tuple[bool, str]:
    """All change sides through the middle, late news and lost news, unlike vehicles."""
    swap = {"start": "antipodal", "slots": "given", "safety": "align"}
    flown, r_in = _study(law, **swap), LawParameters().r_in
    under = int(np.count_nonzero(flown.smallest < r_in))
    text = f"{_FLOWN} swaps of 8 under the filter: smallest distance {flown.smallest.min():.3f}"
    return not under, f"{text} units, {under} missions under r_in; allowed: r_in = {r_in:g}, none"


def _forms(law: _Subject, _now: Any) -> tuple[bool | None, str]:
    told = []
    for safety in ("off", "align"):
        flown = _study(law, safety=safety)
        formed = int(np.count_nonzero(flown.converged))
        times = flown.time_s[flown.converged]
        took = f" in {np.median(times):.1f} s (median)" if formed else ""
        how = "with" if safety == "align" else "without"
        told.append(f"{formed} of {_FLOWN} {how} the filter{took}")
    return None, "; ".join(told)


def _compiles(law: _Subject, _now: Any) -> tuple[bool | None, str]:
    if law.law is PAPER:
        return None, "it is part of the flight of missions"
    if not available():
        return None, "numba is not installed: studies take a hundred times as long"
    if interpreted(law.law):
        return None, f"studies call it as it is, tens of times slower: {law_compiled(law.law).why}"
    return True, "studies fly it compiled"


_CHECKS: Final[dict[str, _Check]] = {
    "shapes, finite": _shapes,
    "translation": _translation,
    "place of the shape": _slots,
    "order of rows": _order,
    "determinism": _determinism,
    "rows unchanged": _unchanged,
    "state": _state,
    "units": _units,
    "bounds": _bounds,
    "size of wishes": _wishes,
    "time per call": _time,
    "pairs on one spot": _one_spot,
    "silence": _silence,
}
_FLIGHTS: Final[dict[str, _Check]] = {
    "compiled": _compiles,
    "forms": _forms,
    "hostile case": _under_filter,
}
