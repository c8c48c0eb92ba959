"""The cells of the agents' table, told from the view alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from rich.cells import cell_len, set_cell_size

from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.text import printable
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.view import AgentView, SwarmView


@dataclass(frozen=True, slots=True)
class Glyphs:
    """Signs beside the colours."""

    well: str = "✓"
    waiting: str = "…"
    warning: str = "!"
    error: str = "✗"
    armed: str = "●"
    disarmed: str = "○"
    dash: str = "–"
    sigma: str = "σ"
    times: str = "×"
    dot: str = "·"
    line: str = "─"

    def of(self, level: Level) -> str:
        """The sign of a level."""
        return (self.well, self.waiting, self.warning, self.error)[level]


UNICODE: Final = Glyphs()

LEVEL_STYLE: Final = {
    Level.WELL: "green",
    Level.WAITING: "cyan",
    Level.WARNING: "yellow",
    Level.ERROR: "bold red",
}

_PHASE_STYLE: Final = {
    Phase.FLY: "green",
    Phase.HOLD: "yellow",
    Phase.YIELD: "bold yellow",
    Phase.LAND: "cyan",
    Phase.TAKEOFF: "cyan",
    Phase.ARM: "cyan",
}


@dataclass(frozen=True, slots=True)
class Row:
    """What a cell is made from."""

    view: SwarmView
    agent: AgentView
    level: Level
    """The agent's worst alarm."""
    glyphs: Glyphs


Cell: TypeAlias = str | tuple[str, str]
"""Words, or words and their style."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column: title, cells of at most `width` characters, and the narrowest screen that has
    it."""

    title: str
    width: int
    cell: Callable[[Row, int], Cell]
    from_width: int = 0
    justify: Literal["left", "right"] = "right"
    below_width: int = 10_000
    """Screens from this width on have something better."""

    def place(self, words: str) -> str:
        """`words` at their place in the column's width, cut if need be."""
        words = set_cell_size(words, self.width) if cell_len(words) > self.width else words
        room = " " * (self.width - cell_len(words))
        return room + words if self.justify == "right" else words + room


def fit(value: float | None, width: int, decimals: int, glyphs: Glyphs = UNICODE) -> str:
    """A number with as many of its decimals as fit into `width`; a dash for none."""
    if value is None:
        return glyphs.dash
    for places in range(decimals, -1, -1):
        text = f"{value:.{places}f}"
        if len(text) <= width:
            return text
    return "9" * (width - 1) + "+" if value > 0 else "-" * width


def id_cell(row: Row, width: int) -> Cell:
    """Its id, with the sign of its worst alarm."""
    alarm = row.level >= Level.WARNING
    mark = row.glyphs.of(row.level) if alarm else " "
    return f"{mark}{row.agent.id:>{width - 1}}", LEVEL_STYLE[row.level] if alarm else "bold"


def phase_cell(row: Row, _: int) -> Cell:
    """Its phase in its colour."""
    agent = row.agent
    if agent.lost:
        return "SILENT", "bold red"
    if agent.phase is None:
        return "unheard", "dim"
    return agent.phase.name.lower(), _PHASE_STYLE.get(agent.phase, "")


def step_cell(row: Row, width: int) -> str:
    """Its step by name, ticked off when done."""
    told = row.agent.newest
    if told is None:
        return row.glyphs.dash
    name = step_name(row.view.plan, told.step)
    done = f" {row.glyphs.well}" if told.done else ""
    if len(name + done) > width:
        name = name.partition(" ")[0]
    return (
        name + done
        if len(name + done) <= width
        else name[: width - len(done.strip())] + done.strip()
    )


def mode_cell(row: Row, _: int) -> str:
    """The autopilot's own word for its mode."""
    return (
        printable(row.agent.status.mode)
        if row.agent.status and row.agent.status.mode
        else row.glyphs.dash
    )


def armed_sign_cell(row: Row, _: int) -> str:
    """Armed or not, in one character."""
    if row.agent.status is None:
        return " "
    return row.glyphs.armed if row.agent.status.armed else row.glyphs.disarmed


def numbers(of: Callable[[Row], float | None], decimals: int) -> Callable[[Row, int], str]:
    """Cells of one figure."""
    return lambda row, width: fit(of(row), width, decimals, row.glyphs)


def coordinate(axis: int, sign: int = 1) -> Callable[[Row], float | None]:
    """One coordinate [m] of the common frame."""
    # adding zero: -0.0 is a height nobody reads
    return lambda row: (
        sign * row.agent.state.position_ned_m[axis] + 0.0 if row.agent.state else None
    )


def nearest_cell(row: Row, width: int) -> str:
    """Nearest agent and distance [m]."""
    agent = row.agent
    if agent.nearest_agent is None:
        return row.glyphs.dash
    return f"{agent.nearest_agent} {fit(agent.nearest_m, width - len(str(agent.nearest_agent)) - 1, 2)}"


def age_cell(row: Row, width: int) -> Cell:
    """Age of its newest state [s]."""
    agent = row.agent
    if agent.phase is Phase.ENDED:
        return row.glyphs.dash
    return fit(agent.link.age_s, width, 2, row.glyphs), "bold red" if agent.lost else ""


def speed_mps(row: Row) -> float | None:
    """Horizontal speed."""
    if row.agent.state is None:
        return None
    north, east, _ = row.agent.state.velocity_ned_mps
    return float((north * north + east * east) ** 0.5)


def late_ms(row: Row) -> float | None:
    """Lateness of its ticks, p99."""
    return (
        row.agent.status.tick.late_p99_ms
        if row.agent.status and row.agent.status.tick.count
        else None
    )
