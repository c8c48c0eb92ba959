"""The summary in words: some lines for a terminal, rows for a page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from rich.console import Group
from rich.text import Text

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.plan import EVERYONE
from swarm_ctl.core.model.text import agents_named, printable, ranges
from swarm_ctl.core.swarm.hearing import mesh_words
from swarm_ctl.report.judge.summary import (
    AgentPair,
    SafetySummary,
    StepSummary,
    StepVerdict,
    Summary,
)
from swarm_ctl.runfolder.flight import TrackSource
from swarm_ctl.station.picture.protection import Protection, protection_words

_STYLE: Final = {
    Outcome.COMPLETED: "bold green",
    Outcome.ABORTED: "bold yellow",
    Outcome.FAILED: "bold red",
}
_FORMS, _NOTES, _STEPS = 2, 3, 66
"""Form steps that are told, notes of a flight that was not completed, characters of all steps."""


class SummaryFigure(NamedTuple):
    """A figure in words, safe to print."""

    name: str
    value: str
    good: bool = True
    """It is as it should be."""


def brief(summary: Summary) -> Group:
    """What the terminal shows at the end of a flight; the report has the rest.

    A completed flight: at most eight lines of 80 columns. Another one begins with its cause, said
    once, and goes on with what was not done and which bounds were broken. Of one that was ended
    before it took off all else follows from that: its processes were stopped at once.
    """
    if summary.outcome is Outcome.ABORTED and not any(_begun(s) for s in summary.steps if s.step):
        return Group(_opening(summary))
    lines = [_opening(summary), _way(summary)]
    formed = [each for each in summary.steps if each.time_to_form_s is not None]
    if formed:
        told = ", ".join(f"{_called(s)} {s.time_to_form_s:.1f} s" for s in formed[:_FORMS])
        more = f", and {len(formed) - _FORMS} more" if len(formed) > _FORMS else ""
        lines.append(Text(f"formed after: {told}{more}"))
    for name, value, good in (*_nearest(summary), *_longest(summary)):
        if name != "judged" and (not good or not name.startswith("longest")):
            lines.append(Text(f"{name}: {value}", style="" if good else "bold red"))
    lines += [Text(f"protection: {_told(words)}") for words in [_protection(summary)] if words]
    if summary.exit_codes is not None and (bad := ", ".join(_bad_ends(summary.exit_codes))):
        lines.append(Text(f"exit codes: {bad}", style="bold red"))
    # a note that is the verdict's reason has been told, and that a killed agent left nothing
    killed = tuple(_killed(summary.exit_codes or {}))
    notes = [note for note in (*summary.warnings, *summary.notes) if note not in summary.reason]
    notes = [note for note in notes if not note.startswith(killed)]
    completed = summary.outcome is Outcome.COMPLETED
    shown, room = (1, 80) if completed else (_NOTES, 200)
    more = f" (and {len(notes) - shown} more: see the report)" if len(notes) > shown else ""
    for k, note in enumerate(notes[:shown], 1):
        text = f"! {printable(note, room)}{more if k == shown else ''}"
        lines.append(Text(text, style="yellow"))
    return Group(*lines)


def _opening(summary: Summary) -> Text:
    """The mission, how it ended, and why or by whose word."""
    flown = f" in {summary.mission_time_s:.1f} s" if summary.mission_time_s is not None else ""
    why = why_so(summary)
    own = f" (own law {printable(summary.own_law.partition('@')[0])})" if summary.own_law else ""
    text = Text.assemble(
        f"{printable(summary.mission or 'mission')}{own}: ",
        (summary.outcome.upper(), _STYLE[summary.outcome]),
    )
    if summary.outcome is Outcome.COMPLETED:
        return text.append(f"{flown}, {printable(why, 300)}")
    return text.append(f": {printable(why, 1000)}")


def _way(summary: Summary) -> Text:
    """The steps, as far as they went."""
    undone = [s for s in summary.steps if s.result is not StepVerdict.DONE]
    flown = [s for s in summary.steps if s.step]
    if not undone:
        took = [(_called(s), _took_s(s)) for s in flown]
        each = ", ".join(f"{name} {s:.1f} s" for name, s in took if s is not None)
        return Text(f"steps done: {each if len(each) <= _STEPS else len(flown)}")
    told = [
        f"{s.step or ''} {_called(s)} {s.result}".lstrip()
        + _unlike(s, len(s.agents or summary.agents))
        for s in undone
        if _begun(s)
    ]
    unreached = dict[str, list[int]]()
    for step in flown:
        if not _begun(step):
            unreached.setdefault(_whose(step), []).append(step.step)
    if unreached:
        lists = (f"{name}{ranges(numbers)}" for name, numbers in unreached.items())
        told.append(f"not reached: {', '.join(lists)}")
    done = sum(s.result is StepVerdict.DONE for s in flown)
    return Text(f"steps: {done} of {len(flown)} done; {'; '.join(told)}")


def _whose(step: StepSummary) -> str:
    """`scouts `, of a step of a group beside others; else ''."""
    return "" if step.group in ("", EVERYONE) else f"{printable(step.group)} "


def _called(step: StepSummary) -> str:
    """The step's name, with its group where it is one beside others."""
    return f"{_whose(step)}{printable(step.name)}"


def _begun(step: StepSummary) -> bool:
    return step.result is not StepVerdict.NOT_REACHED


def _unlike(step: StepSummary, agents: int) -> str:
    """The agents' own results in brackets; nothing where all had the step's."""
    alike = len(step.exceptions) == agents and set(step.exceptions.values()) == {step.result}
    return "" if alike or not step.exceptions else f" ({_exceptions(step)})"


def _took_s(step: StepSummary) -> float | None:
    return None if step.start_s is None or step.end_s is None else step.end_s - step.start_s


def verdict_line(summary: Summary) -> Text:
    """The verdict in one line, with its reason or by what it was judged."""
    why = printable(why_so(summary), 1000)
    return Text(f"{summary.outcome}: {why}", style=_STYLE[summary.outcome])


def why_so(summary: Summary) -> str:
    """The reason of the verdict, or by what it was judged; before that, who left."""
    why = summary.reason or f"judged {_judged_by(summary)}"
    return f"{left_words(summary)}; {why}" if summary.left else why


def left_words(summary: Summary) -> str:
    """`without agent 3 (land at 24.5 s)`; '' where no agent left."""
    found: dict[str, list[int]] = {}
    for left in summary.left:
        found.setdefault(f"{left.order} at {left.time_s:.1f} s", []).append(left.agent)
    told = [f"{agents_named(ids)} ({how})" for how, ids in found.items()]
    return f"without {', '.join(told)}" if told else ""


def step_rows(summary: Summary) -> list[list[str]]:
    """The steps, headings first."""
    groups = any(step.group for step in summary.steps)
    rows = [["group"] * groups + ["step", "result", "from [s]", "to [s]", "not done"]]
    for step in summary.steps:
        times = (_number(step.start_s, 1), _number(step.end_s, 1))
        told = [step.name, str(step.result), *times, _exceptions(step)]
        rows.append([printable(text) for text in [step.group] * groups + told])
    bare = not any(row[-1] for row in rows[1:])
    return [row[:-1] for row in rows] if bare else rows


def _exceptions(step: StepSummary) -> str:
    by_result: dict[str, list[int]] = {}
    for agent, result in step.exceptions.items():
        by_result.setdefault(result, []).append(agent)
    return "; ".join(f"{ranges(ids)} {result}" for result, ids in by_result.items())


def opening_of(s: Summary) -> Iterator[SummaryFigure]:
    """What a report begins with: when it was, how long, who flew, and how near they came."""
    at = printable(s.started_at or "")
    if at[:4] > "1970":  # there the virtual clock begins
        zone = "UTC" if at.endswith(("Z", "+00:00")) else f"UTC{at[-6:]}"
        yield SummaryFigure("date", f"{at[:10]} {at[11:16]} {zone}")
    if (flown_s := s.mission_time_s) is not None:
        wall_s = flown_s if s.wall_time_s is None else s.wall_time_s
        slow = (
            "" if math.isclose(wall_s, flown_s, rel_tol=0.01) else f" ({wall_s:.1f} s wall clock)"
        )
        yield SummaryFigure("duration", f"{flown_s:.1f} s{slow}")
    yield SummaryFigure("agents", str(len(s.agents)))
    yield from _nearest(s)


def figures_of(s: Summary) -> Iterator[SummaryFigure]:
    """All further figures that are known."""
    if s.left:
        yield SummaryFigure("left by order", left_words(s).removeprefix("without "))
    formed = ", ".join(
        f"{_whose(each)}{printable(each.name).removeprefix('form ')} {each.time_to_form_s:.1f} s"
        for each in s.steps
        if each.time_to_form_s is not None
    )
    if formed:
        yield SummaryFigure("time to form", formed)
    if s.formation_error_m is not None:
        yield SummaryFigure("formation error", f"{s.formation_error_m:.2f} m before the landing")
    yield from _longest(s)
    if s.truth is not None and s.truth.collisions:
        yield SummaryFigure("collisions", f"sysid {ranges(s.truth.collisions)}", False)
    if s.safety is not None:
        yield SummaryFigure("filter", _filter(s.safety))
    if any(s.sigma_status.values()):
        counts = (f"{printable(name)} {count}" for name, count in s.sigma_status.items() if count)
        yield SummaryFigure("sigma", ", ".join(counts), not s.overspeed)
    if s.setpoint_rate_hz is not None:
        yield SummaryFigure("setpoints", f"{s.setpoint_rate_hz:.2f} Hz (slowest agent)")
    late = f"p50 {s.tick.late_p50_ms:.2f} ms, p99 {s.tick.late_p99_ms:.2f} ms late"
    yield SummaryFigure("ticks", f"{late}, {s.tick.overruns} overruns")
    yield SummaryFigure("mesh", mesh_words(len(s.agents), routed=bool(s.routers)))
    yield from _heard(s)
    if s.exit_codes is not None:
        bad = ", ".join(_bad_ends(s.exit_codes))
        yield SummaryFigure("exit codes", bad or f"{len(s.exit_codes)} processes, all 0", not bad)
    if words := _protection(s):
        yield SummaryFigure("protection", _told(words), all(good for _, good in words))
    if version := s.versions.get("swarm-ctl"):
        commit = f", commit {known}" if (known := s.versions.get("commit")) else ""
        yield SummaryFigure("swarm-ctl", printable(f"{version}{commit}"))


def _longest(s: Summary) -> Iterator[SummaryFigure]:
    """A link longer than `r` is out of the proof's range; it breaks nothing by itself."""
    long_m, r_m = s.longest_link_m, s.r_m
    if long_m is not None:
        kept = r_m is None or long_m <= r_m
        told = _distance(long_m, s.longest_link_pair, "r", r_m, kept, over="over")
        yield SummaryFigure("longest link", told, kept or s.outcome is Outcome.COMPLETED)


def _told(words: list[tuple[str, bool]]) -> str:
    return printable(", ".join(each for each, _ in words))


def _protection(s: Summary) -> list[tuple[str, bool]]:
    by = s.protection
    if by is None:
        return []
    told = Protection(by.mesh, by.operator, signing=by.signing)
    return protection_words(told, len(by.authenticated), len(by.signed), len(s.agents))


def _nearest(s: Summary) -> Iterator[SummaryFigure]:
    estimated = [agent for agent, source in s.judged_by.items() if source is TrackSource.ESTIMATES]
    # a summary of an earlier version has the truth's alone
    both = ((s.min_distance_m, s.min_distance_pair), (s.min_true_distance_m, s.min_true_pair))
    told = [(distance_m, pair) for distance_m, pair in both if distance_m is not None]
    if told:
        near_m, pair = min(told, key=lambda found: found[0])
        kept = s.r_in_m is None or near_m >= s.r_in_m
        name = "smallest distance" if estimated else "smallest true distance"
        doubt = f" ± {s.min_distance_doubt_m:.2f} m" if s.min_distance_doubt_m else ""
        yield SummaryFigure(name, _distance(near_m, pair, "r_in", s.r_in_m, kept, doubt), kept)
    if s.nearest_zone is not None:
        zone = s.nearest_zone
        near = f"{zone.distance_m:.2f} m (agent {zone.agent}, zone {printable(zone.zone)})"
        yield SummaryFigure("nearest zone", near, zone.distance_m > 0.0)
    if estimated:
        yield SummaryFigure("judged", _judged_by(s))


def _judged_by(s: Summary) -> str:
    estimated = [agent for agent, source in s.judged_by.items() if source is TrackSource.ESTIMATES]
    if not s.judged_by:
        return "by the agents' own words alone"
    if not estimated:
        return "by the simulator's truth"
    whose = "" if len(estimated) == len(s.judged_by) else f" ({agents_named(estimated)})"
    others = ", the others by the truth" if whose else ""
    return f"by the vehicles' own estimates{whose}{others}"


def _filter(safety: SafetySummary) -> str:
    counts = {"dead-locks resolved": safety.releases, "slot exchanges": safety.exchanges}
    more = "".join(f", {count} {what}" for what, count in counts.items() if count)
    return f"changed {100 * safety.touched / max(1, safety.ticks):.1f} % of the ticks{more}"


def _distance(
    value_m: float,
    pair: AgentPair | None,
    name: str,
    bound_m: float | None,
    kept: bool,
    doubt: str = "",
    over: str = "BREAKS",
) -> str:
    agents = f"agents {pair[0]}-{pair[1]}, " if pair else ""
    bound = f"{'' if kept else f'{over} '}{name} {_number(bound_m, 2)} m"
    return f"{value_m:.2f} m{doubt} ({agents}{bound})"


def _heard(s: Summary) -> Iterator[SummaryFigure]:
    """Ages and losses of the links."""
    worst = max(s.links, key=lambda link: link.age_p99_s or 0.0, default=None)
    if worst is not None and worst.age_p99_s is not None:
        p50 = max(link.age_p50_s or 0.0 for link in s.links)
        link = f"worst link: {worst.sender} to {worst.receiver}"
        yield SummaryFigure("state age", f"p50 {p50:.3f} s, p99 {worst.age_p99_s:.3f} s ({link})")
    received, lost = sum(x.received for x in s.links), sum(x.lost for x in s.links)
    if received:
        share = lost / (received + lost)
        yield SummaryFigure("loss", f"{lost} of {received + lost} states ({share:.2%})")


def _bad_ends(exit_codes: Mapping[str, int]) -> Iterator[str]:
    """Each process that ended badly, and agents that ended alike in one."""
    alike: dict[int, list[int]] = {}
    for name, code in exit_codes.items():
        kind, _, number = name.partition("-")
        if code and kind == "agent" and number.isdecimal():
            alike.setdefault(code, []).append(int(number))
        elif code:
            yield f"{printable(name)} {code}"
    for code, agents in alike.items():
        yield f"{f'agents {ranges(agents)}:' if len(agents) > 1 else f'agent-{agents[0]}'} {code}"


def _killed(exit_codes: Mapping[str, int]) -> Iterator[str]:
    """How the notes on what an agent left begin, of each whose process was killed."""
    for name, code in exit_codes.items():
        if name.startswith("agent-") and code < 0:
            yield f"{name.replace('-', ' ')}: it"


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
