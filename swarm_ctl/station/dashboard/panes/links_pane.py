"""The links screen: bad links in words, the mesh as a matrix, and the links to vehicles and to this
station."""

from __future__ import annotations

from typing import Final

from textual.app import ComposeResult
from textual.containers import VerticalScroll

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.text import printable
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import DASH, StyledLine, fit, level_line
from swarm_ctl.station.dashboard.drawing.widgets import (
    CellTable,
    Heading,
    Painted,
    TableCell,
    Trend,
)
from swarm_ctl.station.dashboard.panes.link_matrix import (
    LINK_STYLE,
    listener_lines,
    matrix_lines,
    ms,
    percent,
)
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.link_quality import (
    Judgement,
    bad_links,
    judge_station,
    judge_vehicle,
    mesh_judgements,
)
from swarm_ctl.station.picture.view import AgentView, SwarmView

_SENTENCES: Final = 5
_HEADINGS: Final = (
    Heading("agent", 6),
    Heading("vehicle: beat", 15),
    Heading("loss", 5),
    Heading("trip", 7),
    Heading("station: age", 14),
    Heading("p50/p99 ms", 10),
    Heading("loss", 5),
    Heading("trip", 8),
)
_TREND: Final = 40


class LinksPane(Pane):
    """Every link of the swarm."""

    def compose(self) -> ComposeResult:
        with VerticalScroll(can_focus=False):
            yield Painted("matrix")
            yield CellTable("other-links")

    def draw(self, picture: Picture) -> None:
        matrix, table = self.query_one("#matrix", Painted), self.query_one(CellTable)
        judged = mesh_judgements(picture.view)
        all_hear = hears_all(picture.view.plan)
        lines = (
            matrix_lines(picture, judged, matrix.room[0])
            if all_hear
            else listener_lines(picture, judged)
        )
        matrix.paint([*_sentences(picture.view, judged), *lines, StyledLine()])
        rest = min(_TREND, table.room - sum(heading.width + 1 for heading in _HEADINGS) - 1)
        trend = (Heading("trips so far", rest, left=True),) if rest >= 12 else ()
        rows = {
            str(agent.id): _row(agent, picture.view, rest if trend else 0)
            for agent in picture.view.agents
        }
        table.show((*_HEADINGS, *trend), rows)


def _sentences(view: SwarmView, judged: dict[tuple[int, int], Judgement]) -> list[StyledLine]:
    bad = bad_links(view, judged)
    if bad:
        lines = [level_line(level, printable(text)) for level, text in bad[:_SENTENCES]]
        more = len(bad) - _SENTENCES
        return lines + ([StyledLine(f"   and {more} more", "yellow")] if more > 0 else [])
    heard = sum(judgement.level is Level.WELL for judgement in judged.values())
    if heard:
        return [level_line(Level.WELL, f"{heard} mesh links, all well")]
    return [level_line(Level.WAITING, "no mesh link yet")]


def _row(agent: AgentView, view: SwarmView, trend: int) -> list[TableCell]:
    """The agent's link to its vehicle, and to this station."""
    vehicle, station = (
        LINK_STYLE[judgement.level] for judgement in (judge_vehicle(agent), judge_station(agent))
    )
    status, link, ended = agent.status, agent.link, agent.phase is Phase.ENDED
    report = status.vehicle_link if status else None
    beat_s = status.heartbeat_age_s if status and not ended else None
    told = report.received + report.lost if report else 0
    words = (
        (str(agent.id), "bold"),
        (_unit(fit(beat_s, 5, 1), "s"), vehicle),
        (percent(report.lost / told) if report and told else DASH, ""),
        (_unit(ms(report.round_trip_s if report else None), "ms"), ""),
        (_unit(fit(None if ended else link.age_s, 4, 2), "s"), station),
        (f"{ms(link.age_p50_s)}/{ms(link.age_p99_s)}", station),
        (percent(link.recent_loss) if link.received else DASH, station),
        (_unit(_trip_ms(agent.round_trip_s), "ms"), ""),
    )
    row: list[TableCell] = [h.cell(*cell) for h, cell in zip(_HEADINGS, words, strict=True)]
    trips = view.histories.round_trips_s.get(agent.id, ())
    return [*row, Trend(trips, trend)] if trend else row


def _trip_ms(seconds: float | None) -> str:
    return fit(None if seconds is None else 1000 * seconds, 4, 1)


def _unit(figure: str, unit: str) -> str:
    return figure if figure == DASH else f"{figure} {unit}"
