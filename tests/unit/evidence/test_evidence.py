"""The evidence: each claim of the pages has a row, and a row whose figure moved is told."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.errors import InputError
from swarm_ctl.evidence import claims as claims_module
from swarm_ctl.evidence import flown
from swarm_ctl.evidence.claims import (
    PAGES,
    ClaimRow,
    Claims,
    FlownWith,
    Method,
    claims_of,
    read_claims,
    unclaimed,
)
from swarm_ctl.evidence.flown import FAILED, HOLDS, JOURNAL, Evidence, _again, wanted
from swarm_ctl.evidence.page import DATA, PAGE, write_evidence
from swarm_ctl.fuzz.campaign import FLIGHTS, DrawnFlight
from swarm_ctl.fuzz.invariants.table import Broken, Invariant
from swarm_ctl.study.rows import COLUMNS
from tests.unit.docs.pages import ROOT

CLAIMS = read_claims()
TEXTS = {page: (ROOT / path).read_text() for page, path in PAGES.items()}
OSOS = ("01", "02", "03", "04", "05", "06", "07", "08", "09", "13", "16", "17", "18", "19", "20")
FAST = "swarm-ctl study studies/late-quick.yaml --missions 5 --limit 2"


def row(says: str, **more: Any) -> ClaimRow:
    """A row of one study of five missions."""
    fields = {"name": "fast", "claim": "c", "method": Method.STUDY, "command": FAST, "limits": "l"}
    return ClaimRow.model_validate(fields | {"says": (says,)} | more)


def test_each_claim_of_the_pages_has_a_row_and_each_row_its_claim() -> None:
    assert unclaimed(CLAIMS, TEXTS) == []


@pytest.mark.parametrize(
    ("page", "old", "new"),
    [
        ("safety-evidence", "0 of 5,184; 0.612", "0 of 5,184; 0.613"),
        ("README", "278 of 800", "277 of 800"),
        ("safety-evidence", "Everything else is only measured.", "None of 9 swarms failed."),
        ("safety", "## The limits\n", "## The limits\n\nNo pair was ever nearer.\n"),
        ("security", "# Security\n", "# Security\n\nIt withstands 12 attacks.\n"),
    ],
)
def test_a_claim_without_a_row_is_told(page: str, old: str, new: str) -> None:
    """A figure that moved on the page alone, too."""
    assert old in TEXTS[page]
    assert unclaimed(CLAIMS, TEXTS | {page: TEXTS[page].replace(old, new)})


def test_each_command_of_the_pages_that_flies_is_a_row() -> None:
    """Studies, benches and long tests, but for what a picture is drawn with."""
    commands = {re.sub(r" --out \S+$", "", row.command) for row in CLAIMS.rows}
    text = "\n".join(TEXTS.values()).replace("\\\n", " ")
    found = re.findall(r"swarm-ctl study studies/[^`\n]+|pytest -m long tests/[^`\n]+", text)
    plain = {re.sub(r" --(curves|out) \S+", "", each.strip()) for each in found}
    missing = [each for each in plain if not any(each in command for command in commands)]
    # each part of the safety in turn, which the row `parts` flies
    assert missing == ["swarm-ctl study studies/ablation.yaml"][: len(missing)]


def test_the_rows_are_whole() -> None:
    names = [each.name for each in CLAIMS.rows]
    assert len(set(names)) == len(names)
    for each in CLAIMS.rows:
        paths = re.findall(r"(?:studies|tests)/\S+", each.command)
        assert [path for path in paths if not (ROOT / path).exists()] == [], each.name
    assert {i for each in CLAIMS.rows for i in each.invariants} <= set(Invariant.__members__)
    assert {name for each in CLAIMS.sora for name in each.rows} <= set(names)
    assert [s.name for s in CLAIMS.sora if s.name.startswith("OSO")] == [
        f"OSO#{number}" for number in (*OSOS, "23", "24")
    ]
    assert all((s.covered == "not covered") is not bool(s.rows) for s in CLAIMS.sora)


def test_a_study_that_a_row_flies_is_read_by_its_columns() -> None:
    """Every figure of every row names columns that are there."""
    words = {"missions", "smallest", "silent", "zone", "median", "p95"}
    for each in CLAIMS.rows:
        for figure in each.figures:
            assert {name for name, _ in figure.where} <= set(COLUMNS), figure
            assert re.sub(r"[%<]$|/r_in$", "", figure.reading) in {*words, *COLUMNS}, figure


ROWS: list[dict[str, Any]] = [
    {"safety": "off", "n": 4, "collided": 1, "smallest_units": 0.2, "converged": 0, "time_s": 9.0},
    {"safety": "align", "n": 4, "collided": 0, "smallest_units": 0.75, "converged": 1, "time_s": 4},
    {"safety": "align", "n": 8, "collided": 0, "smallest_units": 0.8, "converged": 1, "time_s": 6},
]


@pytest.mark.parametrize(
    ("marker", "found", "same"),
    [
        ("{missions@safety:align=2}", "2", True),
        ("{collided@safety:align=None}", "0", True),
        ("{collided=2}", "1", False),
        ("{collided%=33}", "33", True),
        ("{collided<@safety:align=84.2}", "84.2", True),
        ("{smallest@n:5..=0.801}", "0.800", True),  # the last digit is the processor's
        ("{smallest@n:5..=0.802}", "0.800", False),
        ("{smallest/r_in@n:4,safety:align=1.50}", "1.50", True),
        ("{median=5.0}", "5.0", True),
    ],
)
def test_a_figure_is_read_again(marker: str, found: str, same: bool) -> None:
    again = _again(row(marker).figures[0], ROWS, 0.5)
    assert (again.found, again.same) == (found, same)


@pytest.fixture
def one_row(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The command knows this row alone."""

    def given(each: ClaimRow) -> None:
        monkeypatch.setattr(
            claims_module, "read_claims", lambda: Claims(rows=(each,), sora=CLAIMS.sora)
        )

    return given


@pytest.mark.timeout(300)
def test_a_row_is_flown_once_and_one_whose_figure_moved_ends_with_1(
    one_row: Any, tmp_path: Path
) -> None:
    out = ["evidence", "--row", "fast", "--out", str(tmp_path)]
    one_row(row("in {missions=5} missions {collided=none} did"))
    first = CliRunner().invoke(app, out)
    assert (first.exit_code, "fast: holds" in first.output) == (0, True), first.output
    data = json.loads((tmp_path / DATA).read_text())
    assert data["rows"][0]["found"]["state"] == HOLDS
    assert data["rows"][0]["found"]["figures"][1]["bound"] == "under 52.2 %"
    page = (tmp_path / PAGE).read_text()
    assert "collided: 0; 95 %: under 52.2 %" in page
    assert "OSO#24" in page
    assert all(f"<dt>{word}</dt>" in page for word in ("missions", "collided", "converged"))
    again = CliRunner().invoke(app, out)  # the journal has it: nothing is flown
    assert (again.exit_code, FAST in again.output) == (0, False)
    journal = (tmp_path / JOURNAL).read_text()
    (tmp_path / JOURNAL).write_text(journal[:-40])  # cut off: its study's rows are read again
    one_row(row("in {missions=6} missions {collided=none} did"))
    moved = CliRunner().invoke(app, out)
    assert moved.exit_code == 1
    assert "missions is 5, not 6" in moved.output
    assert "moved" in (tmp_path / PAGE).read_text()
    assert Evidence(tmp_path).done["fast"].state == "moved"


def test_the_page_can_be_read_while_a_row_is_flown(
    one_row: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages: list[str] = []

    def run(_words: Any, _log: Any) -> int:
        pages.append((tmp_path / PAGE).read_text())
        return 1

    monkeypatch.setattr(flown, "_run", run)
    one_row(row("s"))
    assert CliRunner().invoke(app, ["evidence", "--row", "fast", "--out", str(tmp_path)]).exit_code
    assert "failed" not in pages[0].partition("<h1>")[2]
    assert "failed" in (tmp_path / PAGE).read_text().partition("<h1>")[2]


def test_a_command_that_ends_badly_fails_and_another_commit_is_refused(tmp_path: Path) -> None:
    evidence = Evidence(tmp_path)
    bad = row("s", command="python -m pytest tests/there_is_none.py", method=Method.TEST)
    (_, begun), (_, again) = evidence.fly([bad])
    assert begun is None
    assert again is not None
    assert again.state == "failed"
    write_evidence(evidence, Claims(rows=(bad,), sora=()))
    journal = tmp_path / JOURNAL
    journal.write_text(journal.read_text().replace('"commit": "', '"commit": "0'))
    with pytest.raises(InputError, match="another commit"):
        Evidence(tmp_path)


@pytest.mark.parametrize(("broke", "state"), [("FORECAST", HOLDS), ("APART", FAILED)])
def test_a_campaign_holds_its_own_invariants_and_tells_of_others(
    broke: str, state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = (Broken(Invariant[broke], "text"),)
    flights = [DrawnFlight(k, "completed", 1800.0, 1.0, (), found if k else ()) for k in (0, 1)]
    (tmp_path / "fast").mkdir()
    (tmp_path / "fast" / FLIGHTS).write_text(
        "\n".join(["{}", '{"cut', *(f.line() for f in flights), ""])
    )
    monkeypatch.setattr(flown, "_run", lambda _words, _log: 1)
    each = row("s", command="swarm-ctl fuzz --flights 2", invariants=("APART",))
    *_, (_, again) = Evidence(tmp_path).fly([each])
    assert again is not None
    assert again.state == state
    assert f"{int(state == FAILED)} of 2 flights broke one" in again.why
    assert f"flight 1 broke: {Invariant[broke]}" in again.why


def test_a_row_tells_which_of_its_tests_were_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(_words: Any, log: Any) -> int:
        log.write("SKIPPED [2] tests/a.py:9: px4 is not found\n1 passed, 2 skipped in 3 s\n")
        return 0

    monkeypatch.setattr(flown, "_run", run)
    *_, (_, again) = Evidence(tmp_path).fly([row("s", command="python -m pytest tests/a.py")])
    assert again is not None
    assert again.why == "passed: 1; not flown here: 2, tests/a.py:9: px4 is not found"


def test_what_is_asked_for_is_flown() -> None:
    quick, every = (wanted(CLAIMS.rows, chosen, ()) for chosen in (FlownWith.QUICK, FlownWith.ALL))
    assert {each.name for each in quick} < {each.name for each in every}
    assert all(each.flown is not FlownWith.BY_HAND for each in every)
    assert [each.name for each in wanted(CLAIMS.rows, None, ["million"])] == ["million"]
    with pytest.raises(InputError, match="--row nothing: allowed: proof"):
        wanted(CLAIMS.rows, None, ["nothing"])
    assert CliRunner().invoke(app, ["evidence"]).exit_code == 1
    listed = CliRunner().invoke(app, ["evidence", "--list"])
    assert all(each.name in listed.output for each in CLAIMS.rows)


def test_sections_and_sentences_are_those_of_a_page() -> None:
    text = (
        "# A\n\nOne 1. Two.\n\n```sh\nx 3\n```\n\n| a | b |\n|---|---|\n| x | 2 |\n\n## B\nnever\n"
    )
    assert claims_of("safety", text) == {
        "safety#": [],
        "safety#A": ["One 1.", "| x | 2 |"],
        "safety#B": ["never"],
    }


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_quick_rows_hold(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["evidence", "--quick", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
