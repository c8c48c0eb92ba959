"""The table of agents: one row each, sorted by any column; a click on a title sorts, one on a row
marks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.station.dashboard.columns import (
    LEVEL_STYLE,
    UNICODE,
    Cell,
    Column,
    Row,
    age_cell,
    armed_sign_cell,
    coordinate,
    id_cell,
    late_ms,
    mode_cell,
    nearest_cell,
    numbers,
    phase_cell,
    speed_mps,
    step_cell,
)
from swarm_ctl.station.dashboard.picture import Picture
from swarm_ctl.station.dashboard.styled_line import Line
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.view import AgentView

_ROOMY: Final = 92
"""From this width on there is room for whole step names and alarms."""


@dataclass(frozen=True, slots=True)
class Sortable:
    """A column and what it sorts by; None goes last."""

    column: Column
    key: Callable[[AgentView], Any]


def _charge(row: Row) -> float | None:
    return row.agent.status.battery_percent if row.agent.status else None


def _by(of: Callable[[Row], float | None], decimals: int) -> Callable[[Row, int], Cell]:
    return numbers(of, decimals)


def _height(agent: AgentView) -> float | None:
    return -agent.state.position_ned_m[2] if agent.state else None


def _speed(agent: AgentView) -> float | None:
    if agent.state is None:
        return None
    north, east, _ = agent.state.velocity_ned_mps
    return float((north * north + east * east) ** 0.5)


def _status(of: Callable[[Any], Any]) -> Callable[[AgentView], Any]:
    return lambda agent: of(agent.status) if agent.status else None


COLUMNS: Final[tuple[Sortable, ...]] = (
    Sortable(Column("id", 3, id_cell), lambda a: a.id),
    Sortable(Column("phase", 7, phase_cell, justify="left"), lambda a: a.phase),
    Sortable(
        Column("step", 8, step_cell, justify="left", below_width=_ROOMY),
        lambda a: a.newest and (a.newest.step, a.id),
    ),
    Sortable(
        Column("step", 16, step_cell, _ROOMY, "left"), lambda a: a.newest and (a.newest.step, a.id)
    ),
    Sortable(Column("mode", 9, mode_cell, justify="left"), _status(lambda s: s.mode)),
    Sortable(Column("A", 1, armed_sign_cell), _status(lambda s: s.armed)),
    Sortable(Column("batt", 4, _by(_charge, 0)), _status(lambda s: s.battery_percent)),
    Sortable(Column("up", 4, _by(coordinate(2, -1), 1)), _height),
    Sortable(Column("m/s", 4, _by(speed_mps, 1)), _speed),
    Sortable(Column("err", 4, _by(lambda row: row.agent.error_m, 2)), lambda a: a.error_m),
    Sortable(Column("near", 7, nearest_cell), lambda a: a.nearest_m),
    Sortable(Column("age", 4, age_cell), lambda a: a.link.age_s),
    Sortable(
        Column("Hz", 3, _by(lambda row: row.agent.link.tick_rate_hz, 1)),
        lambda a: a.link.tick_rate_hz,
    ),
    Sortable(Column("late", 4, _by(late_ms, 1)), _status(lambda s: s.tick.late_p99_ms)),
)
TITLES: Final = tuple(dict.fromkeys(sortable.column.title for sortable in COLUMNS))


def table_lines(picture: Picture, width: int) -> list[Line]:
    """A heading and one line per agent; the last column takes the rest for alarms' names."""
    sortables = [s for s in COLUMNS if s.column.from_width <= width < s.column.below_width]
    levels = picture.levels()
    return [
        _heading(picture, sortables, width),
        *(
            _row(picture, agent, levels.get(agent.id, Level.WELL), sortables, width)
            for agent in in_order(picture)
        ),
    ]


def in_order(picture: Picture) -> list[AgentView]:
    """The agents as the table shows them."""
    chosen = picture.chosen
    key = next((s.key for s in COLUMNS if s.column.title == chosen.sort), COLUMNS[0].key)
    keyed = [(key(agent), agent) for agent in picture.view.agents]
    known = sorted(
        ((k, a) for k, a in keyed if k is not None),
        key=lambda item: item[0],
        reverse=chosen.backwards,
    )
    return [agent for _, agent in known] + [agent for k, agent in keyed if k is None]


def _heading(picture: Picture, sortables: list[Sortable], width: int) -> Line:
    line = Line(" ")
    for sortable in sortables:
        column = sortable.column
        ours = column.title == picture.chosen.sort
        arrow = (
            ("▾" if picture.chosen.backwards else "▴")
            if ours and len(column.title) < column.width
            else ""
        )
        words = column.place(
            arrow + column.title if column.justify == "right" else column.title + arrow
        )
        line.add(
            words, "bold underline" if ours else "bold dim", f"app.sort('{column.title}')"
        ).add(" ")
    return line.add("alarms", "bold dim") if width - line.width >= 8 else line


def _row(
    picture: Picture, agent: AgentView, level: Level, sortables: list[Sortable], width: int
) -> Line:
    chosen, click = picture.chosen, f"app.mark({agent.id})"
    here, marked = agent.id == chosen.cursor, agent.id in chosen.marked
    back = " reverse" if here else ""
    base = ("dim" if agent.phase is Phase.ENDED else "") + back
    line = Line("◆" if marked else " ", "bold magenta" + back, click)
    row = Row(picture.view, agent, level, UNICODE)
    for sortable in sortables:
        cell = sortable.column.cell(row, sortable.column.width)
        words, name = (cell, "") if isinstance(cell, str) else cell
        line.add(sortable.column.place(words), f"{base} {name}".strip(), click).add(
            " ", back.strip(), click
        )
    rest = width - line.width
    if rest >= 8:
        names = dict.fromkeys(alarm.name for alarm in picture.alarms if agent.id in alarm.agents)
        line.add(
            ", ".join(names),
            f"{LEVEL_STYLE[level] if names else ''}{back}".strip(),
            click,
            size=rest,
        )
    return line.add(" " * max(0, width - line.width), back.strip(), click) if here else line
