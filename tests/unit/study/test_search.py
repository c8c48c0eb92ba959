"""The search for a study's worst mission: deeper than plain random sampling, the same each time,
and what it finds flies again."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from swarm_ctl.cli.app import main
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.batch.batch import blocks, draw
from swarm_ctl.study.batch.batch_flight import BatchResult
from swarm_ctl.study.executor import fly_studies, run_study
from swarm_ctl.study.parameter_space import Study, study_file
from swarm_ctl.study.rerun import rerun, write_mission
from swarm_ctl.study.rows import Row, rows_of
from swarm_ctl.study.search import Goal, worst
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand

STUDIES = Path(__file__).parents[3] / "studies"
PLANTED = Study.model_validate(
    {"n": "2:5", "delay_s": "0:0.2", "late_s": "-0.5:0.5", "h": "0.05:0.2", "loss": "0:0.2"}
)


def planted(studies: Sequence[Study]) -> Iterator[list[Row]]:
    """Missions as a study draws them, not flown: the nearer they are to a corner of two ranges of
    four agents, the nearer the agents come."""
    for study in studies:
        ((cell, first, count),) = blocks(study)
        batch, result = draw(cell, first, count), BatchResult.blank(count)
        off = np.hypot((0.5 - batch.late_s[0]) / 1.0, (0.2 - batch.delay_s[0]) / 0.2)
        result.smallest[:] = 0.5 + off if cell.n == 4 else 2.0
        yield rows_of(batch, result)


# two seeds of five show it
@pytest.mark.parametrize("seed", [1, 2, on_demand(3), on_demand(4), on_demand(5)])
def test_a_planted_worst_case_is_found_deeper_than_by_random_sampling(seed: int) -> None:
    """A corner of two of four ranges, for one number of agents of four; as many missions."""
    study = PLANTED.model_copy(update={"seed": seed})
    found = worst(study, Goal.SMALLEST, 2000, planted)
    plain = worst(study, Goal.SMALLEST, 2000, planted, narrow=False)
    assert found.row["n"] == 4
    assert found.row["smallest_units"] - 0.5 < 0.5 * (plain.row["smallest_units"] - 0.5)


BARE = Study.model_validate(
    {
        "n": 4,
        "slots": "random",
        "compensation": "none",
        "safety": "off",
        "limit_s": 10,
        "h": "0.001:0.01",
        "kappa": "2:20",
        "dead_time_s": "0:0.4",
        "lag_s": "0.1:0.4",
    }
)


def flown(studies: Sequence[Study]) -> Iterator[list[Row]]:
    """In this process."""
    return fly_studies(studies, 1)


@pytest.mark.long
def test_a_narrow_corner_of_the_bare_law_is_found() -> None:
    """It keeps these agents apart where its rate is low or vehicles are prompt; of as many missions
    drawn plainly, none collides."""
    found = worst(BARE, Goal.SMALLEST, 512, flown)
    plain = worst(BARE, Goal.SMALLEST, 512, flown, narrow=False)
    assert found.row["collided"]
    assert not plain.row["collided"]


@pytest.mark.parametrize("goal", Goal)
def test_the_rounds_spend_the_budget_and_get_worse(goal: Goal) -> None:
    """Not a mission more; each line tells the worst so far."""
    spent: list[int] = []
    told: list[str] = []

    def fly(studies: Sequence[Study]) -> Iterator[list[Row]]:
        spent.extend(study.missions for study in studies)
        return flown(studies)

    study = BARE.model_copy(update={"n": (2,), "limit_s": 2.0})
    found = worst(study, goal, 50, fly, say=told.append)
    assert sum(spent) == 50
    assert told[-1] == f"50 of 50 missions: {goal.told(found.row)}"
    assert found.badness == goal.badness(found.row)


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    """The exit code of `swarm-ctl study`."""
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "study", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_the_command_leaves_a_row_that_flies_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both figures are told; the row is in a file of its own, as a picture and as a mission."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "few.yaml").write_text("n: 2,3\nlate_s: -0.5:0.5\nmissions: 9\nlimit_s: 2\n")
    given = ["few.yaml", "--search", "smallest", "--budget", "32", "--processes", "1"]
    files = ["--mission", "new/worst.yaml", "--picture", "new/worst.png"]
    assert command(monkeypatch, *given, *files) in (0, None)
    told = capsys.readouterr().out
    assert "searched, 32 missions: smallest distance" in told
    assert "plain random sampling, 32 missions: smallest distance" in told
    number = int(told.split("--row ")[1].split()[0])
    again = rerun(tmp_path / "few-smallest.csv", number)
    assert again.row == again.before
    assert f"{again.row['smallest_units']:.3f} units" in told
    assert (tmp_path / "new/worst.png").stat().st_size > 0
    assert len(load(tmp_path / "new/worst.yaml").fleet.agents) == again.row["n"]
    assert command(monkeypatch, *given) == 2


def test_a_row_flies_without_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the study that is said, options included; no rows are there, and none are written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "few.yaml").write_text("n: 2,3\nmissions: 9\nlimit_s: 2\n")
    given = ["few.yaml", "--n", "4", "--row", "7", "--mission", "row.yaml"]
    assert command(monkeypatch, *given) in (0, None)
    assert "mission: swarm-ctl run row.yaml" in capsys.readouterr().out
    assert len(load(tmp_path / "row.yaml").fleet.agents) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["few.yaml", "row.yaml"]
    assert command(monkeypatch, "few.yaml", "--row", "18") == 2
    assert "rows 0 to 17" in capsys.readouterr().err
    assert command(monkeypatch, "--law", "orca,paper", "--row", "1") == 2


def test_a_find_flies_again_on_the_virtual_clock(tmp_path: Path) -> None:
    """Real agents, drivers and simulated vehicles come about as near as the worst row did."""
    facing = {"n": 3, "start": "crossing", "slots": "given", "limit_s": 20, "spread": "agent"}
    study = Study.model_validate(facing | {"late_s": "-0.4:0.5", "h": "0.05:0.2"})
    found = worst(study, Goal.SMALLEST, 64, flown)
    run_study(found.study, tmp_path / "worst.csv", 1, Console(file=io.StringIO()))
    again = rerun(tmp_path / "worst.csv", found.row["row"])
    assert write_mission(again, tmp_path / "worst.yaml", lambda _: 0.0) == []
    swarm = VirtualSwarm(load(tmp_path / "worst.yaml"))
    swarm.run(25.0)
    smallest = swarm.closest_m / study.unit_m
    assert smallest == pytest.approx(found.row["smallest_units"], abs=0.1)


@pytest.mark.parametrize(
    ("arguments", "wrong"),
    [
        (["--search", "nearest"], "allowed: smallest, silent, slowest, zone, link"),
        (["--search", "link", "--row", "3"], "not with --row"),
    ],
)
def test_what_cannot_be_searched_is_refused(
    arguments: list[str],
    wrong: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, *arguments) == 2
    assert wrong in "".join(capsys.readouterr())


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("file", ["search", "search-lag"])
def test_no_pair_comes_under_r_in_in_the_whole_stated_envelope(file: str) -> None:
    """The worst of the envelope within a fixed budget."""
    study = study_file(STUDIES / f"{file}.yaml", {}).study
    found = worst(study, Goal.SMALLEST, 1000, partial(fly_studies, processes=None))
    assert found.row["smallest_units"] >= study.law.r_in, found.row
