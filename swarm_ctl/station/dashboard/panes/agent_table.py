"""The table of agents: one row each, sorted by any column; a click on a title sorts, one on a row
marks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from swarm_ctl.commands.parse import group_names
from swarm_ctl.core.model.messages import AgentStatus, Phase
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import printable
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import (
    DASH,
    LEVEL_STYLE,
    MARKED,
    SIGN,
    WELL,
    fit,
)
from swarm_ctl.station.dashboard.drawing.widgets import CellTable, Heading, Painting, TableCell
from swarm_ctl.station.dashboard.panes.groups import short
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.summaries import flown_order
from swarm_ctl.station.picture.view import AgentView

_ROOMY: Final = 103
"""From this width on there is room for whole step names."""
_PHASE_STYLE: Final = {
    Phase.FLY: "green",
    Phase.HOLD: "cyan",
    Phase.YIELD: "bold yellow",
    Phase.LAND: "cyan",
    Phase.TAKEOFF: "cyan",
    Phase.ARM: "cyan",
}


@dataclass(frozen=True, slots=True)
class AgentColumn:
    """A column: its words and their style for an agent, and what it sorts by (None goes last)."""

    heading: Heading
    words: Callable[[AgentView, Picture, int], tuple[str, str]]
    """Of an agent in a picture, for a width."""
    key: Callable[[AgentView], Any]


def _number(
    title: str, width: int, decimals: int, of: Callable[[AgentView], float | None]
) -> AgentColumn:
    """A column of figures."""
    return AgentColumn(
        Heading(title, width), lambda agent, _, room: (fit(of(agent), room, decimals), ""), of
    )


def _status(of: Callable[[AgentStatus], Any]) -> Callable[[AgentView], Any]:
    return lambda agent: of(agent.status) if agent.status else None


def _height_m(agent: AgentView) -> float | None:
    # adding zero: there is no height -0.0
    return 0.0 - agent.state.position_ned_m[2] if agent.state else None


def _speed_mps(agent: AgentView) -> float | None:
    if agent.state is None:
        return None
    north, east, _ = agent.state.velocity_ned_mps
    return float((north * north + east * east) ** 0.5)


def _phase(agent: AgentView, _: Picture, __: int) -> tuple[str, str]:
    if agent.lost:
        return "SILENT", "bold red"
    if agent.phase is None:
        return "unheard", "dim"
    return agent.phase.name.lower(), _PHASE_STYLE.get(agent.phase, "")


def _step(agent: AgentView, picture: Picture, width: int) -> tuple[str, str]:
    told, view = agent.newest, picture.view
    if told is None:
        return DASH, ""
    order = flown_order(agent, view)
    name = order or view.step_name(agent)
    done = f" {WELL}" if told.done and not order else ""
    if len(name + done) > width:
        name = name.partition(" ")[0]
    whole = len(name + done) <= width
    return (name + done if whole else name[: width - len(done.strip())] + done.strip()), ""


def _mode(agent: AgentView, _: Picture, __: int) -> tuple[str, str]:
    return (printable(agent.status.mode) if agent.status and agent.status.mode else DASH), ""


def _armed(agent: AgentView, _: Picture, __: int) -> tuple[str, str]:
    return ("" if agent.status is None else "yes" if agent.status.armed else "no"), ""


def _nearest(agent: AgentView, _: Picture, width: int) -> tuple[str, str]:
    if agent.nearest_agent is None:
        return DASH, ""
    whose = f" to {agent.nearest_agent}"
    return fit(agent.nearest_m, width - len(whose), 2) + whose, ""


def _age(agent: AgentView, _: Picture, width: int) -> tuple[str, str]:
    if agent.phase is Phase.ENDED:
        return DASH, ""
    return fit(agent.link.age_s, width, 2), "bold red" if agent.lost else ""


_ID: Final = Heading("id", 4)
"""One cell of it for the mark."""


def _group(agent: AgentView, picture: Picture, _: int) -> tuple[str, str]:
    group = picture.view.group_now(agent.id)
    return (short(group.name), picture.group_ink(group.name)) if group else (DASH, "dim")


_STEP: Final = AgentColumn(
    Heading("step", 15, left=True), _step, lambda a: a.newest and (a.newest.step, a.id)
)
_MODE: Final = AgentColumn(Heading("mode", 8, left=True), _mode, _status(lambda s: s.mode))
_GROUP: Final = AgentColumn(Heading("group", 8, left=True), _group, lambda a: a.id)
"""In the place of the mode, where a mission has groups."""
_COLUMNS: Final[tuple[AgentColumn, ...]] = (
    AgentColumn(Heading("phase", 7, left=True), _phase, lambda a: a.phase),
    _STEP,
    _MODE,
    AgentColumn(Heading("armed", 5), _armed, _status(lambda s: s.armed)),
    _number("bat%", 4, 0, _status(lambda s: s.battery_percent)),
    _number("up m", 4, 1, _height_m),
    _number("m/s", 4, 1, _speed_mps),
    _number("error m", 7, 2, lambda a: a.error_m),
    AgentColumn(Heading("nearest m", 10), _nearest, lambda a: a.nearest_m),
    AgentColumn(Heading("heard s", 7), _age, lambda a: a.link.age_s),
    _number("ticks/s", 7, 1, lambda a: a.link.tick_rate_hz),
    _number("late ms", 7, 1, _status(lambda s: s.tick.late_p99_ms if s.tick.count else None)),
)
_OF_TICKS: Final = ("ticks/s", "late ms")
"""For roomy tables: an alarm tells where they matter."""
_NARROW: Final = tuple(
    replace(c, heading=replace(c.heading, width=8)) if c is _STEP else c
    for c in _COLUMNS
    if c.heading.title not in _OF_TICKS
)
_KEYS: Final = {"id": lambda a: a.id} | {c.heading.title: c.key for c in _COLUMNS}


def titles(plan: Plan) -> tuple[str, ...]:
    """Of the columns that the table can be sorted by."""
    instead = "group" if group_names(plan) else "mode"
    return tuple(instead if title == "mode" else title for title in _KEYS)


def in_order(picture: Picture) -> list[AgentView]:
    """The agents as the table shows them."""
    chosen, view = picture.chosen, picture.view
    keyed: list[tuple[Any, AgentView]]
    if chosen.sort == "group":
        groups = {i: (k, i) for k, group in enumerate(view.groups) for i in group.agents}
        keyed = [(groups.get(agent.id), agent) for agent in view.agents]
    else:
        keyed = [(_KEYS[chosen.sort](agent), agent) for agent in view.agents]
    known = [item for item in keyed if item[0] is not None]
    known.sort(key=lambda item: item[0], reverse=chosen.backwards)
    return [agent for _, agent in known] + [agent for key, agent in keyed if key is None]


class AgentTable(CellTable):
    """All agents of a picture."""

    titles: tuple[str, ...] = ()
    """Of the columns that it shows."""

    def draw(self, picture: Picture) -> None:
        columns = _COLUMNS if self.room >= _ROOMY else _NARROW
        if group_names(picture.view.plan):
            columns = tuple(_GROUP if c.heading.title == "mode" else c for c in columns)
        self.titles = ("id", *(column.heading.title for column in columns))
        headings = [_titled(h, picture) for h in (_ID, *(column.heading for column in columns))]
        rest = self.room - sum(heading.width + 1 for heading in headings) - 1
        if rest >= len("alarms"):
            headings.append(Heading("alarms", rest, left=True))
        levels, alarms = picture.levels(), _alarm_names(picture)
        innocent = picture.innocent
        agents = in_order(picture)
        rows = {}
        for agent in agents:
            click, level = f"app.mark({agent.id})", levels.get(agent.id, Level.WELL)
            dim = "dim" if agent.phase is Phase.ENDED or agent.id in innocent else ""
            row: list[TableCell] = [_id_cell(picture, agent, level, dim, click)]
            for column, heading in zip(columns, headings[1:], strict=False):
                words, name = column.words(agent, picture, heading.width)
                row.append(heading.cell(words, f"{dim} {name}".strip(), click))
            if len(headings) > len(row):
                row.append(
                    headings[-1].cell(alarms.get(agent.id, ""), dim or LEVEL_STYLE[level], click)
                )
            rows[str(agent.id)] = row
        self.show(tuple(headings), rows)
        self._place_cursor([agent.id for agent in agents], picture.chosen.cursor)

    def _place_cursor(self, ids: list[int], cursor: int) -> None:
        self.show_cursor = cursor in ids
        if cursor in ids:
            self.move_cursor(row=ids.index(cursor), animate=False)


def _titled(heading: Heading, picture: Picture) -> Heading:
    """The sorted column's title is underlined, with an arrow where there is room."""
    if heading.title != picture.chosen.sort:
        return heading
    arrow = "▾" if picture.chosen.backwards else "▴"
    title = heading.title
    if len(title) < heading.width:
        title = title + arrow if heading.left else arrow + title
    return Heading(title, heading.width, heading.left, "bold underline")


def _id_cell(picture: Picture, agent: AgentView, level: Level, dim: str, click: str) -> Painting:
    """The mark, the sign of the worst alarm, the id in the agent's colour."""
    mark = "◆" if agent.id in picture.chosen.marked else " "
    own = dim or f"bold {picture.inks.get(agent.id, '')}".strip()
    if level >= Level.WARNING:
        own = LEVEL_STYLE[level]
        sign = "" if agent.id >= 100 else SIGN[level]
    else:
        sign = "" if agent.id >= 100 else " "
    return Painting(((mark, MARKED), (f"{sign}{agent.id:>2} ", own)), click)


def _alarm_names(picture: Picture) -> dict[int, str]:
    """The names of each agent's alarms."""
    found: dict[int, dict[str, None]] = {}
    for alarm in picture.alarms:
        for agent in alarm.agents:
            found.setdefault(agent, {})[alarm.name] = None
    return {agent: ", ".join(names) for agent, names in found.items()}
