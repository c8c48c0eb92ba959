"""The swarm from above, north up, in the largest round scale that shows all agents."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Point
from swarm_ctl.station.dashboard.canvas import Canvas
from swarm_ctl.station.dashboard.picture import Picture
from swarm_ctl.station.dashboard.styled_line import LEVEL_STYLE, StyledLine
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.link_quality import mesh_judgements
from swarm_ctl.station.picture.view import AgentView, SwarmView

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


def map_lines(picture: Picture, width: int, height: int) -> list[StyledLine]:
    """`height` lines of `width` cells."""
    view = picture.view
    placed = {agent.id: agent for agent in view.agents if agent.state is not None}
    if not placed or width < 8 or height < 3:
        return [StyledLine("  no positions yet: no map" if not placed else "", "dim")]
    canvas = Canvas(width, height)
    scale = fitted(view, width, height)
    _draw_links(canvas, scale, picture, placed)
    _draw_circles(canvas, scale, picture, placed)
    _draw_trails(canvas, scale, view)
    _draw_slots(canvas, scale, view)
    _draw_agents(canvas, scale, picture, placed)
    _draw_scale(canvas, scale)
    lines = []
    for segments in canvas.lines():
        line = StyledLine()
        line.segments, line.width = segments, width
        lines.append(line)
    return lines


def fitted(view: SwarmView, width: int, height: int) -> MapScale:
    """The largest scale with each agent's circle and slot on the canvas."""
    margin = view.plan.law.r_out * view.plan.unit_m / 2
    points = [position(agent) for agent in view.agents if agent.state is not None]
    points += [agent.target_m for agent in view.agents if agent.target_m is not None]
    array = np.array(points)
    low, high = array.min(axis=0) - margin, array.max(axis=0) + margin
    north, east = np.maximum(high - low, 4 * margin).tolist()
    most = min((4 * height - 2) / north, (2 * width - 2) / east)
    dots_per_m = _STEP ** math.floor(math.log(most, _STEP))
    grid = 8 / dots_per_m  # two rows: a drifting agent does not make the picture tremble
    middle = np.round((low + high) / 2 / grid) * grid
    spare = (
        np.array([(4 * height - 2) / dots_per_m - north, (2 * width - 2) / dots_per_m - east]) / 2
    )
    middle = np.clip(middle, (low + high) / 2 - spare, (low + high) / 2 + spare)
    return MapScale(dots_per_m, (float(middle[0]), float(middle[1])), width, height)


def position(agent: AgentView) -> Point:
    """(north, east) [m] of an agent that has been heard."""
    return agent.state.position_ned_m[:2] if agent.state else (math.nan, math.nan)


def _draw_links(
    canvas: Canvas, scale: MapScale, picture: Picture, placed: dict[int, AgentView]
) -> None:
    view = picture.view
    judged = mesh_judgements(
        view, {pair for edge in view.edges for pair in ((edge.a, edge.b), (edge.b, edge.a))}
    )
    long_m = _LONG * view.plan.law.r * view.plan.unit_m
    worst: dict[tuple[int, int], Level] = {}
    for edge in view.edges:
        pair = (edge.a, edge.b)
        both = [judged[p].level for p in (pair, pair[::-1]) if p in judged]
        level = max(both, default=Level.WAITING)
        if edge.length_m is not None and edge.length_m > long_m and level < Level.WARNING:
            level = Level.WARNING
        if placed.get(edge.a) and placed.get(edge.b):
            worst[pair] = (
                Level.ERROR if view.agent(edge.a).lost or view.agent(edge.b).lost else level
            )
    crowded = len(worst) > _CROWDED * len(placed)
    for (a, b), level in sorted(worst.items(), key=lambda item: item[1]):
        if crowded and level < Level.WARNING:
            continue
        ends = scale.dot(position(placed[a])), scale.dot(position(placed[b]))
        canvas.line(*ends, _LINK_STYLE[level], every=1.0 if level >= Level.WARNING else 3.0)


def _draw_circles(
    canvas: Canvas, scale: MapScale, picture: Picture, placed: dict[int, AgentView]
) -> None:
    """Half of r_out around each: where two touch, the avoidance begins."""
    near = {agent for pair in picture.view.pairs for agent in (pair.a, pair.b)}
    radius = picture.view.plan.law.r_out * picture.view.plan.unit_m / 2 * scale.dots_per_m
    for agent in placed.values():
        if agent.phase is not Phase.ENDED and radius >= 3:
            canvas.circle(
                scale.dot(position(agent)), radius, "yellow" if agent.id in near else "blue"
            )


def _draw_trails(canvas: Canvas, scale: MapScale, view: SwarmView) -> None:
    for trail in view.histories.trails.values():
        if len(trail) > 1:
            points = np.array(trail)
            x = scale.width + scale.dots_per_m * (points[:, 1] - scale.middle[1])
            y = 2 * scale.height - scale.dots_per_m * (points[:, 0] - scale.middle[0])
            canvas.dots(x, y, "cyan")


def _draw_slots(canvas: Canvas, scale: MapScale, view: SwarmView) -> None:
    for agent in view.agents:
        if agent.target_m is not None:
            x, y = scale.dot(agent.target_m)
            canvas.words(int(x // 2), int(y // 4), "○", "bold")


def _draw_agents(
    canvas: Canvas, scale: MapScale, picture: Picture, placed: dict[int, AgentView]
) -> None:
    levels = picture.levels()
    for agent in placed.values():
        x, y = scale.dot(position(agent))
        level = levels.get(agent.id, Level.WELL)
        name = (
            LEVEL_STYLE[level]
            if level >= Level.WARNING
            else "bold green"
            if agent.airborne
            else "dim"
        )
        if agent.id in picture.chosen.marked:
            name = "bold magenta"
        if agent.id == picture.chosen.cursor:
            name += " reverse"
        words = str(agent.id)
        sign = {Level.WARNING: "!", Level.ERROR: "✗"}.get(level, "")
        canvas.words(
            int(x // 2) - (len(words) - 1) // 2,
            int(y // 4),
            words + sign,
            name,
            f"app.mark({agent.id})",
        )


def _draw_scale(canvas: Canvas, scale: MapScale) -> None:
    """A bar of a round length and where north is."""
    room_m = min(20, canvas.width // 3) * 2 / scale.dots_per_m
    unit = 10.0 ** math.floor(math.log10(room_m))
    length_m = max(k * unit for k in (1, 2, 5) if k * unit <= room_m)
    cells = max(2, round(length_m * scale.dots_per_m / 2))
    canvas.words(1, canvas.height - 1, f"├{'─' * (cells - 2)}┤ {length_m:g} m", "dim")
    canvas.words(canvas.width - 3, 0, "N↑", "dim")
