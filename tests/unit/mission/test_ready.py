"""The ready missions: found by name, listed with what they show, copied; and in the wheel."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.errors import InputError
from swarm_ctl.mission import ready

ROOT = Path(__file__).parents[3]


def test_a_name_is_a_ready_mission_and_a_path_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ready.named(Path("hexagon")) == ROOT / "missions" / "hexagon.yaml"
    for file in ("mine.yaml", "mine/hexagon"):
        assert ready.named(Path(file)) == Path(file)
    Path("hexagon").touch()
    assert ready.named(Path("hexagon")) == Path("hexagon")
    with pytest.raises(InputError, match=r"hex: no such file or ready mission; allowed: .*hexagon"):
        ready.named(Path("hex"))


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("sim --mission hexagon --fleet mine.yaml", "mine.yaml: fleet: can't be read"),
        ("station --mission hexa", "hexa: no such file or ready mission"),
        ("validate mine/square.yaml", "mine/square.yaml: no such file; allowed: square, the ready"),
    ],
)
def test_where_a_mission_is_but_read_a_name_will_do(
    line: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert says in str(CliRunner().invoke(app, line.split()).exception)


def test_each_ready_mission_says_what_it_shows() -> None:
    found = ready.ready_missions()
    assert len(found) >= 7
    for path in found.values():
        assert 20 < len(ready.shows(path)) < 200, path


def test_a_copy_is_the_file_and_takes_the_place_of_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["missions", "copy", "square"]).exit_code == 0
    copied = Path("square.yaml").read_bytes()
    assert copied == (ROOT / "missions" / "square.yaml").read_bytes()
    again = CliRunner().invoke(app, ["missions", "copy", "square"])
    assert isinstance(again.exception, InputError)
    assert "square.yaml: is there already" in str(again.exception)


def test_the_wheel_has_the_missions_where_they_are_looked_for() -> None:
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    assert build["targets"]["wheel"]["force-include"] == {"missions": "swarm_ctl/ready_missions"}
    assert ready._FOLDERS[0] == Path(ready.__file__).parents[1] / "ready_missions"
