"""`--attach`, and its short words: each is a line of one table."""

from __future__ import annotations

from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.cli.shared import options
from swarm_ctl.cli.shared.options import Attach, ShortWord, attaching, filled

RADIO = ShortWord("radio", "lamp", "CHANNEL", "A lamp.", alone="0")


def test_short_words_become_attachments(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the help, too; each may be repeated, and one more is one line of the table."""
    monkeypatch.setattr(options, "SHORT_WORDS", (*options.SHORT_WORDS, RADIO))
    got: list[object] = []

    @attaching
    def fly(mission: Annotated[str, typer.Argument()], attach: Attach = None) -> None:
        got.append((mission, attach))

    one = typer.Typer()
    one.command()(fly)
    words = ["hexagon", "--radio", "3", "--attach", "lamp", "--metrics", "9100", "--radio", "4"]
    assert CliRunner().invoke(one, words).exit_code == 0
    assert CliRunner().invoke(one, ["hexagon"]).exit_code == 0
    assert got == [("hexagon", ["lamp", "prometheus=9100", "lamp=3", "lamp=4"]), ("hexagon", [])]
    help_ = CliRunner().invoke(one, ["--help"]).output
    assert "--radio" in help_
    assert "--foxglove" in help_


def test_an_option_may_stand_without_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(options._ALONE, "--radio", "0")
    assert filled(["run", "--radio", "hexagon"]) == ["run", "--radio=0", "hexagon"]
    assert filled(["--radio", "7", "--gcs", "--radio"]) == [
        "--radio",
        "7",
        "--gcs=14550",
        "--radio=0",
    ]
    for value in ("host:14551", "192.168.1.30", "[::1]:14550", "host:", "7,orders"):
        assert filled(["--gcs", value, "--metrics"]) == ["--gcs", value, "--metrics"]
    assert filled(["--gcs", "3-drones.yaml"]) == ["--gcs=14550", "3-drones.yaml"]


@pytest.mark.parametrize("command", [["run", "hexagon"], ["station"]])
def test_a_name_that_is_not_installed_is_answered_by_those_that_are(command: list[str]) -> None:
    error = CliRunner().invoke(app, [*command, "--attach", "lmap=3"]).exception
    assert str(error) == (
        "--attach lmap=3: no such extension is installed; allowed: browser, foxglove, prometheus,"
        " ros2"
    )
