"""Studies: the same rows however they are flown, and each number in a row against its
definition."""

from __future__ import annotations

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.law.graph import components
from swarm_ctl.core.model.plan import Compensation, LawParameters
from swarm_ctl.errors import InputError
from swarm_ctl.study import executor
from swarm_ctl.study.batch import batch as batch_module
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import Range, Study, value
from swarm_ctl.study.rerun import Trace, rerun
from swarm_ctl.study.rows import read_rows
from swarm_ctl.study.rows_table import exact_interval, quantile, tables

SHORT: dict[str, Any] = {"missions": 40, "limit_s": 6.0, "seed": 5}


def silent() -> Console:
    return Console(file=io.StringIO())


def only_batch(**settings: Any) -> Batch:
    """The one block of a small study."""
    study = Study.model_validate(SHORT | settings)
    ((cell, first, count),) = blocks(study)
    return draw(cell, first, count)


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several blocks out of few missions."""
    monkeypatch.setattr(batch_module, "block_size", lambda n: 16)


LATE: dict[str, Any] = {
    "n": (3, 4),
    "slots": ("random",),
    "delay_s": (Range(low=0.0, high=0.2),),
    "loss": (Range(low=0.0, high=0.3),),
}
UNEQUAL: dict[str, Any] = {
    "spread": "agent",
    "lag_s": "0.2:0.9",
    "dead_time_s": "0.1:0.8",
    "acceleration_mps2": "1:4",
    "late_s": "0:0.2",
    "jitter_s": "0:0.3",
    "burst_s": "0:0.5",
    "silent": 0.5,
    "silent_agents": "1:2",
}
"""What each agent, message and link has for itself."""


def test_one_process_and_two_write_the_same_file(tmp_path: Path) -> None:
    """Byte for byte, late and lost news included."""
    study = Study.model_validate(SHORT | LATE | UNEQUAL | {"limit_s": 2.0})
    for processes in (1, 2):
        run_study(study, tmp_path / f"{processes}.csv", processes, silent())
    text = (tmp_path / "1.csv").read_bytes()
    assert text == (tmp_path / "2.csv").read_bytes()
    assert text.count(b"\n") == 1 + 80


@pytest.mark.parametrize(
    "more", [{"safety": ("off", "exchange")}, {"silent": value(0.3)}, {"jitter_s": value(0.1)}]
)
def test_rows_do_not_depend_on_what_flies_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, Any]
) -> None:
    """Cells flown one by one, and those that are alike together: byte for byte the same."""
    cells = {"start": ("random", "crossing"), "slots": ("given", "nearest"), "missions": 5}
    study = Study.model_validate(SHORT | LATE | cells | more | {"limit_s": 3.0})
    found = []
    for pairs in (1, 10**6):
        monkeypatch.setattr(executor, "_PAIRS", pairs)
        monkeypatch.setattr(executor, "_SHARES", 1)
        work = dict(enumerate(blocks(study)))
        found.append(len(executor._groups(work, 1)))
        run_study(study, tmp_path / f"{pairs}.csv", 1, silent())
    assert found == [8 * len(study.safety), 2 * len(study.safety)]
    assert (tmp_path / "1.csv").read_bytes() == (tmp_path / "1000000.csv").read_bytes()


@pytest.mark.usefixtures("small_blocks")
def test_an_interrupted_study_goes_on_to_the_same_file(tmp_path: Path) -> None:
    """Torn anywhere, the file ends up as if nothing had happened."""
    study = Study.model_validate(SHORT | LATE | {"limit_s": 2.0})
    path = tmp_path / "rows.csv"
    run_study(study, path, 1, silent())
    whole = path.read_bytes()
    for cut in (1, 300, 5000, 9000, len(whole) - 9):
        path.write_bytes(whole[:-cut])
        run_study(study, path, 1, silent())
        assert path.read_bytes() == whole, cut


def test_rows_that_are_whole_are_never_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is full where a study goes on costs no row that is there."""
    study = Study.model_validate(SHORT | LATE | {"limit_s": 2.0})
    path = tmp_path / "rows.csv"
    run_study(study, path, 1, silent())
    whole = path.read_bytes()
    path.write_bytes(whole[:-5000])

    def full(path: Path, *_: object) -> int:
        path.open("wb").close()  # as `write_bytes` begins
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    run_study(study, path, 1, silent())
    assert path.read_bytes() == whole


def test_another_study_is_not_mixed_in(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    study = Study.model_validate(SHORT | {"missions": 3})
    run_study(study, path, 1, silent())
    with pytest.raises(InputError, match="another study"):
        run_study(study.model_copy(update={"seed": 6}), path, 1, silent())


@pytest.mark.parametrize("vehicle", ["ideal", "lag", "ardupilot", "px4"])
@pytest.mark.parametrize("unequal", [{}, UNEQUAL], ids=["alike", "unequal"])
def test_a_row_flown_alone_is_the_row(
    tmp_path: Path, vehicle: str, unequal: dict[str, Any]
) -> None:
    """To the last digit, for every kind of vehicle; deaths, jitter and bursts, too."""
    few = {"vehicle": (vehicle,), "missions": 12, "limit_s": 3.0}
    study = Study.model_validate(SHORT | LATE | unequal | few)
    path = tmp_path / "rows.csv"
    run_study(study, path, 1, silent())
    for row in (0, 5, 17):
        flown = rerun(path, row)
        assert flown.before is not None
        assert {name: str(number) for name, number in flown.row.items()} == {
            name: str(number) for name, number in flown.before.items()
        }
        alone = rerun(tmp_path / "none.csv", row, study)
        assert (alone.row, alone.before) == (flown.row, None)
    with pytest.raises(InputError, match="another study"):
        rerun(path, 0, study.model_copy(update={"seed": 6}))
    with pytest.raises(InputError, match="rows 0 to 23"):
        rerun(path, 24)


def _in_one_part(links: npt.NDArray[np.bool_]) -> bool:
    graph = {i: np.flatnonzero(row).tolist() for i, row in enumerate(links)}
    return len(components(graph)) == 1


@pytest.mark.parametrize("n", [2, 6, 20])
def test_starts_are_apart_and_connected(n: int) -> None:
    """Every drawn mission could be flown: no two too close, one connected graph, symmetric
    links."""
    batch = only_batch(n=(n,), start_spacing=1.2)
    for k in range(len(batch)):
        starts = batch.starts[..., k].T
        apart = np.linalg.norm(starts[:, None] - starts[None], axis=-1)
        assert apart[~np.eye(n, dtype=bool)].min() > 1.2
        assert _in_one_part(batch.links[..., k])
    assert (batch.links == batch.links.transpose(1, 0, 2)).all()


def test_an_area_too_small_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_module, "_TRIES", 20)
    with pytest.raises(InputError, match="area 1: found no 6 starts"):
        only_batch(area=value(1.0))


def test_outcomes_by_their_definition() -> None:
    """Smallest distance, longest link and broken links against the whole track of single
    missions."""
    batch = only_batch(slots=("random",), vehicle=("ideal",), limit_s=20.0)
    outcome = fly(batch)
    assert outcome.converged.any()
    for k in range(0, len(batch), 13):  # each is flown alone, a second
        trace = Trace()
        alone = batch.only(np.array([k]))
        fly(alone, trace)
        tracks = trace.positions()[: outcome.steps[k]]
        apart = np.hypot(*(tracks[:, :, :, None] - tracks[:, :, None]).transpose(1, 0, 2, 3))
        pairs = list(itertools.combinations(range(6), 2))
        lengths = {(i, j): apart[:, i, j].max() for i, j in pairs if batch.links[i, j, k]}
        nearest = min(apart[:, i, j].min() for i, j in pairs)  # between ticks a little less
        assert nearest - 0.05 < outcome.smallest[k] <= nearest
        assert outcome.longest_link[k] == pytest.approx(max(lengths.values()))
        assert outcome.links[k] == len(lengths)
        assert outcome.links_broken[k] == sum(length > 4.5 for length in lengths.values())
        e = tracks - batch.slots[..., k]
        away = np.linalg.norm(e - e.mean(axis=2, keepdims=True), axis=1).max(axis=1)
        assert outcome.error[k] == pytest.approx(away[-1])
        looks = away[::5] < 0.1
        assert outcome.converged[k] == looks[-5:].all()
        if outcome.converged[k]:
            first = round(outcome.time_s[k] / 0.05 / 5)
            assert looks[first:].all()
            assert not looks[first - 1]


def test_ideal_with_a_whole_iteration_a_tick_is_the_discrete_form() -> None:
    """p <- p + u, (9), from the law itself."""
    from tests.unit.core.law.evaluated import evaluate

    batch = only_batch(vehicle=("ideal",), n=(4,), limit_s=2.0, missions=4, safety=("off",))
    traces = Trace()
    fly(batch.only(np.array([2])), traces)
    p, z, links = batch.starts[..., 2].T, batch.slots[..., 2].T, batch.links[..., 2]
    lower = np.triu(np.ones((4, 4), dtype=bool), 1)
    law = LawParameters(h=0.05)
    for position in traces.positions()[:20]:
        assert pytest.approx(p, abs=1e-9) == position.T
        p = (
            p
            + evaluate(
                p,
                z,
                np.tile(p, (4, 1, 1)),
                np.tile(z, (4, 1, 1)),
                links,
                ~np.eye(4, dtype=bool),
                lower,
                law,
            ).u
        )


def test_stop_points_keep_real_vehicles_apart_where_positions_do_not() -> None:
    """docs/understand/law.md#from-units-to-a-vehicle, measured: with dead time and lag the plain
    law collides often."""
    settings = {
        "n": (6,),
        "slots": ("random",),
        "missions": 150,
        "limit_s": 40.0,
        "start": ("ring",),
        "safety": ("off",),
    }
    plain = fly(only_batch(**settings, compensation=(Compensation.NONE,), kappa=value(10.0)))
    compensated = fly(only_batch(**settings))
    collided = [np.count_nonzero(outcome.smallest < 0.5) for outcome in (plain, compensated)]
    assert collided[0] > 30
    assert collided[1] <= collided[0] / 10


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"n": (1,)}, "n: allowed"),
        ({"kappa": value(30.0)}, "kappa"),
        ({"spacing": value(1.0)}, "spacing"),
        ({"wind_mps": value(5.0)}, "wind"),
        ({"loss": value(1.0)}, "loss"),
        ({"n": (5,), "start": ("table2",)}, "table2"),
        ({"law": LawParameters(r_in=2.0)}, "r_in < r_out"),
    ],
)
def test_impossible_studies_are_refused(wrong: dict[str, Any], text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        Study.model_validate(SHORT | wrong)


def test_exact_interval_against_known_values() -> None:
    """Those of scipy's `beta.ppf`, also of many missions and of nearly all."""
    assert exact_interval(1, 10) == pytest.approx((0.0025286, 0.4450161), abs=1e-7)
    assert exact_interval(0, 1000) == (0.0, pytest.approx(1 - 0.025 ** (1 / 1000)))
    assert exact_interval(2, 2_477_240) == pytest.approx((9.77739e-8, 2.916423e-6), rel=1e-6)
    assert exact_interval(1733, 1734) == pytest.approx((0.9967911, 0.9999854), abs=1e-7)
    assert exact_interval(1000, 1000)[1] == 1.0
    assert exact_interval(0, 0) == (0.0, 1.0)


def test_the_interval_of_a_median_holds_it_as_often_as_it_says() -> None:
    """In 95 % of samples, or a little more; where no value bounds it, the interval says so."""
    random = np.random.default_rng(1)
    held = 0
    for sample in random.uniform(0.0, 1000.0, (1000, 60)):
        low, high = quantile(list(sample), 50).split("(")[1].rstrip(")").split(" to ")
        held += float(low) <= 500.0 <= float(high)
    assert 940 <= held <= 985
    assert quantile([1.0, 2.0, 3.0], 95) == "2.9 (2.0 to -)"
    assert quantile([], 50) == "-"


def test_tables_fit_the_terminal(tmp_path: Path) -> None:
    """However many columns there are: no cell is cut at 80 characters, none is left out."""
    study = Study.model_validate(SHORT | {"n": (3, 4, 5, 6), "missions": 5})
    run_study(study, tmp_path / "rows.csv", 1, silent())
    found = tables(study, read_rows(tmp_path / "rows.csv"), width=80)
    assert [n for each in found for n in table_rows(each)["n"]] == ["3", "4", "5", "6"]
    screen = io.StringIO()
    Console(file=screen, width=80).print(*found)
    assert "…" not in screen.getvalue()
    for each in found:
        for cells in table_rows(each).values():
            assert all(cell in screen.getvalue() for cell in cells)


def table_rows(table: Table) -> dict[str, list[str]]:
    """The cells of each line, by its first."""
    first, *rest = ([str(cell) for cell in column.cells] for column in table.columns)
    return {name: [column[k] for column in rest] for k, name in enumerate(first)}
