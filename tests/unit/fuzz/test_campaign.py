"""What is drawn may fly and depends on seed and number; a campaign goes on; what is found becomes
small."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.errors import InputError
from swarm_ctl.fuzz import campaign as campaigns
from swarm_ctl.fuzz import shrink as shrinking
from swarm_ctl.fuzz.campaign import FLIGHTS, Campaign, Flight, write_found
from swarm_ctl.fuzz.coverage import FAULTS, NOTHING, STEPS, WHATS, Cell, Coverage, what_of
from swarm_ctl.fuzz.draw import Dice, draw
from swarm_ctl.fuzz.invariants import Broken, Invariant
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.virtual.scenario import Scenario, load_scenario, scenario_text

MISSIONS = Path(__file__).parents[3] / "missions"
DRAWN = 12


def test_a_draw_depends_on_seed_and_number() -> None:
    """And each of them is a scenario that `fly_scenario` takes."""
    texts = [scenario_text(draw(3, number, Coverage())[0]) for number in range(DRAWN)]
    assert len(set(texts)) == DRAWN
    assert [scenario_text(draw(3, number, Coverage())[0]) for number in (4, 7)] == [
        texts[4],
        texts[7],
    ]
    assert scenario_text(draw(4, 4, Coverage())[0]) != texts[4]


def test_all_kinds_are_drawn() -> None:
    drawn = [draw(9, number, Coverage()) for number in range(6 * DRAWN)]
    kinds = {each.kind for scenario, _ in drawn for each in scenario.happens}
    assert kinds == {*FAULTS, "order"}
    steps = {step.kind for _, mission in drawn for step in mission.plan.steps}
    assert steps == {"takeoff", "form", "hold", "move", "rotate", "scale", "return", "land"}
    assert {entry.autopilot for _, m in drawn for entry in m.fleet.agents} == {"ardupilot", "px4"}
    assert any(mission.plan.fence for _, mission in drawn)
    assert any(not scenario.happens for scenario, _ in drawn)


def test_what_was_not_met_is_drawn_more_often() -> None:
    """Everything was met but kills: these are drawn most."""
    met = Coverage(
        Cell(step, after, what)
        for step in STEPS
        for after in (NOTHING, *FAULTS)
        for what in WHATS
        if what != "kill"
        for _ in range(9)
    )
    drawn = Counter(
        what_of(each) for number in range(DRAWN) for each in draw(1, number, met)[0].happens
    )
    assert drawn.most_common(1)[0][0] == "kill"


def test_a_users_mission_stays_as_it_is() -> None:
    file = load(MISSIONS / "square.yaml").file
    data = file.model_dump(mode="json", exclude_unset=True, by_alias=True)
    plans = {draw(1, number, Coverage(), data)[1].plan for number in range(3)}
    assert plans == {load(MISSIONS / "square.yaml").plan}


def test_dice_keep_to_their_bounds() -> None:
    dice = Dice(1)
    assert all(0.5 <= dice.number(0.5, 1.26) <= 1.26 for _ in range(200))
    assert {dice.pick((1, 2, 3), lambda n: float(n != 2)) for _ in range(100)} == {1, 3}
    assert {abs(dice.signed(2, 3)) >= 2 for _ in range(100)} == {True}


# --- a campaign ---


def fake(bad: tuple[int, ...] = ()) -> Any:
    """Flights of no time at all; those in `bad` break something."""

    def flight(_seed: int, _wanted: Coverage, _of: Any, number: int) -> Flight:
        found = (Broken(Invariant.APART, f"{number}.5 m apart"),) if number in bad else ()
        cells = (Cell("form", NOTHING, "kill"),)
        return Flight(number, "completed", 60.0, 0.1, cells, found)

    return flight


def test_a_campaign_goes_on_where_it_was_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line that was cut off is flown again; another seed's folder is refused."""
    monkeypatch.setattr(campaigns, "_flight", fake((3, 8)))
    first = Campaign(1, tmp_path)
    first.load()
    assert [flight.number for flight in first.fly(5, 1)] == [0, 1, 2, 3, 4]
    path = tmp_path / FLIGHTS
    path.write_text(path.read_text()[:-20])
    again = Campaign(1, tmp_path)
    again.load()
    assert [flight.number for flight in again.fly(10, 1)] == [4, 5, 6, 7, 8, 9]
    assert {kind: [f.number for f in found] for kind, found in again.found().items()} == {
        (Invariant.APART, "# m apart"): [3, 8]
    }
    assert again.coverage().count("form", "kill") == 10
    with pytest.raises(InputError, match="another --out"):
        Campaign(2, tmp_path).load()


def test_what_is_found_becomes_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that needs two agents and one order is told by these."""
    number = next(
        n
        for n in range(200)
        if len(draw(6, n, Coverage())[0].happens) > 2
        and any(each.order for each in draw(6, n, Coverage())[0].happens)
    )
    scenario, _ = draw(6, number, Coverage())

    def fly(flown: Scenario, mission: Any) -> Any:
        bad = len(mission.plan.agents) > 1 and any(each.order for each in flown.happens)
        return None, [Broken(Invariant.OBEYS, "it did not")] if bad else []

    monkeypatch.setattr(shrinking, "fly", fly)
    small = shrinking.shrink(scenario, Invariant.OBEYS)
    assert isinstance(small.mission, dict)
    assert len(small.mission["agents"]) == 2
    assert [each.kind for each in small.happens] == ["order"]
    assert len(small.mission["steps"]) == 2
    path, test = write_found(tmp_path, "obeys-6-1", "it did not", scenario_text(small))
    assert load_scenario(path)[0] == small
    compile(test.read_text(), str(test), "exec")


def test_the_command_says_by_its_exit_code_what_it_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaigns, "_flight", fake())
    options = ["--flights", "3", "--processes", "1", "--out", str(tmp_path)]
    good = CliRunner().invoke(app, ["fuzz", *options])
    assert good.exit_code == 0, good.output
    assert "3 flights" in good.output
    assert "0 broke something" in good.output
    monkeypatch.setattr(campaigns, "_flight", fake((4,)))
    monkeypatch.setattr(shrinking, "MOST", 0)
    bad = CliRunner().invoke(app, ["fuzz", *options[2:], "--flights", "6"])
    assert bad.exit_code == 1, bad.output
    assert "1 broke something" in bad.output
    assert (tmp_path / "found" / "apart-1-4.yaml").exists()
