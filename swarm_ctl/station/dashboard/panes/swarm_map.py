"""The swarm from above, north up, or from a side, heights up, in the largest round scale that shows
all agents.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from swarm_ctl.core.model.geometry import mean_of
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import GroupPlan, Point
from swarm_ctl.core.model.vehicle import Vector3
from swarm_ctl.station.dashboard.drawing.canvas import Canvas, Floats
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import ALARM_STYLE, MARKED, SIGN, StyledLine
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.link_quality import mesh_judgements
from swarm_ctl.station.picture.view import AgentView, TargetView

_STEP: Final = 1.25
"""The scale moves in steps of this factor, so that the picture stands still while agents fly."""
_LINK_STYLE: Final = {
    Level.WELL: "green dim",
    Level.WAITING: "dim",
    Level.WARNING: "yellow",
    Level.ERROR: "bold red",
}
_CROWDED: Final = 3
"""With more links per agent than this, good ones would hide everything: only the others are
drawn."""
_DOT: Final = "•"
"""An agent without a word of its own, where there is no room for all ids."""
_SHORT_TRAIL: Final = 10
"""Points of a trail on such a map, and of more than `_LARGE` agents: trails would hide all else."""
_LARGE: Final = 32
_SHOWN_M: Final = 400.0
"""A target that is farther away does not shrink the map."""
_LONG: Final = 0.95
"""Share of the interaction range from which a link counts as nearly too long."""
_AXES: Final = {"above": (0, 1), "whole": (0, 1), "south": (2, 1), "east": (2, 0)}
"""Which of north, east and up go upwards and to the right on the map that is seen from there."""
SIDES: Final = {
    "above": "N↑",
    "whole": "all of the mission, N↑",
    "south": "from the south, E→",
    "east": "from the east, N→",
}
"""Where the map is seen from, and how it says so; from above the swarm, or all that is drawn."""
_ASIDE: Final = ("south", "east")
_HOME: Final = "⌂"
_PUSHED: Final = 12
"""Cells that an id may be beside its agent, on a map from the side."""
_UP_ROOM_M: Final = 1.5
"""Above and below all that is shown, on a map from the side."""
_GROUND_M: Final = 30.0
"""Up to this height, and to twice the height of what is shown, the ground is shown there, too."""
_LABEL: Final = 7
"""Cells at the left that are left to the heights' labels there."""
_ROOMY: Final = 6
"""From so many rows on the last one is left to the scale bar there."""
_TICKS: Final = 3
"""So many heights are labelled there, or up to 2.5 times as many."""


@dataclass(frozen=True, slots=True)
class MapScale:
    """Dots of a canvas for metres: `dots_per_m`, and which point lies in the middle, as (upwards,
    to the right) on the canvas: (north, east), or from a side (height, east or north)."""

    dots_per_m: float
    middle: Point
    width: int
    height: int
    seen_from: str = "above"
    """A key of `SIDES`."""
    stretch: float = 1.0
    """Dots of a metre upwards for one of a metre to the right; of heights alone."""

    def dots(self, places: Sequence[Vector3]) -> tuple[Floats, Floats]:
        """Columns and rows in dots of (north, east, down) [m]."""
        up, right = (_seen(self.seen_from, places) - self.middle).T
        per_m = self.dots_per_m
        return self.width + per_m * right, 2 * self.height - per_m * self.stretch * up

    def dot(self, point: Point, down_m: float = 0.0) -> tuple[float, float]:
        """(column, row) in dots of (north, east) [m] at a height."""
        place = (*point, -down_m)
        up, right = _AXES[self.seen_from]
        return self.spot((place[up], place[right]))

    def spot(self, seen: Point) -> tuple[float, float]:
        """(column, row) in dots of what lies so far upwards and to the right [m]."""
        up, right = seen[0] - self.middle[0], seen[1] - self.middle[1]
        per_m = self.dots_per_m
        return self.width + per_m * right, 2 * self.height - per_m * self.stretch * up

    def point(self, column: int, row: int) -> Point:
        """(north, east) [m] of a cell's middle on a map from above, to the metres of `stride_m`."""
        north = self.middle[0] + (2 * self.height - 4 * row - 2) / self.dots_per_m
        east = self.middle[1] + (2 * column + 1 - self.width) / self.dots_per_m
        stride = self.stride_m
        return round(north / stride) * stride + 0.0, round(east / stride) * stride + 0.0

    @property
    def stride_m(self) -> float:
        """A round length (1, 2, 5, ...) of a row or less, for a cursor that moves over the map."""
        return round_length(4 / self.dots_per_m)


def map_lines(picture: Picture, width: int, height: int) -> list[StyledLine]:
    """`height` lines of `width` cells."""
    placed = {agent.id: agent for agent in picture.view.agents if agent.state is not None}
    if not placed or width < 8 or height < 3:
        return [StyledLine("  no positions yet: no map" if not placed else "", "dim")]
    scale = fitted(picture, width, height)
    drawing = _Drawing(Canvas(width, height), scale, picture, placed)
    if scale.seen_from in _ASIDE:
        drawing.heights()
        drawing.walls()
    else:
        drawing.zones()
        drawing.path()
    drawing.links()
    if scale.seen_from not in _ASIDE:
        drawing.circles()
    drawing.trails()
    drawing.homes()
    drawing.slots()
    drawing.groups()
    drawing.agents()
    drawing.targets()
    drawing.new_zone()
    drawing.target_lines()
    drawing.scale_bar()
    return drawing.canvas.lines()


def round_length(most_m: float) -> float:
    """The largest of 1, 2, 5, 10, ... [m] (or 0.5, 0.2, ...) that is no longer."""
    unit = 10.0 ** math.floor(math.log10(most_m))
    return max(k * unit for k in (1, 2, 5) if k * unit <= most_m)


def fitted(picture: Picture, width: int, height: int) -> MapScale:
    """The largest scale with all that is to be seen on the canvas. A zone is placed from above.
    From a side heights have a scale of their own, and the ground is there where it is near."""
    side = picture.chosen.seen_from
    if picture.chosen.new_zone is not None and side in _ASIDE:
        side = "above"
    margin = picture.view.plan.law.r_out * picture.view.plan.unit_m / 2
    margins = np.array((_UP_ROOM_M if side in _ASIDE else margin, margin))
    seen = _seen(side, _to_be_seen(picture, whole=side == "whole"))
    low, high = seen.min(axis=0) - margins, seen.max(axis=0) + margins
    if side in _ASIDE and 0.0 < low[0] < max(_GROUND_M, 2 * (high[0] - low[0])):
        low[0] = -_UP_ROOM_M
    size = np.maximum(high - low, 4 * margins)
    top, left, bottom = _edges(picture, side, width, height)
    dots = np.array((4 * (height - top - bottom) - 2, 2 * (width - left) - 2))
    most = dots / size
    if side not in _ASIDE:
        most[:] = most.min()
    dots_per_m = np.array([_STEP ** math.floor(math.log(each, _STEP)) for each in most.tolist()])
    grid = 8 / dots_per_m  # two rows: a drifting agent does not make the picture tremble
    middle = np.round((low + high) / 2 / grid) * grid
    spare = (dots / dots_per_m - size) / 2
    middle = np.clip(middle, (low + high) / 2 - spare, (low + high) / 2 + spare)
    up, right = dots_per_m.tolist()
    at = float(middle[0]) + 2 * (top - bottom) / up, float(middle[1]) - left / right
    return MapScale(right, at, width, height, side, up / right)


def _to_be_seen(picture: Picture, *, whole: bool) -> list[Vector3]:
    """(north, east, down) [m] of agents, slots, targets that are not far away, and the corners of
    the zone that is being placed; of the whole mission homes, paths, zones and fence, too."""
    view, new = picture.view, picture.chosen.new_zone
    places = [agent.state.position_ned_m for agent in view.agents if agent.state is not None]
    near = [t for t in view.targets if math.dist(t.at_m, places[0][:2]) < _SHOWN_M]
    places += [(*a.target_m, _slot_down_m(a)) for a in view.agents if a.target_m is not None]
    places += [(*target.at_m, _target_down_m(target)) for target in near]
    if new is not None:
        (north, east), r = new.centre_m, new.radius_m
        places += [(north - r, east - r, 0.0), (north + r, east + r, 0.0)]
    if whole:
        lines = [_path(group, view.plan.unit_m) for group in view.plan.groups]
        lines += [zone.outline_m for zone in view.zones]
        lines += [tuple(view.histories.homes.values())]
        lines += [view.plan.fence.polygon_m] if view.plan.fence else []
        places += [(*point, 0.0) for line in lines for point in line]
    return places


def _path(group: GroupPlan, unit_m: float, since: int = 0) -> tuple[Point, ...]:
    """(north, east) [m] of the ends of the legs that a group's centre flies from a step on, before
    them where it is then."""
    north, east = mean_of([agent.start for agent in group.agents])
    ends = [(north * unit_m, east * unit_m)]
    for k, step in zip(group.numbers, group.steps, strict=True):
        ends = [*(ends if k > since else ends[-1:]), *step.way_m]
    return tuple(ends)


def _edges(picture: Picture, side: str, width: int, height: int) -> tuple[int, int, int]:
    """Rows at the top, cells at the left, rows at the bottom that are left to words."""
    top = min(len(picture.view.plan.targets), height // 3)
    if side not in _ASIDE:
        return top, 0, 0
    return top, _LABEL if width >= 4 * _LABEL else 0, 1 if height >= _ROOMY else 0


def _seen(side: str, places: Sequence[Vector3]) -> Floats:
    """Upwards and to the right [m], two columns, of (north, east, down) [m], seen from there."""
    return (np.array(places) * (1.0, 1.0, -1.0))[:, _AXES[side]]


def _slot_down_m(agent: AgentView) -> float:
    """Of its slot; its own, where the mission's slots have no heights."""
    if agent.state is None:
        return 0.0
    goal_m = agent.state.goal_height_m
    return agent.state.position_ned_m[2] if goal_m is None else -goal_m


def _target_down_m(target: TargetView) -> float:
    """The origin's, where its own is not known."""
    return -(target.up_m or 0.0)


def position(agent: AgentView) -> Point:
    """(north, east) [m] of an agent that has been heard."""
    return agent.state.position_ned_m[:2] if agent.state else (math.nan, math.nan)


def _ends(block: Sequence[int], places: Mapping[int, tuple[int, int, int]]) -> tuple[int, int]:
    """First column, and the one behind the last, of ids that stand side by side about the middle of
    their places."""
    width = sum(places[i][2] + 1 for i in block) - 1
    middle = sum(places[i][0] + places[i][2] / 2 for i in block) / len(block)
    first = round(middle - width / 2)
    return first, first + width


def _touch(a: Sequence[int], b: Sequence[int], places: Mapping[int, tuple[int, int, int]]) -> bool:
    """Two such blocks, `a` to the left, leave no cell between each other."""
    return places[a[0]][1] == places[b[0]][1] and _ends(a, places)[1] >= _ends(b, places)[0]


@dataclass(frozen=True)
class _Drawing:
    """One map in the making; what is drawn later lies above."""

    canvas: Canvas
    scale: MapScale
    picture: Picture
    placed: dict[int, AgentView]
    """The agents with a position."""

    def zones(self) -> None:
        """Their outlines and names, and the fence's."""
        view, dot = self.picture.view, self.scale.dot
        plan, outlines = view.plan, [(zone.outline_m, "bold") for zone in view.zones]
        outlines += [(plan.fence.polygon_m, "")] if plan.fence else []
        for outline, name in outlines:
            for a, b in zip(outline, (*outline[1:], *outline[:1]), strict=True):
                self.canvas.line(dot(a), dot(b), name, every=2.0)
        for zone in view.zones:
            x, y = dot(mean_of(zone.corners_m))
            self.canvas.words(int(x // 2) - len(zone.name) // 2, int(y // 4), zone.name, "bold")

    def path(self) -> None:
        """Of each group's centre in its step and those to come, with a sign at the end of each
        leg."""
        view, dot = self.picture.view, self.scale.dot
        for group in view.groups:
            ends = _path(group.plan, view.plan.unit_m, group.step)
            name = self.picture.group_ink(group.name) or "dim"
            for a, b in pairwise(ends):
                self.canvas.line(dot(a), dot(b), name, every=4.0)
            for x, y in map(dot, ends[1:]):
                self.canvas.words(int(x // 2), int(y // 4), "×", name)

    def homes(self) -> None:
        """Where each agent stood before it took off."""
        for agent, home_m in self.picture.view.histories.homes.items():
            x, y = self.scale.dot(home_m)
            self.canvas.words(int(x // 2), int(y // 4), _HOME, self.inks.get(agent, "dim"))

    def walls(self) -> None:
        """Zones and fence from the side, from floor to ceiling."""
        view = self.picture.view
        fence = view.plan.fence
        if fence is not None:
            outline = fence.polygon_m or tuple(map(position, self.placed.values()))
            self._wall(outline, (0.0, fence.height_m), "", "")
        for zone in view.zones:
            ceiling_m = math.inf if zone.ceiling_m is None else zone.ceiling_m
            self._wall(zone.outline_m, (zone.floor_m or 0.0, ceiling_m), zone.name, "bold")

    def _wall(
        self, outline: Sequence[Point], heights_m: tuple[float, float], name: str, style: str
    ) -> None:
        """What is seen of it, and its name on its lower edge."""
        canvas, dot = self.canvas, self.scale.spot
        rights = [point[_AXES[self.scale.seen_from][1]] for point in outline]
        left, bottom = dot((heights_m[0], min(rights)))
        right, top = dot((heights_m[1], max(rights)))
        left, right = max(left, -2.0), min(right, 2.0 * canvas.width + 2.0)
        bottom, top = min(bottom, 4.0 * canvas.height + 4.0), max(top, -4.0)
        if left > right or top > bottom:
            return
        corners = ((left, bottom), (left, top), (right, top), (right, bottom))
        for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
            canvas.line(a, b, style, every=2.0)
        column, row = int((left + right) / 4) - len(name) // 2, int(bottom // 4)
        canvas.words(column, min(row, canvas.height - 2), name, style)

    def heights(self) -> None:
        """Round heights above the origin, labelled at the left, each with a dotted line."""
        scale, canvas, top = self.scale, self.canvas, len(self.picture.view.plan.targets)
        shown_m = 4 * canvas.height / (scale.dots_per_m * scale.stretch)
        low_m, stride_m = scale.middle[0] - shown_m / 2, round_length(shown_m / _TICKS)
        for k in range(math.ceil(low_m / stride_m), math.floor((low_m + shown_m) / stride_m) + 1):
            _, y = scale.spot((k * stride_m, 0.0))
            row, at = int(y // 4), float(math.floor(y))
            if top <= row < canvas.height - 1:  # elsewhere are other words
                canvas.line((0.0, at), (2.0 * canvas.width, at), "dim", every=8.0)
                canvas.words(0, row, f"{k * stride_m:g} m", "dim")

    def links(self) -> None:
        levels = self._link_levels()
        crowded = len(levels) > _CROWDED * len(self.placed)
        for (a, b), level in sorted(levels.items(), key=lambda item: item[1]):
            bad = level >= Level.WARNING
            if bad or not crowded:
                here, there = self._dot(self.placed[a]), self._dot(self.placed[b])
                self.canvas.line(here, there, _LINK_STYLE[level], every=1.0 if bad else 3.0)

    def _link_levels(self) -> dict[tuple[int, int], Level]:
        """Of every planned link whose ends have positions: the worse direction's level, a warning
        where it is nearly too long, an error where an end is lost."""
        view = self.picture.view
        both_ways = {pair for e in view.edges for pair in ((e.a, e.b), (e.b, e.a))}
        judged = mesh_judgements(view, both_ways)
        long_m = _LONG * view.plan.law.r * view.plan.unit_m
        found: dict[tuple[int, int], Level] = {}
        for edge in view.edges:
            a, b = self.placed.get(edge.a), self.placed.get(edge.b)
            if a is None or b is None:
                continue
            ways = ((edge.a, edge.b), (edge.b, edge.a))
            level = max((judged[p].level for p in ways if p in judged), default=Level.WAITING)
            if edge.length_m is not None and edge.length_m > long_m:
                level = max(level, Level.WARNING)
            found[edge.a, edge.b] = Level.ERROR if a.lost or b.lost else level
        return found

    def circles(self) -> None:
        """Half of r_out around each: where two touch, the avoidance begins."""
        view = self.picture.view
        near = {agent for pair in view.pairs for agent in (pair.a, pair.b)}
        radius = view.plan.law.r_out * view.plan.unit_m / 2 * self.scale.dots_per_m
        for agent in self.placed.values():
            if agent.phase is not Phase.ENDED and radius >= 3:
                name = "cyan" if agent.id in near else f"{self.inks.get(agent.id, '')} dim".strip()
                self.canvas.circle(self._dot(agent), radius, name)

    @property
    def inks(self) -> dict[int, str]:
        """By agent, its colour."""
        return self.picture.inks

    def _dot(self, agent: AgentView) -> tuple[float, float]:
        """Of one with a position."""
        return self.scale.dot(
            position(agent), agent.state.position_ned_m[2] if agent.state else 0.0
        )

    @functools.cached_property
    def full(self) -> bool:
        """Ids would lie over each other; from a side: be pushed far from their agents."""
        last: dict[int, int] = {}
        for column, row, width in sorted(self._labels.values()):
            if column <= last.get(row, -1):
                return True
            last[row] = column + width - 1
        if self.scale.seen_from not in _ASIDE:
            return False
        pushed = (abs(self._place(a)[0] - self._labels[i][0]) for i, a in self.placed.items())
        return max(pushed) > _PUSHED

    @functools.cached_property
    def _labels(self) -> dict[int, tuple[int, int, int]]:
        """Column, row and width of each agent's id. From a side agents stand behind each other:
        their ids stand beside each other then, about the place that they share."""
        found = {agent.id: self._place(agent) for agent in self.placed.values()}
        if self.scale.seen_from not in _ASIDE:
            return found
        blocks: list[list[int]] = []
        for i in sorted(found, key=lambda i: (found[i][1], found[i][0], i)):
            block = [i]
            while blocks and _touch(blocks[-1], block, found):
                block = blocks.pop() + block
            blocks.append(block)
        for block in blocks:
            column, _ = _ends(block, found)
            placed = {}
            for i in block:
                _, row, width = found[i]
                placed[i] = column, row, width
                column += width + 1
            found |= placed
        return found

    def _place(self, agent: AgentView) -> tuple[int, int, int]:
        """Column, row and width of its id."""
        x, y = self._dot(agent)
        width = len(str(agent.id))
        return int(x // 2) - (width - 1) // 2, int(y // 4), width

    def trails(self) -> None:
        scale, short = self.scale, self.full or len(self.placed) > _LARGE
        for agent, whole in self.picture.view.histories.trails.items():
            trail = whole[-_SHORT_TRAIL:] if short else whole
            if len(trail) > 1:
                self.canvas.dots(*scale.dots(trail), self.inks.get(agent, "dim"))

    def slots(self) -> None:
        for agent in self.picture.view.agents:
            if agent.target_m is not None:
                x, y = self.scale.dot(agent.target_m, _slot_down_m(agent))
                name = f"bold {self.inks.get(agent.id, '')}".strip()
                self.canvas.words(int(x // 2), int(y // 4), "○", name)

    def groups(self) -> None:
        """The name of each, below its agents or else above them, for those who see no colours; none
        lies over another."""
        view, taken = self.picture.view, set[tuple[int, int]]()
        for group in view.groups:
            placed = [self._place(self.placed[i]) for i in group.agents if i in self.placed]
            colour = self.picture.group_ink(group.name)
            if placed and colour:
                column = round(sum(column + width / 2 for column, _, width in placed) / len(placed))
                column -= len(group.name) // 2
                rows = [row for _, row, _ in placed]
                below = range(max(rows) + 1, self.canvas.height - 1)
                for row in (*below, *range(min(rows) - 1, -1, -1)):
                    cells = {(row, column + k) for k in range(-1, len(group.name) + 1)}
                    if taken.isdisjoint(cells):
                        self.canvas.words(column, row, group.name, colour)
                        taken |= cells
                        break

    def agents(self) -> None:
        """Their ids; on a full map dots, and the ids of those that are marked or have an alarm,
        above all others."""
        levels, chosen = self.picture.levels(), self.picture.chosen
        innocent = self.picture.innocent
        told = {*chosen.marked, chosen.cursor}
        told |= {i for i, level in levels.items() if level >= Level.WARNING}
        for agent in sorted(self.placed.values(), key=lambda agent: agent.id in told):
            level = levels.get(agent.id, Level.WELL)
            well = f"bold {self.inks.get(agent.id, '')}".strip()
            name = well if agent.airborne and agent.id not in innocent else "dim"
            if agent.id in chosen.marked:
                name = f"{MARKED} reverse"
            elif level >= Level.WARNING:
                name = ALARM_STYLE[level]
            name += " underline" if agent.id == chosen.cursor else ""
            column, row, width = self._place(agent) if self.full else self._labels[agent.id]
            sign = SIGN[level] if level >= Level.WARNING else ""
            words = str(agent.id) + sign
            if self.full and agent.id not in told:
                column, words = column + (width - 1) // 2, _DOT
            self.canvas.words(column, row, words, name, f"app.mark({agent.id})")

    def targets(self) -> None:
        """A sign and the name of each; where its news is old, how old."""
        for target in self.picture.view.targets:
            x, y = self.scale.dot(target.at_m, _target_down_m(target))
            age = "" if target.fresh else f" {target.age_s:.0f} s ago"
            style = "bold" if target.fresh else "bold yellow"
            self.canvas.words(int(x // 2), int(y // 4), f"◎ {target.name}{age}", style)

    def target_lines(self) -> None:
        """In the corner, a line for each: how old its news is, how far the formation is off its
        place about it, and its height."""
        view = self.picture.view
        seen = {target.name: target for target in view.targets}
        for row, name in enumerate(target.name for target in view.plan.targets):
            target = seen.get(name)
            if target is None:
                self.canvas.words(1, row, f"{name}: not heard", "dim")
                continue
            words = f"{name} {target.age_s:.1f} s"
            words += f" · off {target.off_m:.1f} m" if target.off_m is not None else ""
            words += f" · up {target.up_m:.1f} m" if target.up_m is not None else ""
            self.canvas.words(1, row, words, "" if target.fresh else "bold yellow")

    def new_zone(self) -> None:
        """The one that is being placed, and its centre."""
        new = self.picture.chosen.new_zone
        if new is not None:
            x, y = self.scale.dot(new.centre_m)
            self.canvas.circle((x, y), new.radius_m * self.scale.dots_per_m, MARKED)
            self.canvas.words(int(x // 2), int(y // 4), "+", f"{MARKED} reverse")

    def scale_bar(self) -> None:
        """A bar of a round length, and where the map is seen from."""
        canvas, dots_per_m = self.canvas, self.scale.dots_per_m
        length_m = round_length(min(20, canvas.width // 3) * 2 / dots_per_m)
        cells = max(2, round(length_m * dots_per_m / 2))
        canvas.words(1, canvas.height - 1, f"├{'─' * (cells - 2)}┤ {length_m:g} m", "dim")
        words, row = SIDES[self.scale.seen_from], 0
        if self.scale.seen_from != "above":
            row = canvas.height - 1  # heights and targets have words at the top
        canvas.words(canvas.width - len(words) - 1, row, words, "dim")
