"""The neighbour graph: the links of the law for the whole mission. A graph maps each agent's id to
its neighbours' ids."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.model.plan import Point

Graph: TypeAlias = Mapping[int, Collection[int]]


_ROUNDING = 1 + 1e-9
"""Starts exactly `r` apart are neighbours in any unit of length."""


def neighbours(starts: Mapping[int, Point], r: float) -> dict[int, tuple[int, ...]]:
    """`N_i` of every agent: the others whose start lies within the interaction range `r` (same
    length unit)."""
    most = r * _ROUNDING
    return {
        i: tuple(sorted(j for j, q in starts.items() if j != i and math.dist(p, q) <= most))
        for i, p in sorted(starts.items())
    }


def connecting_range(starts: Mapping[int, Point]) -> tuple[float, int, int]:
    """The least interaction range that connects the start graph of at least two agents, and the
    link that needs it."""
    first, *rest = sorted(starts)
    nearest = {j: (math.dist(starts[first], starts[j]), first) for j in rest}
    widest = (0.0, 0, 0)
    while nearest:
        j = min(nearest, key=nearest.__getitem__)
        gap, i = nearest.pop(j)
        widest = max(widest, (gap, min(i, j), max(i, j)))
        for k, known in nearest.items():
            nearest[k] = min(known, (math.dist(starts[j], starts[k]), j))
    return widest


def of_links(ids: Iterable[int], links: Iterable[tuple[int, int]]) -> dict[int, tuple[int, ...]]:
    """The graph with these links; links of ids it does not have are left out."""
    heard: dict[int, set[int]] = {i: set() for i in sorted(ids)}
    for i, j in links:
        if i in heard and j in heard and i != j:
            heard[i].add(j)
            heard[j].add(i)
    return {i: tuple(sorted(near)) for i, near in heard.items()}


def edges(graph: Graph) -> tuple[tuple[int, int], ...]:
    """Every link once, lower id first, sorted."""
    return tuple(sorted((i, j) for i, heard in graph.items() for j in heard if i < j))


def components(graph: Graph) -> tuple[tuple[int, ...], ...]:
    """The ids of each connected part, sorted; parts in the order of their lowest id."""
    found: list[tuple[int, ...]] = []
    left = set(graph)
    while left:
        part, border = set[int](), {min(left)}
        while border:
            part |= border
            border = {j for i in border for j in graph[i]} - part
        found.append(tuple(sorted(part)))
        left -= part
    return tuple(found)


def without(graph: Graph, lost: Collection[int]) -> dict[int, tuple[int, ...]]:
    """The graph that is left when the agents `lost` leave it."""
    return {
        i: tuple(j for j in heard if j not in lost) for i, heard in graph.items() if i not in lost
    }


def bridged(graph: Graph, lost: Collection[int]) -> dict[int, tuple[int, ...]]:
    """The graph without `lost`, where the neighbours of each lost agent are linked: it stays as
    connected as before."""
    links = {i: set(heard) for i, heard in graph.items()}
    for gone in sorted(lost):
        left = links.pop(gone, set())
        for i in left:
            links[i] |= left - {i}
            links[i].discard(gone)
    return {i: tuple(sorted(heard)) for i, heard in links.items()}


def algebraic_connectivity(graph: Graph) -> float:
    """Second smallest eigenvalue of the Laplacian D - A (Fiedler value): 0 where the graph is not
    connected.

    Graphs of fewer than two agents have no second eigenvalue; they give 0.
    """
    adjacency = _adjacency(graph)
    return _second_smallest(np.diag(adjacency.sum(axis=1)) - adjacency)


def consensus_rate(graph: Graph) -> float:
    """Second smallest eigenvalue of I - A / d_i, the Laplacian in the law's consensus term (26).

    The slowest part of the formation error shrinks by (1 - h * rate) per law iteration, so its time
    constant is 1 / (kappa * h * rate) seconds. An agent without neighbours does not move: 0.
    """
    adjacency = _adjacency(graph)
    degree = adjacency.sum(axis=1)
    if not np.all(degree > 0):
        return 0.0
    # Similar to I - D^-1 A, and symmetric: same eigenvalues, better solver.
    scale = 1 / np.sqrt(degree)
    return _second_smallest(np.eye(len(degree)) - scale[:, None] * adjacency * scale)


def _adjacency(graph: Graph) -> npt.NDArray[np.float64]:
    index = {agent: k for k, agent in enumerate(sorted(graph))}
    matrix = np.zeros((len(index), len(index)))
    for i, heard in graph.items():
        for j in heard:
            matrix[index[i], index[j]] = 1.0
    return matrix


def _second_smallest(laplacian: npt.NDArray[np.float64]) -> float:
    if len(laplacian) < 2:
        return 0.0
    value = float(np.linalg.eigvalsh(laplacian)[1])
    # Zero comes out of the solver as rounding of either sign.
    return value if value > 1e-12 * len(laplacian) else 0.0
