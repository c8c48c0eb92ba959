"""Study files: the same study as by options, mistakes by their line, and those of the project."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from swarm_ctl.cli.app import app, main
from swarm_ctl.errors import InputError
from swarm_ctl.study.parameter_space import Range, Study, study_file
from swarm_ctl.study.rows import read_rows

STUDIES = sorted((Path(__file__).parents[3] / "studies").glob("*.yaml"))


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_file_says_what_options_say(tmp_path: Path) -> None:
    """Lists, spans and ranges, as text or as YAML; `off` is a word."""
    text = "n: 2:3,9\nsafety: off\nloss: [0, 0:0.2]\nspeed_mps: 3\nlaw: {r_in: 0.4}\nby: n,loss\n"
    said = study_file(write(tmp_path / "a.yaml", text), {})
    assert said.by == ("n", "loss")
    assert said.study == Study(
        n=(2, 3, 9),
        safety=("off",),
        loss=(Range(low=0, high=0), Range(low=0, high=0.2)),
        speed_mps=(3.0,),
        law={"r_in": 0.4},  # type: ignore[arg-type]
    )


def test_options_come_before_the_file(tmp_path: Path) -> None:
    """One by one, also within the law."""
    path = write(tmp_path / "a.yaml", "n: 4\nseed: 9\nlaw: {r_in: 0.4, delta_a: 0.2}\n")
    study = study_file(path, {"n": "5", "law": {"delta_a": "0.3"}}).study
    assert (study.n, study.seed) == ((5,), 9)
    assert (study.law.r_in, study.law.delta_a) == (0.4, 0.3)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("n: 4\nspeed: 3\n", r"a.yaml:2: speed: unknown field; did you mean speed_mps\?; allowed"),
        (
            "law:\n  r_inn: 1\n",
            r"a.yaml:2: law.r_inn: unknown field; did you mean r_in\?; allowed: r",
        ),
        ("missions: ten\n", r'a.yaml:1: missions: "ten" should be a valid integer'),
        ("shap: ring\nstart: rondom\n", r"(?s)a.yaml:1: shap: .*\n.*a.yaml:2: start: .*random\?"),
        ("h: 0.2\nloss: 0:x\n", r"a.yaml:2: loss: '0:x' is no number and no LOW:HIGH"),
        (
            "safety: [filter, on]\n",
            r'a.yaml:1: safety: "on" is not allowed; .*allowed: off, filter',
        ),
        ("n: 4\nn: 5\n", r"a.yaml:2: n: "),
        ("- 4\n", r"has no fields"),
    ],
)
def test_a_mistake_is_told_with_its_line(text: str, wrong: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=wrong):
        study_file(write(tmp_path / "a.yaml", text), {})


def test_the_help_tells_the_defaults_that_are_flown() -> None:
    """Of each option that is a field of the study."""
    command: Any = get_command(app).commands["study"]  # type: ignore[attr-defined]
    fields, checked = Study.model_fields, 0
    for option in command.params:
        shown = re.search(r"\[default: ([\w.]+)\]$", option.help or "")
        names = [name for name in fields if name == option.name]
        names += [name for name in fields if re.fullmatch(rf"{option.name}_(s|mps2?)", name)]
        if not shown or not names:
            continue
        value = {"own": shown[1]} if names[0] == "law" else shown[1]
        given = Study.model_validate({names[0]: value})
        assert getattr(given, names[0]) == fields[names[0]].default, option.name
        checked += 1
    assert checked >= 27


def test_the_command_flies_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its rows have its name; a list that an option makes one value is no line of the table."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "few.yaml", "n: 2,3\nh: 0.1,0.2\nmissions: 2\nlimit_s: 1\nby: h,n\n")
    arguments = ["swarm-ctl", "study", "few.yaml", "--n", "3", "--processes", "1"]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    rows = list(read_rows(tmp_path / "few.csv"))
    assert [(row["n"], row["h"]) for row in rows] == [(3, 0.1), (3, 0.1), (3, 0.2), (3, 0.2)]
    assert "rows: few.csv" in capsys.readouterr().out


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_each_study_of_the_project_can_be_flown(path: Path) -> None:
    """It says what it asks, and its table is made by what it varies."""
    said = study_file(path, {})
    assert said.about.endswith(".")
    assert set(said.by) <= set(said.study.varied)


def refused(
    arguments: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> str:
    """What `study` says to options that it refuses before it flies."""
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "study", "--missions", "1", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--picture a.png", "--picture: allowed: with --row or --search or several laws"),
        ("--mission a.yaml", "--mission: allowed: with --row or --search"),
        ("--mission a.yaml --law paper,orca", "--mission: allowed: with --row or --search"),
        ("--budget 20", "--budget: allowed: with --search"),
        ("--row 0 --by n", "--by: not with --row"),
        ("--search smallest --budget 2 --curves a.svg", "--curves: not with --search"),
        ("--law paper,orca --by n", "--by: not with several laws"),
        ("--row 0 --cluster local", "--cluster: not with --row"),
        ("--row 0 --picture a.txt", "--picture a.txt: allowed: .gif, .png"),
        ("--search zone --budget 2", "--search zone: no zones in this study; allowed: with --wood"),
        ("--search silent --budget 2", "--search silent: no agent dies here; allowed: with --sil"),
        ("--n 3:2", "n: '3:2' is no list; allowed: LOW:HIGH, LOW <= HIGH"),
        ("--n 2:4:9", "n: '2:4:9' is no list; allowed: LOW:HIGH, LOW <= HIGH"),
        ("--out a.xlsx", "--out a.xlsx: allowed: a .csv file, or a .parquet folder"),
    ],
)
def test_what_would_be_ignored_is_refused(
    arguments: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Before anything is flown or written: an option that this way of flying does not read, a
    search for what no mission has, lists without a value, and rows of another kind."""
    monkeypatch.chdir(tmp_path)
    assert said in refused(arguments, monkeypatch, capsys)
    assert not [*tmp_path.iterdir()]


def test_an_empty_list_is_a_mistake(tmp_path: Path) -> None:
    """It would fly no mission, and its table would have no column."""
    with pytest.raises(InputError, match=r"a.yaml:1: n: the list is empty; allowed: one value"):
        study_file(write(tmp_path / "a.yaml", "n: []\n"), {})
