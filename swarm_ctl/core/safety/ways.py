"""Ways round zones, and inside the fence: the shortest one that stays so far from all of them.

A visibility graph: the nodes stand around the corners of the zones, two are joined where nothing is
between them, and A* finds the way. What a node sees is worked out when the search first comes to
it, so that a map of many zones costs what is asked of it. Metres in the common frame.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Generator, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.safety.fence import inside

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Points: TypeAlias = NDArray[np.complex128]
Indices: TypeAlias = NDArray[np.intp]

_ROUND: Final = 12
"""Nodes around a circle, and as dense around corners."""
AROUND: Final = 1.0 / math.cos(math.pi / _ROUND)
"""A node beside a corner is so much farther off than what is kept, by this factor."""
BESIDE_M: Final = 0.05
_ROUNDING_M: Final = 1e-6
_LONGER: Final = 1.45
"""Two nodes beside a corner become one where the way there is not much longer: a right angle's."""
_CORNER_M: Final = 10.0
_FIRST: Final = 20
"""A look from a node for the first time is so much more work than a later one."""


class WayMap:
    """Where something can go that keeps off the walls. `outlines` are those of zones: corners and
    radius [m], and how far its middle stays from them; `fence` is stayed inside of, `off_m` from
    it. Nodes stand `beside_m` farther out than a way may come: none is blocked by a rounding."""

    def __init__(
        self,
        outlines: Sequence[tuple[Sequence[Point], float, float]],
        fence: Sequence[Point] = (),
        off_m: float = 0.0,
        *,
        beside_m: float = BESIDE_M,
    ) -> None:
        self._zones = [_complex(corners) for corners, _, _ in outlines]
        self._fence = _complex(fence)
        walls = [
            (corners, radius + keep)
            for corners, (_, radius, keep) in zip(self._zones, outlines, strict=True)
        ]
        walls += [(self._fence, off_m)] if len(fence) else []
        ends = [corners for corners, _ in walls] or [_NO_POINTS]
        self._first = np.concatenate(ends)
        self._last = np.concatenate([np.roll(each, -1) for each in ends])
        self._reach = np.array([reach for each, reach in walls for _ in each])
        self._owner = [k for k, (each, _) in enumerate(walls) for _ in each]
        # looked at together: the sides of a zone; each side of the fence by itself
        counts = [*map(len, self._zones), *(1 for _ in self._fence)]
        ends_at = [0, *itertools.accumulate(counts)]
        groups = [range(a, b) for a, b in itertools.pairwise(ends_at)]
        within = [self._within(list(group)) for group in groups]
        self._middles = np.array([middle for middle, _ in within], dtype=np.complex128)
        self._ranges = np.array([far for _, far in within]) ** 2
        self._group = np.array([k for k, group in enumerate(groups) for _ in group], dtype=np.intp)
        nodes = np.concatenate([_around(*wall, beside_m) for wall in walls] or [_NO_POINTS])
        self._nodes = nodes[self.free(nodes)] if len(nodes) else nodes
        self._seen: dict[int, list[tuple[int, float]]] = {}

    def free(self, points: Points) -> Bools:
        """(k,): inside the fence, outside of all zones, and far enough from both."""
        found: Bools = np.all(self._away(points) > _squares(self._reach), axis=1)
        for corners in self._zones:
            if len(corners) > 2:
                found &= ~_inside(corners, points)
        if len(self._fence):
            found &= _inside(self._fence, points)
        return found

    def sees(self, point: complex, others: Points) -> Bools:
        """(k,): the straight line between them is free, if its ends are."""
        return self._off(point, others, self._reach, free=True)

    def shortest(self, start: Point, goal: Point) -> list[Point] | None:
        """The corners of the shortest way, both ends included; None where there is none. An end
        that is not free itself is left, or come to, by a straight line."""
        search = self.search(start, goal)
        while True:
            try:
                next(search)
            except StopIteration as end:
                found: list[Point] | None = end.value
                return found

    def search(self, start: Point, goal: Point) -> Generator[None, None, list[Point] | None]:
        """`shortest`, with a halt after about as much work as it is to look from one node for all
        others for the first time."""
        a, b = complex(*start), complex(*goal)
        if self._clear(a, b):
            return [start, goal]
        nodes, end = self._nodes, len(self._nodes)
        first = self._open(a, nodes)
        last = self._open(b, nodes)
        yield
        to_goal = np.abs(nodes - b).tolist()
        best = {int(k): abs(complex(nodes[k]) - a) for k in np.flatnonzero(first)}
        before: dict[int, int] = dict.fromkeys(best, -1)
        heap = [(length + to_goal[k], k) for k, length in best.items()]
        heapq.heapify(heap)
        done, work = set[int](), 0
        while heap:
            _, k = heapq.heappop(heap)
            if k in done:
                continue
            done.add(k)
            if k == end:
                return self._straightened([start, *self._corners(before, k), goal])
            work += 1 if k in self._seen else _FIRST
            if work >= _FIRST:
                work = 0
                yield
            steps = self._from(k)
            if last[k]:
                steps = [*steps, (end, to_goal[k])]
            so_far = best[k]
            for j, step in steps:
                length = so_far + step
                if length < best.get(j, math.inf) - 1e-9:
                    best[j], before[j] = length, k
                    heapq.heappush(heap, (length + (to_goal[j] if j < end else 0.0), j))
        return None

    def _straightened(self, way: list[Point]) -> list[Point]:
        """With the two nodes beside one corner made one, where that is free: where a way turns, a
        formation slows down."""
        k = 1
        while k + 2 < len(way):
            a, b, c, d = (complex(*point) for point in way[k - 1 : k + 3])
            meet = _meeting(a, b, c, d)
            if meet is not None and self._clear(a, meet) and self._clear(meet, d):
                way[k : k + 2] = [(meet.real, meet.imag)]
                k = max(1, k - 1)
            else:
                k += 1
        return way

    def _corners(self, before: dict[int, int], k: int) -> list[Point]:
        found = list[Point]()
        while (k := before[k]) >= 0:
            found.append((float(self._nodes[k].real), float(self._nodes[k].imag)))
        return found[::-1]

    def free_line(self, start: Point, goal: Point) -> bool:
        """The straight line keeps off all walls."""
        return self._clear(complex(*start), complex(*goal))

    def open_line(self, start: Point, goal: Point, spare_m: float = 0.0) -> bool:
        """The straight line keeps off all walls but for `spare_m`, or comes no nearer to them than
        its ends are."""
        ends = np.array([complex(*start), complex(*goal)])
        _, near, gaps = self._near(complex(*start), ends[1:])
        least = np.sqrt(_squared(ends[:, None], self._first[near], self._last[near]).min(axis=0))
        return bool(np.all(gaps > _squares(np.minimum(self._reach[near] - spare_m, least))))

    def cut_by(self, start: Point, goal: Point) -> int | None:
        """Which outline is the first on the straight line, by its index, that of the fence being
        behind the last; None: none is."""
        a = complex(*start)
        _, near, gaps = self._near(a, np.array([complex(*goal)]))
        cut = near[gaps <= self._reach[near] ** 2]
        if not len(cut):
            return None
        away = np.abs(0.5 * (self._first[cut] + self._last[cut]) - a)
        return self._owner[int(cut[np.argmin(away)])]

    def _clear(self, a: complex, b: complex) -> bool:
        ends = np.array([a, b])
        return bool(self.free(ends).all() and self.sees(a, ends[1:])[0])

    def _open(self, point: complex, nodes: Points) -> Bools:
        """(k,): nodes to which the way from this end is free. From an end that stands nearer than
        it may, the line may not come nearer still."""
        at = np.array([point])
        if not len(nodes) or self.free(at)[0]:
            return self.sees(point, nodes)
        least = np.minimum(self._reach, np.sqrt(self._away(at)[0]))
        return self._off(point, nodes, least)

    def _from(self, k: int) -> list[tuple[int, float]]:
        """The nodes that a node sees, and how far each is."""
        if k not in self._seen:
            nodes, at = self._nodes, complex(self._nodes[k])
            further = np.flatnonzero(self.sees(at, nodes))
            away = np.abs(nodes[further] - at)
            self._seen[k] = list(zip(further.tolist(), away.tolist(), strict=True))
        return self._seen[k]

    def _away(self, points: Points) -> Floats:
        """(k, m): squared distance [m2] of points (k,) from walls (m,)."""
        return _squared(points[:, None], self._first, self._last)

    def _within(self, walls: list[int]) -> tuple[complex, float]:
        """A circle around these walls and all that is kept off them."""
        corners = self._first[[*walls, walls[-1]]]
        corners[-1] = self._last[walls[-1]]
        middle = complex(corners.mean())
        far = float(np.abs(corners - middle).max() + self._reach[walls].max())
        return middle, far + _ROUNDING_M

    def _off(self, a: complex, b: Points, least: Floats, *, free: bool = False) -> Bools:
        """(k,): lines from a to b (k,) that keep so far off the walls (m,). `free`: their ends are
        known to."""
        lines, walls, gaps = self._near(a, b, free=free)
        clear = np.ones(len(b), dtype=np.bool_)
        clear[lines[gaps <= _squares(least)[walls]]] = False
        return clear

    def _near(
        self, a: complex, b: Points, *, free: bool = False
    ) -> tuple[Indices, Indices, Floats]:
        """Each line from a to b (k,) with each wall that it may touch: both by index, and their
        squared distance [m2]; 0 where they cross. `free`: the ends are known to be.

        Squares, and most walls by the circle around their zone alone: a flight looks at all walls
        several times a second.
        """
        may = _squared(self._middles, np.array(a), b[:, None]) <= self._ranges
        lines, walls = np.nonzero(may[:, self._group])
        start, end, c, d = np.array(a), b[lines], self._first[walls], self._last[walls]
        gaps = np.minimum(_squared(c, start, end), _squared(d, start, end))
        if not free:
            gaps = np.minimum(gaps, np.minimum(_squared(start, c, d), _squared(end, c, d)))
        crossing = _side(start, end, c) * _side(start, end, d) < 0
        crossing &= _side(c, d, start) * _side(c, d, end) < 0
        return lines, walls, np.where(crossing, 0.0, gaps)


_NO_POINTS: Final = np.zeros(0, dtype=np.complex128)


def _complex(points: Sequence[Point]) -> Points:
    return np.array([complex(*point) for point in points], dtype=np.complex128)


def _around(corners: Points, reach: float, beside_m: float) -> Points:
    """Nodes around corners: on the polygon around the circle of what is kept, so that the line from
    one to the next keeps it as well."""
    out = reach / math.cos(math.pi / _ROUND) + beside_m
    ring = np.exp(2j * np.pi * np.arange(_ROUND) / _ROUND)
    nodes: Points = (corners[:, None] + out * ring[None, :]).ravel()
    return nodes


def _inside(corners: Points, points: Points) -> Bools:
    polygon = [(float(corner.real), float(corner.imag)) for corner in corners]
    north, east = corners.real, corners.imag
    found: Bools = (points.real >= north.min()) & (points.real <= north.max())
    found &= (points.imag >= east.min()) & (points.imag <= east.max())
    for k in np.flatnonzero(found).tolist():
        found[k] = inside(polygon, (float(points[k].real), float(points[k].imag)))
    return found


def _squares(reach: Floats) -> Floats:
    """Signed squares of what is kept, less a rounding: where that is nothing, all is free."""
    least = reach - 1e-9
    return least * np.abs(least)


def _squared(p: Points, a: Points, b: Points) -> Floats:
    """Squared distance [m2] of points from lines."""
    north, east = b.real - a.real, b.imag - a.imag
    off_n, off_e = p.real - a.real, p.imag - a.imag
    length = np.maximum(north * north + east * east, 1e-300)
    share = np.minimum(np.maximum((off_n * north + off_e * east) / length, 0.0), 1.0)
    off_n, off_e = off_n - share * north, off_e - share * east
    squares: Floats = off_n * off_n + off_e * off_e
    return squares


def _side(a: Points, b: Points, p: Points) -> Floats:
    sides: Floats = (b.real - a.real) * (p.imag - a.imag) - (b.imag - a.imag) * (p.real - a.real)
    return sides


def _meeting(a: complex, b: complex, c: complex, d: complex) -> complex | None:
    """Where the line from a on past b meets that from d back past c; None: they do not, or far
    off."""
    one, other = b - a, c - d
    turn = (one.conjugate() * other).imag
    if abs(turn) < 1e-9 * abs(one) * abs(other):
        return None
    meet = a + ((c - a).conjugate() * other).imag / turn * one
    ahead = ((meet - b) * one.conjugate()).real >= 0.0 <= ((meet - c) * other.conjugate()).real
    longer = (abs(meet - b) + abs(meet - c)) / abs(c - b)
    return meet if ahead and longer <= _LONGER and abs(c - b) <= _CORNER_M else None
