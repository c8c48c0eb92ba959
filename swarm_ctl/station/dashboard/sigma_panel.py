"""What the law does: every pair in the avoidance region with its sigma, D and budget; each agent's
two terms; tallies.

One line per side of a pair: each agent tunes its own sigma. Distances in metres, the law's figures
in units.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Final

from swarm_ctl.core.model.messages import PairReport, SigmaReport
from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.core.swarm.gain_update import differences, named, planned
from swarm_ctl.station.dashboard.columns import LEVEL_STYLE, UNICODE, fit
from swarm_ctl.station.dashboard.picture import Picture
from swarm_ctl.station.dashboard.styled_line import Line, bar, gauge, right, sparkline
from swarm_ctl.station.picture.view import PairView, SwarmView

INVARIANTS: Final = ("too close", "sigma bound", "long link", "overspeed")
"""Alarms about what the law promises."""
_STATUS_STYLE: Final = {
    "paper": "green",
    "narrow": "cyan",
    "inactive": "dim",
    "overspeed": "bold yellow",
}
_STATUSES: Final = tuple(_STATUS_STYLE)


def budget_used(report: PairReport, law: SigmaReport | None, r: float) -> float | None:
    """Share of the connectivity budget `r / D - x / 2` (Property 1) that the agent's whole step
    |u_i| takes; over 1 the property does not hold for it. None where the pair has no D.
    """
    if law is None or report.d is None or report.d <= 0:
        return None
    room = r / report.d - report.distance / 2
    step = math.hypot(law.consensus[0] + law.avoidance[0], law.consensus[1] + law.avoidance[1])
    return step / room if room > 0 else None


def sigma_lines(picture: Picture, width: int) -> list[Line]:
    """The whole screen, as many lines as it takes."""
    view = picture.view
    spark = max(0, min(32, width - 81))
    return [
        *_broken(picture),
        *_laws(view),
        _heading(spark),
        *(line for pair in view.pairs for line in _pair_lines(view, pair, spark)),
        *([] if view.pairs else [Line("   nobody is in anybody's avoidance region", "dim")]),
        Line(),
        *_terms(view, width),
        Line(),
        *_tally(view, width),
        *_filter(view),
    ]


def _filter(view: SwarmView) -> list[Line]:
    """What the safety filter has made of the law's wishes, and whom it keeps apart now."""
    if not view.plan.safety.filter:
        return [Line("   safety filter:", "bold dim").add("  off", "yellow")]
    reports = [(agent.id, agent.status.safety) for agent in view.agents if agent.status is not None]
    ticks, touched = sum(r.ticks for _, r in reports), sum(r.touched for _, r in reports)
    yielded, releases = sum(r.yielded for _, r in reports), sum(r.releases for _, r in reports)
    line = Line("   safety filter:", "bold dim").add(
        f"  changed {100 * touched / max(1, ticks):.1f}% of the ticks"
    )
    line.add(f"  gave way in {yielded}", "yellow" if yielded else "dim")
    line.add(f"  dead-locks left {releases}", "" if releases else "dim")
    swapped = sum(len(agent.status.roles) for agent in view.agents if agent.status is not None) // 2
    kept = [
        f"{i} from {', '.join('a stranger' if j == 0 else str(j) for j in r.kept_from)}"
        for i, r in reports
        if r.kept_from
    ]
    lines = [line, Line(f"   slots exchanged {swapped}")] if swapped else [line]
    return [*lines, *([Line(f"   now it keeps {'; '.join(kept)}", "cyan")] if kept else [])]


def _broken(picture: Picture) -> list[Line]:
    found = [alarm for alarm in picture.alarms if alarm.name in INVARIANTS]
    if not found:
        law, unit = picture.view.plan.law, picture.view.plan.unit_m
        words = f"sigma over its bound, nobody under {law.r_in * unit:g} m, no link over {law.r * unit:g} m"
        return [Line(f" {UNICODE.well} {words}", "green")]
    return [
        Line(f" {UNICODE.of(a.level)} {printable(a.text)}", LEVEL_STYLE[a.level]) for a in found
    ]


def _laws(view: SwarmView) -> list[Line]:
    """The law in force; each of them where agents fly different ones."""
    laws, lines = view.laws, []
    for agents in laws.values():
        statuses = [
            agent.status
            for agent in agents
            if agent.status is not None and agent.status.gains is not None
        ]
        gains = max(statuses, key=lambda status: status.time_s).gains if statuses else None
        if gains is None:
            continue
        line = Line("   law ", "dim").add(named(gains), "bold")
        changed = differences(planned(view.plan), gains)
        line.add(
            "  (the mission's own)" if not changed else f"  (tuned: {changed})",
            "" if changed else "dim",
        )
        if len(laws) > 1:
            line.add(f"  {agents_named(agent.id for agent in agents)}", "bold red")
        lines.append(line)
    return lines


def _heading(spark: int) -> Line:
    line = Line(
        "   side    apart      σ  bound   D_lb ────── D ────── D_ub  status    budget", "bold dim"
    )
    return line.to(80).add(" σ, history", "bold dim") if spark >= 6 else line


def _pair_lines(view: SwarmView, pair: PairView, spark: int) -> list[Line]:
    lines = []
    for k, (agent, report) in enumerate(pair.sides):
        apart = f"{fit(pair.distance_m, 5, 2)} m" if k == 0 else ""
        line = Line(f" {agent:>3}→{report.peer:<3}", "bold" if report.neighbour else "")
        line.add(right(apart, 8))
        bad = report.status in ("paper", "narrow") and report.sigma <= report.sigma_lb
        line.add(right(fit(report.sigma, 6, 3), 7), "bold red" if bad else "bold")
        line.add(right(fit(report.sigma_lb, 6, 3), 7), "dim").add("  ")
        _gauge(line, report)
        line.add(f"  {report.status:<9}", _STATUS_STYLE.get(report.status, ""))
        share = budget_used(report, view.agent(agent).sigma, view.plan.law.r)
        words = UNICODE.dash if share is None else f"{100 * share:.0f}%" if share < 99.9 else ">99×"
        line.add(right(words, 7), "yellow" if share is not None and share > 1 else "")
        if spark >= 6:
            points = view.histories.pairs.get((agent, report.peer))
            line.to(80).add(
                " " + sparkline([p[2] for p in points.points] if points else (), spark - 1), "cyan"
            )
        lines.append(line)
    return lines


def _gauge(line: Line, report: PairReport) -> None:
    """D between its bounds: figures at the ends, a marker in between."""
    rail = 12
    line.add(right(fit(report.d_lb, 5, 2), 5), "dim").add(" ")
    if report.d is None or report.d_ub <= report.d_lb:
        line.add("·" * rail, "dim")
    else:
        before, marker, after = gauge((report.d - report.d_lb) / (report.d_ub - report.d_lb), rail)
        inside = report.d_lb < report.d < report.d_ub
        line.add(before, "dim").add(marker, "bold green" if inside else "bold red").add(
            after, "dim"
        )
    line.add(" ").add(f"{fit(report.d_ub, 5, 2):<5}", "dim")


def _terms(view: SwarmView, width: int) -> list[Line]:
    """Each agent's consensus against its repulsion."""
    active = [(agent.id, agent.sigma) for agent in view.agents if agent.sigma is not None]
    lines = [
        Line("   agent   consensus  repulsion  share of repulsion", "bold dim").add(
            "  (units an iteration)", "dim"
        )
    ]
    size = max(10, min(40, width - 48))
    for agent, report in active:
        consensus, repulsion = math.hypot(*report.consensus), math.hypot(*report.avoidance)
        whole = consensus + repulsion
        share = repulsion / whole if whole > 0 else 0.0
        line = (
            Line(f" {agent:>6}  ", "bold")
            .add(right(fit(consensus, 8, 5), 10))
            .add(right(fit(repulsion, 8, 5), 11))
        )
        lines.append(line.add("  ").add(bar(share, size), "cyan").add(f" {100 * share:3.0f}%"))
    return lines if active else [*lines, Line(f"   {UNICODE.dash}", "dim")]


def _tally(view: SwarmView, width: int) -> list[Line]:
    """Pair-ticks of the whole flight by status, on as many lines as they take."""
    tally: Counter[str] = Counter()
    for agent in view.agents:
        tally.update(agent.status.sigma_tally if agent.status else {})
    whole = sum(tally.values())
    lines = [Line("   tally of the flight (pair-ticks):", "bold dim")]
    for status in dict.fromkeys((*_STATUSES, *tally)):
        count = tally.get(status, 0)
        words = f"{printable(status)} {count}"
        share = f" ({100 * count / whole:.0f}%)" if count else ""
        if lines[-1].width + len(words) + len(share) + 2 > width:
            lines.append(Line("  "))
        lines[-1].add("  ").add(words, _STATUS_STYLE.get(status, "") if count else "dim").add(
            share, "dim"
        )
    return lines
