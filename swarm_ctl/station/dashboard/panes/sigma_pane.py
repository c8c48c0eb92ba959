"""The sigma screen, what the law does: every pair in the avoidance region with its sigma, D and
budget; each agent's two terms; tallies.

One row for each side of a pair: each agent tunes its own sigma. Distances in metres, the law's
figures in units.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Final

from textual.app import ComposeResult
from textual.containers import VerticalScroll

from swarm_ctl.core.model.messages import PairReport, SigmaReport
from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.core.swarm.gain_update import differences, named, planned
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import (
    DASH,
    StyledLine,
    bar,
    fit,
    gauge,
    level_line,
)
from swarm_ctl.station.dashboard.drawing.widgets import (
    CellTable,
    Heading,
    Painted,
    Painting,
    TableCell,
    Trend,
)
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.view import PairView, SwarmView

INVARIANTS: Final = ("too close", "sigma bound", "long link", "overspeed")
"""Alarms about what the law promises."""
_STATUS_STYLE: Final = {
    "paper": "green",
    "narrow": "cyan",
    "inactive": "dim",
    "overspeed": "bold yellow",
}
_RAIL: Final = 12
_SIDES: Final = (
    Heading("side", 8),
    Heading("apart", 8),
    Heading("σ", 6),
    Heading("bound", 6),
    Heading("D_lb ────── D ────── D_ub", 26, left=True),
    Heading("status", 9, left=True),
    Heading("budget", 6),
)
_TERMS: Final = (
    Heading("agent", 8),
    Heading("consensus", 10),
    Heading("repulsion", 10),
    Heading("share of repulsion (units an iteration)", 46, left=True),
)


class SigmaPane(Pane):
    """The law at work."""

    def compose(self) -> ComposeResult:
        with VerticalScroll(can_focus=False):
            yield Painted("law")
            yield CellTable("pairs")
            yield CellTable("terms")
            yield Painted("tally")

    def draw(self, picture: Picture) -> None:
        view = picture.view
        law, pairs = self.query_one("#law", Painted), self.query_one("#pairs", CellTable)
        law.paint([*_promises(picture), *_laws(view), *_no_pairs(view)])
        rest = min(32, pairs.room - sum(heading.width + 1 for heading in _SIDES) - 1)
        trend = (Heading("σ, history", rest, left=True),) if rest >= 6 else ()
        sides = (_side(view, pair, k, rest) for pair in view.pairs for k in range(len(pair.sides)))
        pairs.show(
            (*_SIDES, *trend), {str(row[0]): row[: len(_SIDES) + len(trend)] for row in sides}
        )
        terms = self.query_one("#terms", CellTable)
        pairs.display, terms.display = bool(view.pairs), any(a.sigma for a in view.agents)
        terms.show(_TERMS, {str(a.id): _term(a.id, a.sigma) for a in view.agents if a.sigma})
        tally = self.query_one("#tally", Painted)
        tally.paint(
            [StyledLine(), *_tally(view, tally.room[0]), *filter_lines(view, tally.room[0])]
        )


def budget_used(report: PairReport, law: SigmaReport | None, r: float) -> float | None:
    """Share of the connectivity budget `r / D - x / 2` (Property 1) that the agent's whole step
    |u_i| takes; over 1 the property does not hold for it. None where the pair has no D.
    """
    if law is None or report.d is None or report.d <= 0:
        return None
    room = r / report.d - report.distance / 2
    step = math.hypot(law.consensus[0] + law.avoidance[0], law.consensus[1] + law.avoidance[1])
    return step / room if room > 0 else None


def _promises(picture: Picture) -> list[StyledLine]:
    found = [alarm for alarm in picture.alarms if alarm.name in INVARIANTS]
    if found:
        return [level_line(alarm.level, printable(alarm.text)) for alarm in found]
    law, unit = picture.view.plan.law, picture.view.plan.unit_m
    words = f"no agent nearer than {law.r_in * unit:g} m, no link over {law.r * unit:g} m"
    return [level_line(Level.WELL, f"sigma over its bound, {words}")]


def _laws(view: SwarmView) -> list[StyledLine]:
    """The law in force; each of them where agents fly different ones."""
    laws, lines = view.laws, []
    for agents in laws.values():
        statuses = [agent.status for agent in agents if agent.status and agent.status.gains]
        gains = max(statuses, key=lambda status: status.time_s).gains if statuses else None
        if gains is None:
            continue
        changed = differences(planned(view.plan), gains)
        words = f"  (tuned: {changed})" if changed else "  (the mission's own)"
        line = StyledLine("   law ", "dim").add(named(gains), "bold")
        line.add(words, "" if changed else "dim")
        if len(laws) > 1:
            line.add(f"  {agents_named(agent.id for agent in agents)}", "bold red")
        lines.append(line)
    return lines


def _no_pairs(view: SwarmView) -> list[StyledLine]:
    if view.pairs:
        return []
    r_out_m = view.plan.law.r_out * view.plan.unit_m
    words = f"nothing near: no two agents are within {r_out_m:g} m (r_out), so none avoids another"
    return [StyledLine(f"   {words}")]


def _side(view: SwarmView, pair: PairView, k: int, trend: int) -> list[TableCell]:
    agent, report = pair.sides[k]
    bad = report.status in ("paper", "narrow") and report.sigma <= report.sigma_lb
    share = budget_used(report, view.agent(agent).sigma, view.plan.law.r)
    over = share is not None and share > 1
    budget = DASH if share is None else f"{100 * share:.0f}%" if share < 99.9 else ">99×"
    words = (
        (f"{agent:>3}→{report.peer:<3}", "bold" if report.neighbour else ""),
        (f"{fit(pair.distance_m, 5, 2)} m" if k == 0 else "", ""),
        (fit(report.sigma, 6, 3), "bold red" if bad else "bold"),
        (fit(report.sigma_lb, 6, 3), "dim"),
        None,
        (printable(report.status), _STATUS_STYLE.get(report.status, "")),
        (budget, "yellow" if over else ""),
    )
    series = view.histories.pairs.get((agent, report.peer))
    values = tuple(point[2] for point in series.points) if series else ()
    cells = [
        h.cell(*cell) if cell else _gauge(report) for h, cell in zip(_SIDES, words, strict=True)
    ]
    return [*cells, Trend(values, trend)]


def _gauge(report: PairReport) -> Painting:
    """D between its bounds: figures at the ends, a marker in between."""
    if report.d is None or report.d_ub <= report.d_lb:
        rail: tuple[tuple[str, str], ...] = (("·" * _RAIL, "dim"),)
    else:
        share = (report.d - report.d_lb) / (report.d_ub - report.d_lb)
        before, marker, after = gauge(share, _RAIL)
        inside = report.d_lb < report.d < report.d_ub
        rail = (before, "dim"), (marker, "bold green" if inside else "bold red"), (after, "dim")
    low, high = f" {fit(report.d_lb, 5, 2):>5} ", f" {fit(report.d_ub, 5, 2):<5}  "
    return Painting(((low, "dim"), *rail, (high, "dim")))


def _term(agent: int, report: SigmaReport) -> list[TableCell]:
    """An agent's consensus against its repulsion."""
    consensus, repulsion = math.hypot(*report.consensus), math.hypot(*report.avoidance)
    whole = consensus + repulsion
    share = repulsion / whole if whole > 0 else 0.0
    words = (
        (str(agent), "bold"),
        (fit(consensus, 8, 5), ""),
        (fit(repulsion, 8, 5), ""),
        (f"{bar(share, 40)} {100 * share:3.0f}%", "cyan"),
    )
    return [heading.cell(*cell) for heading, cell in zip(_TERMS, words, strict=True)]


def _tally(view: SwarmView, width: int) -> list[StyledLine]:
    """Pair-ticks of the whole flight by status, on as many lines as they take."""
    tally: Counter[str] = Counter()
    for agent in view.agents:
        tally.update(agent.status.sigma_tally if agent.status else {})
    whole = sum(tally.values())
    lines = [StyledLine("   tally of the flight (pair-ticks):", "bold dim")]
    for status in dict.fromkeys((*_STATUS_STYLE, *tally)):
        count = tally.get(status, 0)
        words = f"{printable(status)} {count}"
        share = f" ({100 * count / whole:.0f}%)" if count else ""
        if lines[-1].width + len(words) + len(share) + 2 > width:
            lines.append(StyledLine("  "))
        name = _STATUS_STYLE.get(status, "") if count else "dim"
        lines[-1].add("  ").add(words, name).add(share, "dim")
    return lines


def filter_lines(view: SwarmView, width: int) -> list[StyledLine]:
    """What the safety filter has made of the law's wishes, and which agents it keeps apart now."""
    if not view.plan.safety.filter:
        return [StyledLine("   safety filter:", "bold dim").add("  off", "yellow")]
    statuses = [(agent.id, agent.status) for agent in view.agents if agent.status is not None]
    reports = [(i, status.safety) for i, status in statuses]
    ticks, touched = sum(r.ticks for _, r in reports), sum(r.touched for _, r in reports)
    yielded, releases = sum(r.yielded for _, r in reports), sum(r.releases for _, r in reports)
    lines = [StyledLine("   safety filter:", "bold dim")]
    for words, name in (
        (f"  changed {100 * touched / max(1, ticks):.1f}% of the ticks", ""),
        (f"  gave way in {yielded}", "yellow" if yielded else "dim"),
        (f"  dead-locks left {releases}", "" if releases else "dim"),
    ):
        if lines[-1].width + len(words) > width:
            lines.append(StyledLine("  "))
        lines[-1].add(words, name)
    swapped = sum(len(status.roles) for _, status in statuses) // 2
    if swapped:
        lines.append(StyledLine(f"   slots exchanged {swapped}"))
    kept = [
        f"{i} from {', '.join('a stranger' if j == 0 else str(j) for j in r.kept_from)}"
        for i, r in reports
        if r.kept_from
    ]
    return [*lines, *([StyledLine(f"   now it keeps {'; '.join(kept)}", "cyan")] if kept else [])]
