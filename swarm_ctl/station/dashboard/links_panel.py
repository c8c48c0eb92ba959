"""The mesh as a matrix (who hears whom how well), the links to vehicles and to this station, and
the bad ones in words.

Ages are mission time; the matrix' rows listen, its columns speak. All mesh links are direct: there
is no hop between.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.text import printable
from swarm_ctl.station.dashboard.columns import LEVEL_STYLE, UNICODE, fit
from swarm_ctl.station.dashboard.picture import Picture
from swarm_ctl.station.dashboard.styled_line import Line, right, sparkline
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.history import LinkSeries
from swarm_ctl.station.picture.link_quality import (
    AGE_ERROR_S,
    AGE_WARNING_S,
    LOSS_ERROR,
    LOSS_WARNING,
    Judgement,
    bad_links,
    jitter_s,
    judge_station,
    judge_vehicle,
    mesh_judgements,
)
from swarm_ctl.station.picture.view import AgentView, LinkView

_DASH: Final = UNICODE.dash
_SIGN: Final = {Level.WELL: "·", Level.WAITING: " ", Level.WARNING: "!", Level.ERROR: "✗"}
_STYLE: Final = LEVEL_STYLE | {Level.WAITING: "dim"}


@dataclass(frozen=True, slots=True)
class Metric:
    """What a matrix cell can say about a link: in few characters, and in enough."""

    title: str
    short: Callable[[LinkView, LinkSeries], str]
    """At most 4 characters."""
    long: Callable[[LinkView, LinkSeries], str]
    """At most 9 characters."""


def _ms(seconds: float | None, width: int = 4) -> str:
    return fit(None if seconds is None else 1000 * seconds, width, 0)


def _ahead(seconds: float | None, trip_s: float | None = None) -> str:
    """At most 4 characters: ms, or a larger unit that is named; and at most 5 more for half the
    round trip in ms."""
    if seconds is None:
        return _DASH
    if trip_s is not None:
        return f"{_ahead(seconds)}±{_ms(0.5 * trip_s)}"
    for most, size, unit in (
        (0.9995, 0.001, ""),
        (99.5, 1.0, "s"),
        (5970.0, 60.0, "m"),
        (358000.0, 3600.0, "h"),
    ):
        if abs(seconds) < most:
            return f"{seconds / size:+.0f}{unit}"
    return f"{seconds / 86400.0:+.0f}d"[:4]


def _percent(share: float) -> str:
    return f"{100 * share:.0f}%"


METRICS: Final[dict[str, Metric]] = {
    "age": Metric(
        "age of a state in ms, p50/p99 of the run",
        lambda link, _: _ms(link.report.age_p99_s),
        lambda link, _: f"{_ms(link.report.age_p50_s)}/{_ms(link.report.age_p99_s)}",
    ),
    "loss": Metric(
        "loss over the last 10 s (and of the run)",
        lambda _, series: _percent(series.recent_loss),
        lambda link, series: f"{_percent(series.recent_loss)} ({_percent(_run_loss(link))})",
    ),
    "jitter": Metric(
        "jitter in ms: p99 less p50 of the ages",
        lambda link, _: _ms(jitter_s(link.report.age_p50_s, link.report.age_p99_s)),
        lambda link, _: _ms(jitter_s(link.report.age_p50_s, link.report.age_p99_s)),
    ),
    "clock": Metric(
        "clock of tx ahead of rx, ms ± half a trip",
        lambda link, _: _ahead(link.report.clock_ahead_s),
        lambda link, _: _ahead(link.report.clock_ahead_s, link.report.round_trip_s),
    ),
    "history": Metric(
        "age of the newest state, the last 20 s",
        lambda _, series: sparkline(series.ages_s, 4, AGE_WARNING_S),
        lambda _, series: sparkline(series.ages_s, 9, AGE_WARNING_S),
    ),
}


def _run_loss(link: LinkView) -> float:
    told = link.report.lost + link.report.received
    return link.report.lost / told if told else 0.0


def links_lines(picture: Picture, width: int) -> list[Line]:
    """The whole screen, as many lines as it takes."""
    judged = mesh_judgements(picture.view)
    return [
        *_sentences(picture, judged),
        *_matrix(picture, judged, width),
        Line(),
        *_other_links(picture, width),
    ]


def _sentences(picture: Picture, judged: dict[tuple[int, int], Judgement]) -> list[Line]:
    bad = bad_links(picture.view, judged)
    if not bad:
        heard = sum(judgement.level is Level.WELL for judgement in judged.values())
        words = (
            f" {UNICODE.well} {heard} mesh links, all direct, all well"
            if heard
            else " … no mesh link yet"
        )
        return [Line(words, "green" if heard else "cyan")]
    lines = [
        Line(f" {UNICODE.of(level)} {printable(text)}", LEVEL_STYLE[level])
        for level, text in bad[:5]
    ]
    return lines + ([Line(f"   and {len(bad) - 5} more", "yellow")] if len(bad) > 5 else [])


def _matrix(picture: Picture, judged: dict[tuple[int, int], Judgement], width: int) -> list[Line]:
    ids = [agent.id for agent in picture.view.agents]
    room = (width - 7) // max(1, len(ids))
    size = 9 if room >= 10 else 4 if room >= 5 else 1
    metric = METRICS[picture.chosen.metric]
    gap = " " if size > 1 else ""
    title = Line(" ").add("v", "bold").add(f" {metric.title}", "dim")
    for name in METRICS:
        style = "bold reverse" if name == picture.chosen.metric else "underline"
        title.add("  ").add(name, style, f"app.metric('{name}')")
    head = Line(right("rx\\tx", 6), "dim")
    links = {(link.receiver, link.sender): link for link in picture.view.links}
    series = picture.view.histories.links
    for i in ids:
        head.add(gap + right(str(i)[-size:], size), "bold")
    lines = [title, head]
    for receiver in ids:
        line = Line(right(str(receiver), 6), "bold")
        for sender in ids:
            link = links.get((receiver, sender))
            line.add(gap)
            if link is None:
                line.add(right("" if receiver == sender else _DASH, size), "dim")
                continue
            level = judged[receiver, sender].level
            told = series.get((receiver, sender), LinkSeries())
            words = (
                _SIGN[level]
                if size == 1
                else metric.long(link, told)
                if size == 9
                else metric.short(link, told)
            )
            line.add(right(words, size), _STYLE[level])
        lines.append(line)
    return lines


def _other_links(picture: Picture, width: int) -> list[Line]:
    """Each agent's link to its vehicle, and to this station."""
    spark = max(0, min(40, width - 76))
    head = Line(right("agent", 6), "bold dim").add(" │ ", "dim")
    head.add("vehicle: beat  loss   trip", "bold dim").add(" │ ", "dim")
    head.add("station: age  p50/p99 ms  loss    trip", "bold dim")
    if spark >= 18:
        head.add("  trips so far", "bold dim")
    return [head, *(_agent_line(picture, agent, spark) for agent in picture.view.agents)]


def _agent_line(picture: Picture, agent: AgentView, spark: int) -> Line:
    vehicle, station = judge_vehicle(agent), judge_station(agent)
    status = agent.status
    report = status.vehicle_link if status else None
    line = Line(right(str(agent.id), 6), "bold").add(" │ ", "dim")
    ended = agent.phase is Phase.ENDED
    beat = None if ended or status is None else status.heartbeat_age_s
    line.add(
        right(f"{fit(beat, 5, 1)} s" if beat is not None else _DASH, 13), _STYLE[vehicle.level]
    )
    told = report.received + report.lost if report else 0
    line.add(right(_percent(report.lost / told) if report and told else _DASH, 6))
    line.add(
        right(
            f"{_ms(report.round_trip_s)} ms"
            if report and report.round_trip_s is not None
            else _DASH,
            7,
        )
    )
    line.add(" │ ", "dim")
    link = agent.link
    age = None if ended else link.age_s
    line.add(right(f"{fit(age, 4, 2)} s" if age is not None else _DASH, 12), _STYLE[station.level])
    line.add(right(f"{_ms(link.age_p50_s)}/{_ms(link.age_p99_s)}", 12), _STYLE[station.level])
    line.add(
        right(_percent(link.recent_loss) if link.received else _DASH, 6), _STYLE[station.level]
    )
    trip = agent.round_trip_s
    line.add(right(f"{fit(1000 * trip, 4, 1)} ms" if trip is not None else _DASH, 8))
    if spark >= 18:
        line.add(
            "  " + sparkline(picture.view.histories.round_trips_s.get(agent.id, ()), spark - 2),
            "cyan",
        )
    return line


LEGEND: Final = (
    f"Yellow: a state older than {1000 * AGE_WARNING_S:.0f} ms or {LOSS_WARNING:.0%} lost in 10 s; "
    f"red: {1000 * AGE_ERROR_S:.0f} ms or {LOSS_ERROR:.0%}."
)
