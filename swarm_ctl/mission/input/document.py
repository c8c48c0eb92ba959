"""What is known of a file that was read: its data, where each value stands, what is wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, TypeAlias

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.text import escaped
from swarm_ctl.errors import Problem

Place: TypeAlias = tuple[str | int, ...]
"""Where a value stands in its document: keys and list indices from the top."""


class Mistake(NamedTuple):
    """A mistake: where in the document, what is wrong, what would be allowed."""

    place: Place
    what: str
    allowed: str


@dataclass
class Document:
    """A file as plain data (dict, tuple, scalars), the line of every value and the problems."""

    name: str
    data: Any = None
    wheres: dict[Place, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def where(self, place: Place) -> str:
        """`file:line` of the value at `place`, or of the nearest section around it."""
        while place and place not in self.wheres:
            place = place[:-1]
        return self.wheres.get(place, self.name)

    def has(self, place: Place) -> bool:
        """Whether the file has a value at `place`."""
        return place in self.wheres

    def problem(self, place: Place, what: str, allowed: str) -> Problem:
        """A problem with the value at `place`."""
        return problem_at(self.where(place), dotted(place), what, allowed)

    def graft(self, place: Place, other: Document) -> None:
        """Put the whole of `other` at `place`; its values keep their own file and lines."""
        self.data[place[0]] = other.data
        self.wheres |= {place + inner: where for inner, where in other.wheres.items()}
        for p in other.problems:
            field = dotted(place) if p.field == dotted(()) else f"{dotted(place)}.{p.field}"
            self.problems.append(problem_at(p.where, field, p.what, p.allowed))


def problem_at(where: str, field: str, what: str, allowed: str) -> Problem:
    """A problem that is safe to print: names and values of a file may hold control characters."""
    return Problem(escaped(where), escaped(field), escaped(what), escaped(allowed))


def dotted(place: Place) -> str:
    """`("steps", 1, "form", "shape")` as `step 2, form.shape`, `("fleet", "agents", 2, "sysid")` as
    `fleet.agents#3.sysid`: entries count from 1, as on all screens."""
    if len(place) > 1 and place[0] == "steps" and isinstance(place[1], int):
        step = f"step {place[1] + 1}"
        return f"{step}, {dotted(place[2:])}" if place[2:] else step
    text = "".join(
        f"#{part + 1}" if isinstance(part, int) else f".{part or repr(part)}" for part in place
    )
    return text.removeprefix(".") or "(whole file)"


ROUNDING: Final = 1e-9
Findings: TypeAlias = Iterator[Mistake]


def listed(ids: Iterable[int]) -> str:
    """`1, 2, 5`."""
    return ", ".join(map(str, sorted(ids)))


def twice(values: Mapping[Place, object], allowed: str) -> Findings:
    """A finding at each place whose value, if it has one, stands at an earlier place as well."""
    first: dict[object, Place] = {}
    for place, value in values.items():
        if value is not None and value in first:
            yield Mistake(place, f"{value} is taken by {dotted(first[value][:-1])}", allowed)
        first.setdefault(value, place)


def too_short(place: Place, timeout_s: float | None, needed_s: float) -> Findings:
    """The finding that a step at `place` can't be done within its time-out, if it can't."""
    if timeout_s is not None and timeout_s <= needed_s:
        what = f"{timeout_s:g} s is over before the {place[-1]} step can be done"
        yield Mistake((*place, "timeout_s"), what, f"above {needed_s:g}")


def named_parts(parts: Iterable[Iterable[int]]) -> str:
    """The parts of a graph: `{1, 3} and {2}`."""
    return " and ".join(f"{{{listed(part)}}}" for part in parts)


def bad_links(place: Place, links: object, ids: Sequence[int]) -> Findings:
    """What is wrong with a list of links, [id, id]; of another value nothing."""
    if not isinstance(links, tuple):
        return
    for k, (i, j) in enumerate(links):
        if i not in ids or j not in ids or i == j:
            allowed = f"two different ids of {listed(ids)}"
            yield Mistake((*place, k), f"[{i}, {j}] is no link", allowed)
    parts = graph.components(graph.of_links(ids, links))
    if len(parts) > 1:
        what = f"the graph is not connected: it falls into {named_parts(parts)}"
        yield Mistake(place, what, "links between them")
