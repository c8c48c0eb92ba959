"""What is drawn may fly and depends on seed and number; a campaign goes on; what is found becomes
small."""

from __future__ import annotations

import os
import resource
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.cli.shared.options import alone_at, alone_in
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.fuzz import campaign as campaigns
from swarm_ctl.fuzz import shrink as shrinking
from swarm_ctl.fuzz.campaign import FLIGHTS, Campaign, DrawnFlight, write_found
from swarm_ctl.fuzz.coverage import FAULTS, NOTHING, STEPS, WHATS, Coverage, CoverageCell, what_of
from swarm_ctl.fuzz.draw.dice import Data
from swarm_ctl.fuzz.draw.scenario import draw
from swarm_ctl.fuzz.invariants.table import Broken, Invariant
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.mission.steps.table import KINDS
from swarm_ctl.virtual.scenario import Scenario, load_scenario, scenario_of, scenario_text

MISSIONS = Path(__file__).parents[3] / "missions"
DRAWN = 12


@cache
def drawn(number: int) -> tuple[Scenario, LoadedMission]:
    """What a seed draws, where nothing was met."""
    return draw(3, number, Coverage())


def test_a_draw_depends_on_seed_and_number() -> None:
    """And each of them is a scenario that `fly_scenario` takes."""
    texts = [scenario_text(drawn(number)[0]) for number in range(DRAWN)]
    assert len(set(texts)) == DRAWN
    for number in (4, 7):
        assert scenario_text(draw(3, number, Coverage())[0]) == texts[number]
    assert scenario_text(draw(4, 4, Coverage())[0]) != texts[4]


def test_all_kinds_are_drawn() -> None:
    """Among what a seed draws first; also missions with a wake, a fence, a barrier that is no join,
    and scenarios in which nothing happens."""
    happenings = {*FAULTS, "order"}
    missing = {*happenings, *KINDS, "ardupilot", "px4", "wake", "fence", "meet", "nothing"}
    for scenario, mission in map(drawn, range(6 * DRAWN)):
        plan, kinds = mission.plan, {each.kind for each in scenario.happens} or {"nothing"}
        assert kinds <= {*happenings, "nothing"}
        missing -= kinds | {at.step.kind for at in plan.all_steps()}
        missing -= {entry.autopilot for entry in mission.fleet.agents}
        missing -= {"wake"} if plan.wake else set()
        missing -= {"fence"} if plan.fence else set()
        missing -= {at.step.barrier for at in plan.all_steps()}  # the drawn ones are called "meet"
        if not missing:
            break
    assert not missing


def test_what_was_not_met_is_drawn_more_often() -> None:
    """Everything was met but kills: these are drawn far more often than where nothing was."""
    met = Coverage(
        CoverageCell(step, after, what)
        for step in STEPS
        for after in (NOTHING, *FAULTS)
        for what in WHATS
        if what != "kill"
        for _ in range(9)
    )
    knowing = [draw(3, number, met)[0] for number in range(DRAWN)]
    kills = [
        sum(what_of(each) == "kill" for scenario in scenarios for each in scenario.happens)
        for scenarios in (knowing, [drawn(number)[0] for number in range(DRAWN)])
    ]
    assert kills[0] > 3 * max(1, kills[1])


def test_a_users_mission_stays_as_it_is() -> None:
    file = load(MISSIONS / "square.yaml").file
    data = file.model_dump(mode="json", exclude_unset=True, by_alias=True)
    plans = {draw(1, number, Coverage(), data)[1].plan for number in range(3)}
    assert plans == {load(MISSIONS / "square.yaml").plan}


# --- a campaign ---


def fake(bad: tuple[int, ...] = ()) -> Any:
    """Flights of no time at all; those in `bad` break something."""

    def flight(_seed: int, _wanted: Coverage, _of: Any, _too: int, number: int) -> DrawnFlight:
        found = (Broken(Invariant.APART, f"{number}.5 m apart"),) if number in bad else ()
        cells = (CoverageCell("form", NOTHING, "kill"),)
        return DrawnFlight(number, "completed", 60.0, 0.1, cells, found)

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
    third = Campaign(1, tmp_path)
    third.load()
    assert third.done == again.done
    with pytest.raises(InputError, match="another --out"):
        Campaign(2, tmp_path).load()


def test_a_full_disk_is_named_and_the_campaign_goes_on(tmp_path: Path) -> None:
    """As a limit of a file's size tells of one: no part of the journal's head is left."""
    campaign, (soft, hard) = Campaign(1, tmp_path), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        with pytest.raises(OSError, match=FLIGHTS):
            campaign.load()
        with pytest.raises(OSError, match=r"obeys-6-1\.yaml"):
            write_found(tmp_path, "obeys-6-1", "it did not", "version: 1\n")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not [each for each in tmp_path.rglob("*") if each.is_file()]
    campaign.load()


@pytest.mark.parametrize(
    ("command", "out"),
    [
        ("fuzz --flights 1", ""),
        ("evidence --row mix", ""),
        ("paper --seeds 1", ""),
        ("study --n 2 --missions 1", "rows.csv"),
    ],
)
def test_two_never_write_into_one_place(command: str, out: str, tmp_path: Path) -> None:
    """The second one would fly the same again, and mix the journals."""
    written, alone = tmp_path / out, alone_at if out else alone_in
    with alone(written):
        refused = CliRunner().invoke(app, [*command.split(), "--out", str(written)])
    assert isinstance(refused.exception, StartError)
    assert str(refused.exception) == (
        f"{written}: another swarm-ctl writes here now; allowed: another --out, or this command"
        " again when that one has ended"
    )
    assert [path.name for path in tmp_path.iterdir()] == [f".{out}.lock" if out else ".lock"]
    with alone(written):
        pass


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("elsewhere")])
def test_a_strangers_folder_has_no_lock_that_waits_or_leads_elsewhere(
    make: Callable[[Path], None], tmp_path: Path
) -> None:
    make(tmp_path / ".lock")
    with pytest.raises(StartError, match=r"\.lock: can't be locked: .*; allowed: another --out"):
        alone_in(tmp_path).__enter__()
    assert len(list(tmp_path.iterdir())) == 1


def test_time_ends_a_campaign_within_a_hundred_flights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaigns, "_flight", fake())
    campaign = Campaign(1, tmp_path)
    campaign.load()
    assert len(list(campaign.fly(300, 1, until_s=0.0))) == 1


def test_a_journal_that_was_cut_off_loses_one_flight_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line that is written next does not become part of the cut one."""
    monkeypatch.setattr(campaigns, "_flight", fake())
    flown = []
    for cut in (20, 0, 0):
        campaign = Campaign(1, tmp_path)
        campaign.load()
        flown.append([flight.number for flight in campaign.fly(3, 1)])
        path = tmp_path / FLIGHTS
        path.write_text(path.read_text()[: -cut or None])
    assert flown == [[0, 1, 2], [2], []]


def dies(_seed: int, _wanted: Coverage, _of: Any, _too: int, number: int) -> DrawnFlight:
    """The second flight takes its process with it."""
    if number == 1:
        os._exit(9)
    return DrawnFlight(number, "completed", 60.0, 0.1, (), ())


def test_a_process_that_dies_ends_the_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pool would wait for its flight for ever."""
    monkeypatch.setattr(campaigns, "_flight", dies)
    monkeypatch.setattr(campaigns, "_LOOKS_S", 0.1)
    campaign = Campaign(1, tmp_path)
    campaign.load()
    with pytest.raises(StartError, match="was killed"):
        list(campaign.fly(3, 2))
    again = Campaign(1, tmp_path)
    again.load()
    assert 1 not in again.done


def test_all_that_a_flight_broke_is_counted(tmp_path: Path) -> None:
    """A fault that all flights have hides no other one; one that broke twice counts once."""
    both = Broken(Invariant.APART, "1 m"), Broken(Invariant.DOWN, "2"), Broken(Invariant.DOWN, "3")
    campaign = Campaign(1, tmp_path, done={4: DrawnFlight(4, "failed", 9.0, 0.1, (), both)})
    assert [(kind[0], len(found)) for kind, found in campaign.found().items()] == [
        (Invariant.APART, 1),
        (Invariant.DOWN, 1),
    ]


def planted(
    monkeypatch: pytest.MonkeyPatch, invariant: Invariant, bad: Callable[[Data], bool]
) -> Counter[str]:
    """No flight of shrinking takes time: those of a scenario that is `bad` break something."""
    flown = Counter[str]()

    def fly(scenario: Scenario, _mission: Any, *, twice: bool) -> Any:
        flown["twice" if twice else "once"] += 1
        data = scenario.model_dump(mode="json", exclude_unset=True, by_alias=True)
        return None, [Broken(invariant, f"{len(data['happens'])} m")] if bad(data) else []

    monkeypatch.setattr(shrinking, "fly", fly)
    return flown


def busy(seed: int) -> Scenario:
    """A drawn scenario with four happenings or more, an order among them."""
    drawn = (draw(seed, number, Coverage())[0] for number in range(200))
    return next(
        scenario
        for scenario in drawn
        if len(scenario.happens) > 3 and any(each.order for each in scenario.happens)
    )


def test_what_is_found_becomes_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that needs two agents and one order is told by these, after few flights."""
    flown = planted(
        monkeypatch,
        Invariant.OBEYS,
        lambda data: (
            len(data["mission"]["agents"]) > 1 and any("order" in each for each in data["happens"])
        ),
    )
    small = shrinking.shrink(busy(6), Broken(Invariant.OBEYS, "5 m"))
    assert small is not None
    assert isinstance(small.mission, dict)
    assert len(small.mission["agents"]) == 2
    assert [each.kind for each in small.happens] == ["order"]
    assert len(small.mission["steps"]) == 2
    assert not small.mission.keys() & {"policies", "fence", "simulation", "vehicle"}
    assert flown["once"] < 80
    path, test = write_found(tmp_path, "obeys-6-1", "it did not", scenario_text(small))
    assert load_scenario(path)[0] == small
    compile(test.read_text(), str(test), "exec")


def test_a_loss_is_all_that_stays_of_a_bad_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mesh and weather become smaller by parts, and agents leave orders and parts."""
    square = load(MISSIONS / "square.yaml").file
    mission = square.model_dump(mode="json", exclude_unset=True, by_alias=True)
    wind = {"SIM_WIND_SPD": 3.0, "SIM_GPS_NOISE": 0.1}
    mission |= {"simulation": {"since": "start", "parameters": wind}}
    happens = [
        {"at_s": 9, "order": "hold @1,3"},
        {"at_s": 12, "part": {"one": [1, 2], "other": [3, 4, "station"]}},
    ]
    mesh = {"loss": 0.2, "delay_s": 0.1, "duplicate": 0.1}
    data = {"version": 1, "mission": mission, "mesh": mesh, "happens": happens}
    scenario, _ = scenario_of(yaml_file.write(data))
    planted(
        monkeypatch,
        Invariant.ACTS,
        lambda data: (
            "loss" in data.get("mesh", {})
            and "SIM_GPS_NOISE" in data["mission"].get("simulation", {}).get("parameters", {})
            and any("@1" in each.get("order", "") for each in data["happens"])
            and any("part" in each for each in data["happens"])
        ),
    )
    small = shrinking.shrink(scenario, Broken(Invariant.ACTS, "1 m"))
    assert small is not None
    assert isinstance(small.mission, dict)
    assert small.mesh.model_dump(exclude_unset=True) == {"loss": 0.2}
    assert small.mission["simulation"]["parameters"] == {"SIM_GPS_NOISE": 0.1}
    assert len(small.mission["agents"]) == 2  # a square has no side with one
    order, part = small.happens
    assert order.order == "hold @1"
    assert part.part is not None
    assert (len(part.part.one), len(part.part.other)) == (1, 1)


def test_only_the_same_error_stays_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """What raises another one, in another place, is not what was found."""
    planted(monkeypatch, Invariant.RAISES, lambda _: True)
    assert shrinking.shrink(busy(6), Broken(Invariant.RAISES, "KeyError: 'x'")) is None
    small = shrinking.shrink(busy(6), Broken(Invariant.RAISES, "Traceback\n5 m"))
    assert small is not None
    assert small.happens == ()


def test_what_does_not_break_any_more_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where it was mended, and the same command is given again."""
    flown = planted(monkeypatch, Invariant.OBEYS, lambda _: False)
    assert shrinking.shrink(busy(6), Broken(Invariant.OBEYS, "5 m")) is None
    assert flown.total() == 1


@pytest.mark.parametrize("words", ['KeyError: "x"', r"ValueError: C:\new \x", 'a """ b', "{name}"])
def test_a_test_of_any_words_is_python(words: str, tmp_path: Path) -> None:
    _, test = write_found(tmp_path, "raises-1-1", f"Traceback\n{words}", "version: 1\n")
    compile(test.read_text(), str(test), "exec")


def test_the_command_says_by_its_exit_code_what_it_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaigns, "_flight", fake())
    out = tmp_path / "a b"
    options = ["--flights", "3", "--processes", "1", "--out", str(out)]
    good = CliRunner().invoke(app, ["fuzz", *options])
    assert good.exit_code == 0, good.output
    assert "3 flights" in good.output
    assert "0 broke something" in good.output
    monkeypatch.setattr(campaigns, "_flight", fake((4,)))
    planted(monkeypatch, Invariant.APART, lambda _: True)
    monkeypatch.setattr(shrinking, "MOST", 1)
    bad = CliRunner().invoke(app, ["fuzz", *options[2:], "--flights", "6"])
    assert bad.exit_code == 1, bad.output
    assert "1 broke something" in bad.output
    assert (small := out / "found" / "apart-1-4.yaml").exists()
    assert f"again: swarm-ctl fuzz --replay '{small}'" in "".join(bad.output.split("\n"))
    planted(monkeypatch, Invariant.APART, lambda _: False)
    mended = CliRunner().invoke(app, ["fuzz", *options[2:], "--flights", "6"])
    assert mended.exit_code == 1, mended.output
    assert "it does not break that" in mended.output


def test_a_mission_that_splits_is_varied() -> None:
    """Its groups are drawn into orders by their names."""
    file = load(MISSIONS / "groups.yaml").file
    data = file.model_dump(mode="json", exclude_unset=True, by_alias=True)
    scenarios = (draw(1, number, Coverage(), data)[0] for number in range(DRAWN // 2))
    lines = (each.order for scenario in scenarios for each in scenario.happens)
    assert any("@scouts" in line or "@sweepers" in line for line in lines)
