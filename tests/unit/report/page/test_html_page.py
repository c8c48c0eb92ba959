"""The report's page and figures, and the numbers they are drawn from."""

from __future__ import annotations

import io
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from swarm_ctl.core.model.messages import AgentState, Event, Outcome, Payload, Severity, SigmaReport
from swarm_ctl.errors import InputError
from swarm_ctl.recording import RECORDING
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.report.page.figures import FIGURES, overlay
from swarm_ctl.report.page.html_page import PAGE, comparison_table, make_comparison, make_report
from swarm_ctl.report.page.run_history import read_history
from tests.unit.plans import steps_of
from tests.unit.report.run_folders import (
    FORM,
    FORMED,
    LAND,
    LIFTOFF,
    PLAN,
    account,
    draw_nothing,
    position,
    true_minimum,
    write_run,
    write_status,
)
from tests.unit.station.swarm import report_of, state_of, status_of


def said() -> list[Payload]:
    """What the station heard of the flight, thinly."""
    found: list[Payload] = []
    for t in np.arange(LIFTOFF, LAND, 0.5).tolist():
        for agent in range(1, 7):
            found.append(
                state_of(PLAN, agent, t, velocity_ned_mps=(0.5, 0.0, 0.0), setpoint_mps=(1.0, 0.0))
            )
            charge = 10.0 if agent == 4 and t > 30.0 else 90.0
            found.append(
                status_of(PLAN, agent, t, links=account(agent).links, battery_percent=charge)
            )
    found += [
        Event(2, 25.0, Severity.WARNING, "vehicle: EKF variance"),
        Event(1, LAND, Severity.INFO, "ended: completed"),
    ]
    found.append(SigmaReport(4, 25.0, (0.0, 0.0), (0.1, 0.0), (report_of(5, 1.2),)))
    return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run with a recording."""
    folder = write_run(tmp_path_factory.mktemp("recorded"))
    recorder = McapRecorder(folder, 0, {})
    for payload in said():
        recorder.take(payload, getattr(payload, "time_s", 0.0))
    recorder.close()
    return folder


@pytest.fixture(scope="module")
def reported(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run with its report made."""
    folder = shutil.copytree(recorded, tmp_path_factory.mktemp("made") / "run")
    make_report(folder)
    return folder


@pytest.fixture
def run(recorded: Path, tmp_path: Path) -> Path:
    """The run for a test that changes it."""
    return shutil.copytree(recorded, tmp_path / "run")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which figures are drawn, without drawing them."""
    draw_nothing(monkeypatch)


class Outside(HTMLParser):
    """Collects what a page would fetch from elsewhere, and its images."""

    def __init__(self) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.images = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, content in attrs:
            if name in ("src", "href"):
                self.images += tag == "img"
                if not (content or "").startswith("data:"):
                    self.fetched.append(content or "")
        if tag in ("link", "iframe"):
            self.fetched.append(tag)


DRAWN = [name for name, _ in FIGURES if name not in ("target", "heights")]
"""Of a mission without these."""


def test_the_page_needs_nothing_beside_it(reported: Path) -> None:
    """All images inside, nothing fetched; every figure as PNG and SVG, too."""
    text = (reported / PAGE).read_text()
    page = Outside()
    page.feed(text)
    assert page.fetched == []
    assert page.images == len(DRAWN)
    assert {path.name for path in (reported / "figures").iterdir()} == {
        f"{name}.{kind}" for name in DRAWN for kind in ("png", "svg")
    }
    assert not re.search("https?:", re.sub(r"data:[^\"]+", "", text))


def test_summary_and_alarms_are_told(reported: Path) -> None:
    """The smallest distance, the station's alarms and the agents' warnings; plain
    events are none."""
    text = re.sub(r"<[^>]+>", " ", (reported / PAGE).read_text())
    assert f"{true_minimum()[0]:.2f} m" in text
    assert re.search(r"25\.0 s\s+agent 2\s+vehicle\s+EKF variance", text)
    assert re.search(r"3\d\.\d s\s+agent 4\s+alarm\s+agent 4: battery at 10 %", text)
    assert "ended: completed" not in text


def test_a_report_begins_with_the_verdict(reported: Path) -> None:
    """Its reason, the date, how long it was, the smallest distance: all before the player."""
    opening = re.sub(r"<[^>]+>", " ", (reported / PAGE).read_text().partition("<h2>")[0])
    told = " ".join(opening.partition("</style>")[2].split() or opening.split())
    assert "hexagon: completed judged by the simulator's truth" in told.replace("&#x27;", "'")
    assert re.search(r"date 20\d\d-\d\d-\d\d \d\d:\d\d UTC", told)
    assert re.search(r"duration \d+\.\d s", told)
    assert f"smallest true distance {true_minimum()[0]:.2f} m" in told


@pytest.mark.usefixtures("quick")
def test_what_is_empty_is_not_on_the_page(
    run: Path, reported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No heading without alarms and notes, no panel of what was 0 throughout, no figure that is
    not known."""
    assert "Alarms and notes" in (reported / PAGE).read_text()
    monkeypatch.setattr("swarm_ctl.report.page.html_page._log", lambda *_: [])
    page = make_report(run).read_text()
    assert "Alarms and notes" not in page
    assert "<td>-</td>" not in page
    history = read_history(run)
    drawn = {name: draw(history) for name, draw in FIGURES}
    labels = {name: [x.get_ylabel() for x in made.axes] for name, made in drawn.items() if made}
    assert labels["ticks"] == ["late [ms, wall clock]"]
    assert labels["mesh"] == ["oldest state [s]", "lost so far [%]"]
    for found in history.heard.statuses.values():
        found[:] = [
            replace(s, links={i: replace(x, lost=0) for i, x in s.links.items()}) for s in found
        ]
    (mesh,) = (draw(history) for name, draw in FIGURES if name == "mesh")
    assert mesh is not None
    assert [axes.get_ylabel() for axes in mesh.axes] == ["oldest state [s]"]


@pytest.mark.usefixtures("quick")
def test_without_truth_or_recording_the_rest_is_drawn(run: Path) -> None:
    (run / "truth.jsonl").unlink()
    make_report(run)
    assert {path.stem for path in (run / "figures").iterdir()} == {
        "sigma",
        "mesh",
        "ticks",
        "velocity",
    }
    for path in (run / "figures").iterdir():
        path.unlink()
    write_run(run)
    (run / RECORDING).unlink()
    page = make_report(run).read_text()
    assert "figures of messages are left out" in page
    assert "vehicle: EKF variance" in page
    assert {path.stem for path in (run / "figures").iterdir()} == {
        "trajectories", "min-distance", "error", "links",
    }  # fmt: skip


@pytest.mark.usefixtures("quick")
def test_a_recording_that_was_cut_off_is_read_and_stays_as_it_is(run: Path) -> None:
    """The page says it each time; a whole copy for other tools is made once."""
    data = (run / RECORDING).read_bytes()
    (run / RECORDING).write_bytes(data[:-100])
    first, again = make_report(run).read_text(), make_report(run).read_text()
    assert "was cut off; read up to its last second" in first
    assert "recording.recovered.mcap: a whole copy" in first
    assert "was cut off; read up to its last second" in again
    assert "a whole copy" not in again
    assert (run / RECORDING).read_bytes() == data[:-100]


@pytest.mark.usefixtures("quick")
def test_text_of_the_run_is_shown_and_never_run(run: Path) -> None:
    """Markup and control characters of names, reasons and notes are text on page and screen."""
    evil = "[red]<b>x\x1b[2J"
    write_status(run, account(4, outcome=Outcome.FAILED, reason=evil))
    other = run.rename(run.parent / evil)
    pages = [make_report(other), make_comparison([other, other], run.parent / "both.html")]
    for page in pages:
        assert "<b>" not in page.read_text()
        assert "\x1b" not in page.read_text()
    console = Console(file=io.StringIO(), width=120)
    console.print(comparison_table([other, other]))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "[red]<b>x?[2J" in shown
    assert "\x1b" not in shown


def test_many_runs_are_compared_without_a_cut_word(run: Path) -> None:
    """On 80 columns a run has its whole name. In the figure of all the lines have room beside
    their names: else matplotlib warns, which is an error here."""
    console = Console(file=io.StringIO(), width=80)
    console.print(comparison_table([run] * 6))
    assert "…" not in console.file.getvalue()  # type: ignore[attr-defined]
    overlay([read_history(run)] * 24).savefig(io.BytesIO(), dpi=30)


def test_no_run_folder_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no run folder"):
        make_report(tmp_path)


def test_the_numbers_behind_the_figures(run: Path) -> None:
    """Nearest distances, link lengths and errors against the flight itself."""
    history = read_history(run)
    t = 26.0
    k = int(np.argmin(np.abs(history.flight.time_s - t)))
    where = np.array([position(agent, t)[:2] for agent in range(1, 7)])
    apart = np.linalg.norm(where[:, None] - where[None], axis=-1) + np.diag([np.inf] * 6)
    assert history.nearest()[k] == pytest.approx(apart.min(axis=1))
    assert history.lengths()[k] == pytest.approx([apart[i - 1, j - 1] for i, j in history.links])
    errors = history.errors()
    step = steps_of(PLAN)[1]
    assert errors[k] == pytest.approx(where - np.array(step.slots) * PLAN.unit_m)  # type: ignore[union-attr]
    assert np.isnan(errors[history.flight.time_s < FORM - 0.05]).all()
    assert np.isnan(errors[history.flight.time_s > LAND + 0.05]).all()
    stands = (history.flight.time_s > FORMED + 0.1) & (history.flight.time_s < LAND)
    assert np.ptp(errors[stands], axis=1).max() < 1e-6
    assert all(isinstance(s, AgentState) for s in history.heard.states[3])
    assert history.heard.sigmas[4, 5] == [(25.0, 1.2, 0.36)]


@pytest.mark.usefixtures("quick")
def test_compare_needs_two_and_shows_both(run: Path, tmp_path: Path) -> None:
    """A table with a column per run, each figure of each run, one of both together."""
    other = tmp_path / "other"
    other.mkdir()
    write_run(other)
    text = make_comparison([run, other], tmp_path / "compare.html").read_text()
    page = Outside()
    page.feed(text)
    assert page.fetched == []
    assert page.images == 1 + len(DRAWN) + 4
    assert re.search(r"<th>run</th><th>other</th>", text)
    with pytest.raises(InputError, match="two or more"):
        make_comparison([run], tmp_path / "compare.html")


@pytest.mark.usefixtures("quick")
def test_parts_that_cannot_be_drawn_cost_those_parts(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page has all others, and says why of each."""

    def broken(part: str) -> Callable[..., None]:
        def fail(*_: object) -> None:
            raise IndexError(f"{part} out of range")

        return fail

    for part in ("_log", "player"):
        monkeypatch.setattr(f"swarm_ctl.report.page.html_page.{part}", broken(part))
    page = make_report(run).read_text()
    for part in ("_log", "player"):
        assert f"can&#x27;t be drawn: IndexError: {part} out of range" in page
    assert "data:image/png" in page
