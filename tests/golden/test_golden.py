"""Flights are the same, byte for byte, as when their hashes were written."""

from __future__ import annotations

import gzip
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.core.control import controller
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.mavlink import outgoing
from tests.golden.__main__ import main
from tests.golden.traces import SUFFIX, differences, fly, read, rows

ROW = "017"
"""A short flight."""

SMALL = ("003", "017", "042", "058", "077", "091")
"""Short ones, for each run of the tests; `python -m tests.golden check` flies all."""


def test_no_flight_has_changed() -> None:
    """A change that means to change one writes the hashes anew and names the rows."""
    golden = read()
    if not golden.is_of_here():
        pytest.skip(f"the hashes are of another machine: {golden.made_with}")
    changed = differences(golden.hashes, fly(SMALL, 1))
    assert changed == [], "python -m tests.golden check"


def test_all_rows_have_a_hash() -> None:
    assert read().hashes.keys() == rows().keys()
    assert len(rows()) > 100


def test_a_plan_with_another_hash_is_flown_the_same(
    traces: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plan may say more, and its hash is on the mesh: no row is of it."""
    monkeypatch.setattr(Plan, "hash", lambda _: 0x5EED_0F_A_11_0B_5E)
    assert fly([ROW], 1)[ROW] == traces[1]


def test_a_flight_is_the_same_in_another_process(traces: tuple[Path, str]) -> None:
    """Also where sets and dicts of words have another order."""
    code = "from tests.golden.traces import fly; print(fly(['017'], 1)['017'])"
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    told = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONHASHSEED": seed, "PATH": ""},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout
    assert told.split() == [traces[1]]


@pytest.fixture(scope="module")
def traces(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with the trace of one row, and its hash without one."""
    folder = tmp_path_factory.mktemp("golden") / "before"
    folder.mkdir()
    plain = fly([ROW], 1)[ROW]
    assert fly([ROW], 1, folder)[ROW] == plain, "who listens changes nothing"
    return folder, plain


def _after(folder: Path, capsys: pytest.CaptureFixture[str], before: Path) -> str:
    """What `compare` says of the row's flight now."""
    assert main(["trace", str(folder), ROW, "--processes", "1"]) == 0
    capsys.readouterr()
    code = main(["compare", str(before), str(folder)])
    told = capsys.readouterr().out
    assert code == int("0 differ" not in told)
    return told


def test_the_first_difference_is_named(
    traces: tuple[Path, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A flight again is the same. With another gain of the law it is, until that acts."""
    before, _ = traces
    assert "1 flights, 0 differ" in _after(tmp_path / "again", capsys, before)
    paper = controller.PAPER

    def stronger(*given: Any) -> tuple[complex, complex, int]:
        consensus, *others = paper.form(*given)
        return 1.001 * consensus, *others

    monkeypatch.setattr(controller, "PAPER", replace(paper, form=stronger))
    told = _after(tmp_path / "after", capsys, before)
    assert re.match(rf"{ROW}: at [\d.]+ s: agent \d+, link, SET_POSITION.*, v[xy]: ", told), told


def test_a_difference_on_the_link_alone_is_named(
    traces: tuple[Path, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """No vehicle flies otherwise, and no peer hears of it: it has another hash, and a place."""
    before, plain = traces
    heartbeat = outgoing.heartbeat

    def calibrating() -> Any:
        message = heartbeat()
        message.system_status = 2
        return message

    monkeypatch.setattr(outgoing, "heartbeat", calibrating)
    assert fly([ROW], 1)[ROW] != plain
    told = _after(tmp_path / "after", capsys, before)
    assert re.match(
        rf"{ROW}: at [\d.]+ s: agent \d+, link, HEARTBEAT, system_status: 4 and 2", told
    )


def _written(folder: Path, *lines: str) -> Path:
    folder.mkdir()
    with gzip.open(folder / f"row{SUFFIX}", "wt") as file:
        file.writelines(f"{line}\n" for line in lines)
    return folder


@pytest.mark.parametrize(
    ("one", "other", "told"),
    [
        ('{"now_s":1,"a":[NaN,1]}', '{"now_s":1,"a":[NaN,1]}', "0 differ"),
        ('{"now_s":1,"x":NaN,"y":1}', '{"now_s":1,"x":NaN,"y":2}', "row: at 1 s: y: 1 and 2"),
        ('{"now_s":1,"y":0.0}', '{"now_s":1,"y":-0.0}', "row: at 1 s: y: 0.0 and -0.0"),
        ('{"now_s":1,"a":1,"b":2}', '{"now_s":1,"b":2,"a":1}', "row: at 1 s: order: "),
    ],
)
def test_a_difference_of_any_kind_has_a_place(
    one: str, other: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = _written(tmp_path / "a", one), _written(tmp_path / "b", other)
    assert main(["compare", str(a), str(b)]) == int("0 differ" not in told)
    assert told in capsys.readouterr().out


def test_a_trace_that_ends_or_is_missing_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = _written(tmp_path / "a", '{"now_s":1}', '{"now_s":2}')
    b = _written(tmp_path / "b", '{"now_s":1}')
    (b / f"more{SUFFIX}").write_bytes(b"")
    assert main(["compare", str(a), str(b)]) == 1
    told = capsys.readouterr().out
    assert "row: one ends before 2 s, the other goes on" in told
    assert f"more: not in {a}" in told


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["check", "nowhere"], "no such row: nowhere; allowed: "),
        (["check", "--processes", "0"], "--processes 0; allowed: 1 and more"),
        (["trace"], "no folder; allowed: trace FOLDER"),
        (["compare", "one"], "1 folders; allowed: compare FOLDER FOLDER"),
        (["compare", "no-folder", "no-folder"], "No such file or directory: 'no-folder'"),
        (["compare", "tests", "tests"], "no traces; allowed: folders that `trace` has written"),
    ],
)
def test_bad_input_is_named(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
    assert main(words) == 2
    assert told in capsys.readouterr().err


def test_hashes_of_another_machine_are_refused_before_any_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nor are some rows' written beside them: one file is of one machine."""
    path = tmp_path / "hashes.json"
    path.write_text('{"made_with": {"machine": "abacus"}, "hashes": {"hexagon": "00"}}')
    monkeypatch.setattr("tests.golden.traces.HASHES", path)
    monkeypatch.setattr("tests.golden.__main__.HASHES", path)
    for words in (["check"], ["check", ROW], ["write", ROW]):
        assert main(words) == 2
        assert "another machine: {'machine': 'abacus'}" in capsys.readouterr().err
