"""The summary on the screen."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.result import show_summary
from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import ProtectionSummary, StepVerdict, Summary
from swarm_ctl.report.page.summary_table import (
    brief,
    figures_of,
    opening_of,
    step_rows,
    verdict_line,
)
from swarm_ctl.runfolder.flight import TrackSource
from swarm_ctl.station.picture.protection import MeshKind
from tests.unit.report.run_folders import EXIT_CODES, account, write_run, write_status


def _shown(summary: Summary) -> str:
    """What the report has in words: verdict and reason, figures, steps."""
    figures = (f"{name} {value}" for name, value, _ in (*opening_of(summary), *figures_of(summary)))
    steps = (" ".join(row) for row in step_rows(summary))
    return "\n".join([verdict_line(summary).plain, *figures, *steps])


@pytest.fixture
def summary(tmp_path: Path) -> Summary:
    return summarise(write_run(tmp_path), EXIT_CODES)


def test_all_figures_of_a_completed_run(summary: Summary) -> None:
    """Of what is not known there is no line."""
    text = _shown(summary)
    assert all(good for _, _, good in (*opening_of(summary), *figures_of(summary)))
    unknown = summary.model_copy(update={"setpoint_rate_hz": None, "links": ()})
    gone = {line.split()[0] for line in text.splitlines()} - {
        line.split()[0] for line in _shown(unknown).splitlines()
    }
    assert gone == {"setpoints", "state", "loss"}
    for words in (
        "form hexagon",
        "time to form",
        "r_in 2.50 m",
        "r 22.50 m",
        "8 processes, all 0",
        "1.00%",
        "paper 30",
    ):
        assert words in text
    assert f"{summary.min_true_distance_m:.2f} m" in text
    assert "BREAKS" not in text


def test_the_last_line_is_the_verdict_with_its_reason_or_its_source(summary: Summary) -> None:
    assert verdict_line(summary).plain == "completed: judged by the simulator's truth"
    sources = dict.fromkeys(summary.judged_by, TrackSource.ESTIMATES)
    estimated = summary.model_copy(update={"judged_by": sources})
    assert verdict_line(estimated).plain == "completed: judged by the vehicles' own estimates"
    told = {"outcome": Outcome.FAILED, "reason": "agents 2, 5 collided"}
    assert verdict_line(summary.model_copy(update=told)).plain == "failed: agents 2, 5 collided"


@pytest.mark.parametrize(
    ("by", "told"),
    [
        (ProtectionSummary(mesh=MeshKind.LOCAL), None),
        (
            ProtectionSummary(mesh=MeshKind.OPEN),
            "MESH OPEN, any computer that reaches it may command",
        ),
        (
            ProtectionSummary(
                mesh=MeshKind.TLS,
                operator="operator anna",
                authenticated=(1, 2, 3, 4, 5, 6),
                signing=True,
                signed=(1, 2),
            ),
            "mesh TLS 6/6, links signed 2/6, operator anna",
        ),
    ],
)
def test_what_was_authenticated_is_said(
    summary: Summary, by: ProtectionSummary, told: str | None
) -> None:
    """Nothing of a mesh inside one computer."""
    text = _shown(summary.model_copy(update={"protection": by}))
    assert told in text if told else "protection" not in text


@pytest.mark.parametrize("terminal", [True, False])
def test_lines_are_wrapped_on_a_terminal_alone(
    summary: Summary, tmp_path: Path, terminal: bool
) -> None:
    """In a file the reason is one line, which other programs look for."""
    console = PlainConsole(file=io.StringIO(), width=80, force_terminal=terminal)
    reason = " ".join(["why"] * 40)
    told = summary.model_copy(update={"outcome": Outcome.FAILED, "reason": reason})
    show_summary(console, tmp_path, told, None, Interrupts())
    assert (reason in console.file.getvalue()) is not terminal  # type: ignore[attr-defined]


def _brief(summary: Summary, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width, record=True, force_terminal=True)
    console.print(brief(summary))
    return console.export_text()


@pytest.mark.parametrize("width", [80, 100])
def test_a_completed_flight_is_told_in_eight_lines_with_the_reports(
    summary: Summary, width: int
) -> None:
    """With doubts, an agent that left, keys, and three forms too."""
    form = next(step for step in summary.steps if step.time_to_form_s is not None)
    plain = _brief(summary, width).splitlines()
    assert plain[0].startswith("hexagon: COMPLETED in ")
    assert "judged by the simulator's truth" in plain[0]
    assert len(plain) <= 4
    busy = summary.model_copy(
        update={
            "steps": (*summary.steps, *(form.model_copy(update={"step": k}) for k in (5, 6, 7))),
            "protection": ProtectionSummary(mesh=MeshKind.OPEN),
            "warnings": ("a long doubt " * 8, "another", "a third"),
            "longest_link_m": 22.6,
        }
    )
    lines = _brief(busy, width).splitlines()
    assert len(lines) <= 8
    assert "another" not in "".join(lines)
    assert "(and 2 more: see the report)" in " ".join(" ".join(lines).split())
    assert "longest link" not in "".join(lines)


@pytest.mark.parametrize("width", [40, 80, 100])
def test_a_failed_flight_begins_with_its_cause_said_once_and_whole_words(
    tmp_path: Path, width: int
) -> None:
    run = write_run(tmp_path)
    reason = "no position for a very long time from the ground station of this swarm"
    write_status(run, account(4, outcome=Outcome.FAILED, reason=reason))
    text = _brief(summarise(run, EXIT_CODES | {"agent-4": 1}), width)
    words = " ".join(text.split())
    assert words.startswith(f"hexagon: FAILED: agent 4: {reason}")
    assert words.count(reason) == 1
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width


def test_what_was_ended_before_take_off_is_told_in_one_line(summary: Summary) -> None:
    """Its processes were stopped at once, so that they left nothing is no trouble."""
    steps = tuple(s.model_copy(update={"result": StepVerdict.NOT_REACHED}) for s in summary.steps)
    reason = "Ctrl-C before take-off"
    notes = ("truth.jsonl: No such file or directory",)
    ended = {"outcome": Outcome.ABORTED, "reason": reason, "steps": steps, "notes": notes}
    text = _brief(summary.model_copy(update=ended))
    assert text.rstrip() == "hexagon: ABORTED: Ctrl-C before take-off"


def test_that_a_killed_agent_left_nothing_is_told_once(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    (run / "agents/4.json").unlink()
    text = " ".join(_brief(summarise(run, EXIT_CODES | {"agent-4": -9}), 200).split())
    assert text.startswith("hexagon: FAILED: agent-4 was ended by SIGKILL; agent 4 left no final")
    assert "agent-4 -9" in text
    assert "account" not in text
    assert "left no account" in _brief(summarise(run, EXIT_CODES | {"agent-4": 0}), 200)


def test_a_failure_says_why_and_what_is_missing(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    (run / "truth.jsonl").unlink()
    write_status(run, account(4, outcome=Outcome.FAILED, reason="[red]no\x1b[2J position[/]"))
    text = _shown(summarise(run, EXIT_CODES | {"agent-4": 1}))
    assert "failed: " in text
    assert "agent 4: [red]no?[2J position[/]" in text
    assert "agent-4 1" in text
    assert "\x1b" not in text


def test_an_own_law_is_named(summary: Summary) -> None:
    assert _brief(summary.model_copy(update={"own_law": "mean@12ab"})).startswith(
        "hexagon (own law mean): COMPLETED"
    )
    assert "own law" not in _brief(summary)
