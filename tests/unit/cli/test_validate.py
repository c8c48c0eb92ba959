"""`validate` and `schema` as a user calls them."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from swarm_ctl.cli.hosts.deploy import deploy
from swarm_ctl.cli.missions.missions import plan, schema, show, validate
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.compile.forecast import FormForecast, StepForecast, forecast
from swarm_ctl.mission.compile.loader import load

HEXAGON = Path(__file__).parents[3] / "missions" / "hexagon.yaml"

CHANGED = [("stop_point  #", "none  #"), ("align: true", "filter: false"), ("h: 0.05 ", "h: 0.2 ")]

app = typer.Typer()
app.command()(validate)
app.command()(schema)
app.command()(plan)
app.command()(deploy)


def shown(path: Path, forecasts: list[StepForecast] | None = None, *, full: bool = False) -> str:
    screen = io.StringIO()
    loaded = load(path)
    expected = forecast(loaded.plan) if forecasts is None else forecasts
    show(PlainConsole(file=screen, width=80), loaded, expected, full=full)
    return screen.getvalue()


def test_it_shows_what_will_be_flown() -> None:
    text = shown(HEXAGON)
    for part in (
        "6 agents",
        load(HEXAGON).plan.fingerprint(),
        "70.0, 80.0",
        "6 simulated",
        "ardupilot 4",
        "graph    1-2 1-3 2-6 3-5 4-5 (",
        "starts 14.14 m (2-6)",
        "hexagon 10.00 m",
        "r_in 2.5 m",
        "5 m/s",
        "takeoff to 10 m",
    ):
        assert part in text
    assert "warning" not in text


@pytest.mark.parametrize("command", ["validate", "plan", "deploy"])
def test_a_forecast_under_r_in_is_refused(command: str, tmp_path: Path) -> None:
    """Two change places by the plain law, which nothing stops: it is not shown as one that can be
    flown, and no drone's computer gets it."""
    text = HEXAGON.read_text().replace("slots: nearest", "slots: fixed")
    for old, new in CHANGED:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "through.yaml"
    path.write_text(text)
    result = CliRunner().invoke(app, [command, str(path)])
    assert isinstance(result.exception, MissionError)
    (problem,) = result.exception.problems
    assert (problem.where, problem.field) == (f"{path}:32", "step 2, form")
    assert "are forecast" in problem.what
    assert problem.allowed.startswith("at least law.r_in = 0.5 units (2.5 m)")


def test_warnings_are_shown_with_their_place(tmp_path: Path) -> None:
    path = tmp_path / "close.yaml"
    path.write_text(HEXAGON.read_text().replace("start: [14, 10]", "start: [12, 11]"))
    late = FormForecast("hexagon", None, 8.0, (1, 2), 20.0)
    expected = forecast(load(path).plan)
    expected[1] = StepForecast(None, late)
    text = shown(path, expected)
    assert f"warning  {path}:19: agents: agents 2 and 6 start 1 units (5 m) apart" in text
    assert "not in time, closest 8.0 m" in text
    late = f"{path}:32: step 2, form hexagon: is not expected to be done before its time-out, 120 s"
    assert f"warning  {late}" in text


def test_a_time_out_that_is_too_short_is_told_with_what_the_step_takes(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text(HEXAGON.read_text().replace("  - land", "  - land: {timeout_s: 12}"))
    assert "step 4, land: is not expected" in shown(path)
    assert "time-out, 12 s; it takes about 23 s" in shown(path)


def test_a_mission_of_many_agents_fits_a_screen() -> None:
    """32 agents that all hear each other: long lists are folded, and `full` unfolds them."""
    many = HEXAGON.with_name("thirtytwo.yaml")
    text = shown(many)
    assert len(text.splitlines()) < 40
    assert "graph    all with all (algebraic connectivity" in text
    assert "22 more agents; --full shows them" in text
    whole = shown(many, full=True)
    assert "31-32 (algebraic connectivity" in whole
    assert "ardupilot 32" in whole
    assert "--full" not in whole


def test_a_mission_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    validate(HEXAGON.with_name("square.yaml"), plot=tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"allowed: a \.png"):
        validate(HEXAGON, plot=tmp_path / "x.nonsense")


def test_the_commands_end_well() -> None:
    assert CliRunner().invoke(app, ["validate", str(HEXAGON)]).exit_code == 0
    result = CliRunner().invoke(app, ["schema"])
    assert result.exit_code == 0
    assert json.loads(result.output)["title"] == "MissionFile"


def test_weather_and_faults_are_shown_and_those_that_come_too_late(tmp_path: Path) -> None:
    text = shown(HEXAGON.parent / "faults.yaml")
    assert "SIM_WIND_SPD 3" in text
    assert "fault    30 s after liftoff for 10 s, agent 6: SIM_GPS_JUMP_N 4" in text
    assert "warning" not in text
    path = tmp_path / "late.yaml"
    path.write_text(
        HEXAGON.read_text() + "simulation: {faults: [{at_s: 500, set: {SIM_LOSS: 5}}]}\n"
    )
    assert (
        "warning  the fault 500 s after liftoff comes later than the expected end, after"
        in shown(path)
    )
