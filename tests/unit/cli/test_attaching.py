"""`--attach`, and its short words: each is a line of one table."""

from __future__ import annotations

from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.cli.shared import options
from swarm_ctl.cli.shared.options import Attach, ShortWord, attaching, filled, gcs_addresses
from swarm_ctl.errors import InputError

RADIO = ShortWord("radio", "ros2", "CHANNEL", "Words of ROS 2.", alone="0")


def test_short_words_become_attachments(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the help, too; each may be repeated, and one more is one line of the table."""
    monkeypatch.setattr(options, "SHORT_WORDS", (*options.SHORT_WORDS, RADIO))
    got: list[object] = []

    @attaching
    def fly(mission: Annotated[str, typer.Argument()], attach: Attach = None) -> None:
        got.append((mission, attach))

    one = typer.Typer()
    one.command()(fly)
    words = ["hexagon", "--radio", "3", "--attach", "ros2", "--metrics", "9100", "--radio", "4"]
    assert CliRunner().invoke(one, words).exit_code == 0
    assert CliRunner().invoke(one, ["hexagon"]).exit_code == 0
    assert got == [("hexagon", ["ros2", "prometheus=9100", "ros2=3", "ros2=4"]), ("hexagon", [])]
    help_ = CliRunner().invoke(one, ["--help"]).output
    assert "--radio" in help_
    assert "--foxglove" in help_


def test_ground_control_software_that_is_named_twice_is_told_all_once() -> None:
    assert gcs_addresses(["14550", "127.0.0.1:14550"]) == (("127.0.0.1", 14550),)


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


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            ["--attach", "lmap=3"],
            (
                "--attach lmap=3: no such extension is installed; allowed: browser, foxglove,"
                " prometheus, ros2"
            ),
        ),
        (
            ["--metrics", "8765", "--attach", "foxglove"],
            (
                "--attach foxglove and --metrics 8765: both would serve at 127.0.0.1:8765; allowed:"
                " a port of its own for each"
            ),
        ),
        (
            ["--web", "9100", "--ros2", "0", "--web", "9100"],
            (
                "--web 9100 and --web 9100: both would serve at 127.0.0.1:9100; allowed: a port of"
                " its own for each"
            ),
        ),
    ],
)
@pytest.mark.parametrize("command", [["run", "hexagon"], ["station"]])
def test_what_can_not_be_attached_is_refused_before_anything_starts(
    command: list[str], given: list[str], said: str
) -> None:
    """A name that is not installed, by those that are; two that would have one port, by both."""
    error = CliRunner().invoke(app, [*command, *given]).exception
    assert (type(error), str(error)) == (InputError, said)
