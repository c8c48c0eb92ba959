"""The summary for a screen. Colours always stand beside a word."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from swarm_ctl.core.model.text import printable, ranges
from swarm_ctl.report.judge.summary import AgentPair, StepSummary, Summary

_STYLE: Final = {"completed": "bold green", "aborted": "bold yellow", "failed": "bold red"}


def render_summary(summary: Summary) -> RenderableType:
    """Outcome, steps and figures as rich tables; fits into 80 columns."""
    return Group(_heading(summary), "", _steps(summary), "", _figures(summary), *_remarks(summary))


def _heading(summary: Summary) -> Text:
    text = Text.assemble(
        f"{summary.mission or 'mission'}: ",
        (summary.outcome.upper(), _STYLE[summary.outcome]),
        no_wrap=False,
    )
    return text.append(f"  {printable(summary.reason, 1000)}") if summary.reason else text


def _steps(summary: Summary) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("step")
    table.add_column("result")
    table.add_column(Text("from [s]"), justify="right")
    table.add_column(Text("to [s]"), justify="right")
    table.add_column("not done")
    for step in summary.steps:
        style = {"done": "green", "not reached": "dim"}.get(step.result, "red")
        table.add_row(
            Text(step.name),
            Text(step.result, style=style),
            _number(step.start_s, 1),
            _number(step.end_s, 1),
            _exceptions(step),
        )
    return table


def _exceptions(step: StepSummary) -> Text:
    by_result: dict[str, list[int]] = {}
    for agent, result in step.exceptions.items():
        by_result.setdefault(result, []).append(agent)
    return Text(
        "; ".join(f"{ranges(ids)} {printable(result)}" for result, ids in by_result.items())
    )


def _figures(summary: Summary) -> Table:
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(style="dim")
    table.add_column()
    for name, value, good in _rows(summary):
        table.add_row(name, Text(value, style="" if good else "bold red"))
    return table


def figures_of(summary: Summary) -> Iterator[tuple[str, str]]:
    """(name, value) of each figure."""
    return ((name, value) for name, value, _ in _rows(summary))


def _rows(s: Summary) -> Iterator[tuple[str, str, bool]]:
    """(name, value, whether it is as it should be)."""
    yield "time to form", "-" if s.time_to_form_s is None else f"{s.time_to_form_s:.1f} s", True
    left = s.formation_error_m
    yield "formation error", "-" if left is None else f"{left:.2f} m before the landing", True
    near, r_in = s.min_true_distance_m, s.r_in_m
    collided = near is not None and r_in is not None and near < r_in
    yield (
        "smallest true distance",
        _distance(near, s.min_true_pair, "r_in", r_in, collided),
        not collided,
    )
    long, r = s.longest_link_m, s.r_m
    stretched = long is not None and r is not None and long > r
    yield "longest link", _distance(long, s.longest_link_pair, "r", r, stretched), not stretched
    if s.truth is not None and s.truth.collisions:
        yield "collisions", f"sysid {ranges(s.truth.collisions)}", False
    if s.safety is not None:
        share = 100 * s.safety.touched / max(1, s.safety.ticks)
        more = (
            (s.safety.releases, "ways out of dead-locks"),
            (s.safety.exchanges, "slots exchanged"),
        )
        told = "".join(f", {count} {what}" for count, what in more if count)
        yield "filter", f"changed {share:.1f} % of the ticks{told}", True
    yield (
        "sigma",
        ", ".join(f"{name} {count}" for name, count in s.sigma_status.items()) or "-",
        not s.overspeed,
    )
    yield "setpoints", f"{_number(s.setpoint_rate_hz, 2)} Hz (slowest agent)", True
    tick = s.tick
    lateness = f"p50 {tick.late_p50_ms:.2f} ms, p99 {tick.late_p99_ms:.2f} ms late, {tick.overruns} overruns"
    yield "ticks", lateness, True
    yield "state age", _ages(s), True
    yield "loss", _loss(s), True
    if s.exit_codes is not None:
        bad = {name: code for name, code in s.exit_codes.items() if code}
        words = ", ".join(f"{name} {code}" for name, code in bad.items())
        yield "exit codes", words or f"{len(s.exit_codes)} processes, all 0", not bad
    yield (
        "time",
        f"{_number(s.mission_time_s, 1)} s mission, {_number(s.wall_time_s, 1)} s wall clock",
        True,
    )


def _distance(
    value: float | None, pair: AgentPair | None, bound_name: str, bound: float | None, broken: bool
) -> str:
    if value is None:
        return "-"
    who = f"agents {pair[0]}-{pair[1]}, " if pair else ""
    return f"{value:.2f} m ({who}{'BREAKS ' if broken else ''}{bound_name} {_number(bound, 2)} m)"


def _ages(s: Summary) -> str:
    worst = max(
        ((x.age_p99_s, x) for x in s.links if x.age_p99_s is not None),
        key=lambda found: found[0],
        default=None,
    )
    if worst is None:
        return "-"
    p50 = max((x.age_p50_s for x in s.links if x.age_p50_s is not None), default=0.0)
    return f"p50 {p50:.3f} s, p99 {worst[0]:.3f} s (worst link: {worst[1].sender} to {worst[1].receiver})"


def _loss(s: Summary) -> str:
    received, lost = sum(x.received for x in s.links), sum(x.lost for x in s.links)
    return (
        f"{lost} of {received + lost} states ({lost / (received + lost):.2%})" if received else "-"
    )


def _remarks(summary: Summary) -> Iterator[Text]:
    for note in summary.notes:
        yield Text(f"! {printable(note, 1000)}", style="yellow")


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
