"""The mesh as a matrix: its rows listen, its columns speak; or, of a large swarm, a line for each
listener. Ages are mission time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import (
    DASH,
    LEVEL_STYLE,
    StyledLine,
    blocks,
    fit,
    right,
)
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.history import LinkSeries
from swarm_ctl.station.picture.link_quality import AGE_WARNING_S, Judgement, jitter_s
from swarm_ctl.station.picture.view import LinkView

_SIGN: Final = {Level.WELL: "·", Level.WAITING: " ", Level.WARNING: "!", Level.ERROR: "✗"}
LINK_STYLE: Final = LEVEL_STYLE | {Level.WAITING: "dim"}


@dataclass(frozen=True, slots=True)
class LinkMetric:
    """What a matrix cell can say about a link: in few characters, and in enough."""

    title: str
    short: Callable[[LinkView, LinkSeries], str]
    """At most 4 characters."""
    long: Callable[[LinkView, LinkSeries], str]
    """At most 9 characters."""


def ms(seconds: float | None) -> str:
    """Milliseconds in at most 4 characters."""
    return fit(None if seconds is None else 1000 * seconds, 4, 0)


def percent(share: float) -> str:
    """A share (0..1) in at most 4 characters."""
    return f"{100 * share:.0f}%"


def _ahead(seconds: float | None, trip_s: float | None = None) -> str:
    """At most 4 characters: ms, or a larger unit that is named; and at most 5 more for half the
    round trip in ms."""
    if seconds is None:
        return DASH
    if trip_s is not None:
        return f"{_ahead(seconds)}±{ms(0.5 * trip_s)}"
    scales = ((0.9995, 0.001, ""), (99.5, 1.0, "s"), (5970.0, 60.0, "m"), (358000.0, 3600.0, "h"))
    for most, size, unit in scales:
        if abs(seconds) < most:
            return f"{seconds / size:+.0f}{unit}"
    return f"{seconds / 86400.0:+.0f}d"[:4]


def _jitter(link: LinkView, _: LinkSeries) -> str:
    return ms(jitter_s(link.report.age_p50_s, link.report.age_p99_s))


def _run_loss(link: LinkView) -> float:
    told = link.report.lost + link.report.received
    return link.report.lost / told if told else 0.0


METRICS: Final[dict[str, LinkMetric]] = {
    "age": LinkMetric(
        "age of a state in ms, p50/p99 of the run",
        lambda link, _: ms(link.report.age_p99_s),
        lambda link, _: f"{ms(link.report.age_p50_s)}/{ms(link.report.age_p99_s)}",
    ),
    "loss": LinkMetric(
        "loss over the last 10 s (and of the run)",
        lambda _, series: percent(series.recent_loss),
        lambda link, series: f"{percent(series.recent_loss)} ({percent(_run_loss(link))})",
    ),
    "jitter": LinkMetric("jitter in ms: p99 less p50 of the ages", _jitter, _jitter),
    "clock": LinkMetric(
        "clock of tx ahead of rx, ms ± half a trip",
        lambda link, _: _ahead(link.report.clock_ahead_s),
        lambda link, _: _ahead(link.report.clock_ahead_s, link.report.round_trip_s),
    ),
    "history": LinkMetric(
        "age of the newest state, the last 20 s",
        lambda _, series: blocks(series.ages_s, 4, AGE_WARNING_S),
        lambda _, series: blocks(series.ages_s, 9, AGE_WARNING_S),
    ),
}


def matrix_lines(
    picture: Picture, judged: Mapping[tuple[int, int], Judgement], width: int
) -> list[StyledLine]:
    """What is shown, the speakers, and one line for each listener."""
    ids = [agent.id for agent in picture.view.agents]
    room = (width - 7) // max(1, len(ids))
    size = 9 if room >= 10 else 4 if room >= 5 else 1
    gap = " " if size > 1 else ""
    head = StyledLine(right("rx\\tx", 6), "dim")
    for i in ids:
        head.add(gap + right(str(i)[-size:], size), "bold")
    links = {(link.receiver, link.sender): link for link in picture.view.links}
    lines = [_choices(picture.chosen.metric), head]
    for receiver in ids:
        line = StyledLine(right(str(receiver), 6), "bold")
        for sender in ids:
            link = links.get((receiver, sender))
            if link is None:
                words, name = "" if receiver == sender else DASH, "dim"
            else:
                level = judged[receiver, sender].level
                words, name = _cell(picture, link, level, size), LINK_STYLE[level]
            line.add(gap + right(words, size), name)
        lines.append(line)
    return lines


def listener_lines(
    picture: Picture, judged: Mapping[tuple[int, int], Judgement]
) -> list[StyledLine]:
    """Of a swarm in which each agent hears a few peers at every tick: a line for each listener has
    how many, its worst link, and the peers, coloured."""
    head = StyledLine(right("rx", 6) + right("near", 6) + right("worst", 14) + "  tx", "dim")
    lines = [_choices(picture.chosen.metric), head]
    heard: dict[int, list[LinkView]] = {agent.id: [] for agent in picture.view.agents}
    for link in picture.view.links:
        heard.setdefault(link.receiver, []).append(link)
    for receiver, links in heard.items():
        line = StyledLine(right(str(receiver), 6), "bold").add(right(str(len(links)), 6))
        levels = {link.sender: judged[receiver, link.sender].level for link in links}
        if links:
            worst = max(links, key=lambda k: (levels[k.sender], k.report.age_p99_s or 0.0))
            name = LINK_STYLE[levels[worst.sender]]
            words = f"{_cell(picture, worst, levels[worst.sender], 4)} from {worst.sender}"
            line.add(right(words, 14), name).add(" ")
        for sender, level in levels.items():
            sign = _SIGN[level] if level >= Level.WARNING else ""
            line.add(f" {sender}{sign}", LINK_STYLE[level])
        lines.append(line)
    return lines


def _choices(chosen: str) -> StyledLine:
    line = StyledLine(f" {METRICS[chosen].title} (", "dim").add("v", "bold").add(")", "dim")
    for name in METRICS:
        look = "bold reverse" if name == chosen else "underline"
        line.add("  ").add(name, look, f"app.metric('{name}')")
    return line


def _cell(picture: Picture, link: LinkView, level: Level, size: int) -> str:
    if size == 1:
        return _SIGN[level]
    metric = METRICS[picture.chosen.metric]
    series = picture.view.histories.links.get((link.receiver, link.sender), LinkSeries())
    return (metric.long if size == 9 else metric.short)(link, series)
