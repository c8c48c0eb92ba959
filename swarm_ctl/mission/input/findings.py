"""What checks share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, TypeAlias

from swarm_ctl.core.law import graph
from swarm_ctl.mission.input.document import Mistake, Place, dotted

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
