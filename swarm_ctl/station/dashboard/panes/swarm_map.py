"""The swarm from above, north up, in the largest round scale that shows all agents."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from swarm_ctl.core.model.geometry import mean_of
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Point
from swarm_ctl.core.model.targets import PREDICTED_S
from swarm_ctl.station.dashboard.drawing.canvas import Canvas
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import LEVEL_STYLE, SIGN, StyledLine
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.link_quality import mesh_judgements
from swarm_ctl.station.picture.view import AgentView

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


@dataclass(frozen=True, slots=True)
class MapScale:
    """Dots of a canvas for metres: `dots_per_m`, and which point lies in the middle."""

    dots_per_m: float
    middle: Point
    width: int
    height: int

    def dot(self, point: Point) -> tuple[float, float]:
        """(column, row) in dots of (north, east) [m]."""
        north, east = point[0] - self.middle[0], point[1] - self.middle[1]
        return self.width + self.dots_per_m * east, 2 * self.height - self.dots_per_m * north

    def point(self, column: int, row: int) -> Point:
        """(north, east) [m] of a cell's middle, to the metres of `stride_m`."""
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
    drawing.zones()
    drawing.links()
    drawing.circles()
    drawing.trails()
    drawing.slots()
    drawing.agents()
    drawing.targets()
    drawing.new_zone()
    drawing.scale_bar()
    return drawing.canvas.lines()


def round_length(most_m: float) -> float:
    """The largest of 1, 2, 5, 10, ... [m] (or 0.5, 0.2, ...) that is no longer."""
    unit = 10.0 ** math.floor(math.log10(most_m))
    return max(k * unit for k in (1, 2, 5) if k * unit <= most_m)


def fitted(picture: Picture, width: int, height: int) -> MapScale:
    """The largest scale with each agent's circle and slot on the canvas, and the zone that is being
    placed."""
    view, new = picture.view, picture.chosen.new_zone
    margin = view.plan.law.r_out * view.plan.unit_m / 2
    points = [position(agent) for agent in view.agents if agent.state is not None]
    points += [agent.target_m for agent in view.agents if agent.target_m is not None]
    points += [t.at_m for t in view.targets if math.dist(t.at_m, points[0]) < _SHOWN_M]
    if new is not None:
        (north, east), r = new.centre_m, new.radius_m
        points += [(north - r, east - r), (north + r, east + r)]
    array = np.array(points)
    low, high = array.min(axis=0) - margin, array.max(axis=0) + margin
    tall, wide = np.maximum(high - low, 4 * margin).tolist()
    most = min((4 * height - 2) / tall, (2 * width - 2) / wide)
    dots_per_m = _STEP ** math.floor(math.log(most, _STEP))
    grid = 8 / dots_per_m  # two rows: a drifting agent does not make the picture tremble
    middle = np.round((low + high) / 2 / grid) * grid
    room = (4 * height - 2) / dots_per_m - tall, (2 * width - 2) / dots_per_m - wide
    spare = np.array(room) / 2
    middle = np.clip(middle, (low + high) / 2 - spare, (low + high) / 2 + spare)
    return MapScale(dots_per_m, (float(middle[0]), float(middle[1])), width, height)


def position(agent: AgentView) -> Point:
    """(north, east) [m] of an agent that has been heard."""
    return agent.state.position_ned_m[:2] if agent.state else (math.nan, math.nan)


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
        plan, outlines = view.plan, [(zone.outline_m, "red") for zone in view.zones]
        outlines += [(plan.fence.polygon_m, "red dim")] if plan.fence else []
        for outline, name in outlines:
            for a, b in zip(outline, (*outline[1:], *outline[:1]), strict=True):
                self.canvas.line(dot(a), dot(b), name, every=2.0)
        for zone in view.zones:
            x, y = dot(mean_of(zone.corners_m))
            self.canvas.words(int(x // 2) - len(zone.name) // 2, int(y // 4), zone.name, "red")

    def links(self) -> None:
        levels = self._link_levels()
        crowded = len(levels) > _CROWDED * len(self.placed)
        for (a, b), level in sorted(levels.items(), key=lambda item: item[1]):
            bad = level >= Level.WARNING
            if bad or not crowded:
                here, there = (self.scale.dot(position(self.placed[i])) for i in (a, b))
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
                name = "yellow" if agent.id in near else "blue"
                self.canvas.circle(self.scale.dot(position(agent)), radius, name)

    @functools.cached_property
    def full(self) -> bool:
        """Ids would lie over each other."""
        last: dict[int, int] = {}
        for column, row, width in sorted(self._place(a) for a in self.placed.values()):
            if column <= last.get(row, -1):
                return True
            last[row] = column + width - 1
        return False

    def _place(self, agent: AgentView) -> tuple[int, int, int]:
        """Column, row and width of its id."""
        x, y = self.scale.dot(position(agent))
        width = len(str(agent.id))
        return int(x // 2) - (width - 1) // 2, int(y // 4), width

    def trails(self) -> None:
        scale, short = self.scale, self.full or len(self.placed) > _LARGE
        for whole in self.picture.view.histories.trails.values():
            trail = whole[-_SHORT_TRAIL:] if short else whole
            if len(trail) > 1:
                north, east = np.array(trail).T
                x = scale.width + scale.dots_per_m * (east - scale.middle[1])
                y = 2 * scale.height - scale.dots_per_m * (north - scale.middle[0])
                self.canvas.dots(x, y, "cyan")

    def slots(self) -> None:
        for agent in self.picture.view.agents:
            if agent.target_m is not None:
                x, y = self.scale.dot(agent.target_m)
                self.canvas.words(int(x // 2), int(y // 4), "○", "bold")

    def agents(self) -> None:
        """Their ids; on a full map dots, and the ids of those that are marked or have an alarm,
        above all others."""
        levels, chosen = self.picture.levels(), self.picture.chosen
        innocent = self.picture.innocent
        told = {*chosen.marked, chosen.cursor}
        told |= {i for i, level in levels.items() if level >= Level.WARNING}
        for agent in sorted(self.placed.values(), key=lambda agent: agent.id in told):
            level = levels.get(agent.id, Level.WELL)
            name = "bold green" if agent.airborne and agent.id not in innocent else "dim"
            if agent.id in chosen.marked:
                name = "bold magenta"
            elif level >= Level.WARNING:
                name = LEVEL_STYLE[level]
            name += " reverse" if agent.id == chosen.cursor else ""
            column, row, width = self._place(agent)
            sign = SIGN[level] if level >= Level.WARNING else ""
            words = str(agent.id) + sign
            if self.full and agent.id not in told:
                column, words = column + (width - 1) // 2, _DOT
            self.canvas.words(column, row, words, name, f"app.mark({agent.id})")

    def targets(self) -> None:
        """A sign and the name of each; where its news is old, how old."""
        for target in self.picture.view.targets:
            x, y = self.scale.dot(target.at_m)
            old = target.age_s > PREDICTED_S
            age = f" {target.age_s:.0f} s ago" if old else ""
            if not old and target.off_m is not None:
                age = f" {target.off_m:.1f} m off"
            style = "bold yellow" if old else "bold"
            self.canvas.words(int(x // 2), int(y // 4), f"◎ {target.name}{age}", style)

    def new_zone(self) -> None:
        """The one that is being placed, and its centre."""
        new = self.picture.chosen.new_zone
        if new is not None:
            x, y = self.scale.dot(new.centre_m)
            self.canvas.circle((x, y), new.radius_m * self.scale.dots_per_m, "bold red")
            self.canvas.words(int(x // 2), int(y // 4), "+", "bold red reverse")

    def scale_bar(self) -> None:
        """A bar of a round length and where north is."""
        canvas, dots_per_m = self.canvas, self.scale.dots_per_m
        length_m = round_length(min(20, canvas.width // 3) * 2 / dots_per_m)
        cells = max(2, round(length_m * dots_per_m / 2))
        canvas.words(1, canvas.height - 1, f"├{'─' * (cells - 2)}┤ {length_m:g} m", "dim")
        canvas.words(canvas.width - 3, 0, "N↑", "dim")
