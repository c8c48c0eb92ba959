"""Missions of a study through woods: the same wood for the same row, the way as a flight plans it,
no trunk entered, and the truth told where one is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.study.batch import batch_flight, flight
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.executor import batch_of_row
from swarm_ctl.study.parameter_space import Study
from swarm_ctl.study.rerun import Rerun, Trace, write_mission
from swarm_ctl.study.rows import rows_of
from tests.unit.study.flown import held_alike


def woods(**settings: Any) -> Batch:
    """The one block of a small study."""
    of = {"missions": 3, "n": 4, "h": 0.2, "wood": "trunks", "trunks": 12, **settings}
    ((cell, first, count),) = blocks(Study.model_validate(of))
    return draw(cell, first, count)


def test_a_row_has_the_same_wood_whatever_is_flown_beside_it() -> None:
    study = Study.model_validate({"missions": 3, "n": (3, 4), "wood": "trunks", "trunks": "5:12"})
    ((cell, first, count),) = [each for each in blocks(study) if each[0].n == 4]
    whole = draw(cell, first, count)
    alone = batch_of_row(study, 4)
    wood, same = whole.woods[1], alone.woods[0]
    assert np.array_equal(wood.at, same.at)
    assert np.array_equal(wood.way_m, same.way_m)
    assert not np.array_equal(wood.at, whole.woods[0].at[: len(wood.at)])


def test_studies_without_woods_draw_what_they_drew() -> None:
    """What a wood would be changes nothing without one."""
    plain, other = woods(wood="none"), woods(wood="none", trunks="5:50", gap=0.3)
    for name in ("starts", "slots", "h", "lag_s", "lag_error_s", "silent_s", "wind_from_rad"):
        assert np.array_equal(getattr(plain, name), getattr(other, name)), name
    assert not any(plain.woods)


@pytest.mark.parametrize("wood", ["trunks", "gate", "trap"])
def test_the_way_keeps_off_all_trunks(wood: str) -> None:
    """Clearance, error of the estimate, and room to fly unhindered: 1.25 + 0.5 + 0.5 m."""
    for each in woods(wood=wood).woods:
        points = np.concatenate(
            [np.linspace(a, b, 200) for a, b in zip(each.way_m, each.way_m[1:], strict=False)]
        )
        gaps = np.abs(points[:, None] - each.at[None] * 5.0) - each.radius[None] * 5.0
        assert gaps.min() > 2.2


@pytest.mark.parametrize("wood", ["trunks", "gate", "trap"])
def test_all_arrive_and_none_enters_a_trunk(wood: str) -> None:
    batch = woods(wood=wood, delay_s="0:0.2", loss="0:0.2")
    result = fly(batch)
    assert result.converged.all()
    assert result.smallest_zone.min() > 0.25
    assert result.smallest.min() > 0.5
    assert (result.over_shortest > 1.0).all()


def test_without_a_filter_a_trunk_is_entered_and_the_row_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The truth is measured, whatever the filter believes: here it sees no trunk, and the way
    leads straight through the trap."""
    monkeypatch.setattr(batch_flight, "compiled", lambda _: flight.fly)
    monkeypatch.setattr(flight, "_walls", lambda *_: 0)
    batch = woods(wood="trap", missions=1, n=2, limit_s=30.0)
    (wood,) = batch.woods
    wood.way_m[:] = np.linspace(wood.way_m[0], wood.goal * 5.0, len(wood.way_m))
    wood.ends_m[:] = np.abs(wood.way_m - wood.way_m[0])
    (row,) = rows_of(batch, fly(batch))
    assert row["entered"] == 1
    assert row["smallest_zone_units"] < 0.0


def test_interpreted_and_compiled_woods_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    batch = woods(n=3, missions=2, limit_s=12.0, delay_s="0:0.2", silent=0.5, start_spacing=1.5)
    whole = fly(batch)
    monkeypatch.setattr(batch_flight, "compiled", lambda _: flight.fly)
    held_alike(whole, fly(batch), 1e-9)


def test_a_wood_without_room_is_refused() -> None:
    with pytest.raises(InputError, match="no room for 60 trunks"):
        woods(trunks=60, trunk=1.5)


def test_the_filter_is_what_keeps_off() -> None:
    with pytest.raises(ValueError, match="wood: allowed: with safety"):
        woods(safety="off")


def test_a_row_of_a_wood_is_a_mission_with_the_same_zones(tmp_path: Any) -> None:
    """And its move goes in file where the planner says so."""
    batch, trace = woods(missions=1, trunks=25), Trace()
    flown = Rerun(batch, rows_of(batch, fly(batch, trace))[0], None, trace)
    write_mission(flown, tmp_path / "wood.yaml", lambda _: 0.0)
    plan = loads((tmp_path / "wood.yaml").read_text()).plan
    assert len(plan.zones) == 25
    assert np.allclose([z.radius_m for z in plan.zones], batch.woods[0].radius * 5.0)


def test_one_that_died_in_a_trap_s_lane_is_passed_away_from_the_hedge() -> None:
    """The hedge is on the side on which all pass in free air: 15 of these arrived when they did."""
    drawn = {"trunk": "0.1:0.5", "gap": "0.2:1.2", "delay_s": "0:0.2", "loss": "0:0.2"}
    found = fly(woods(wood="trap", missions=24, silent=1.0, limit_s=150, trunks="10:30", **drawn))
    assert int(np.count_nonzero(found.converged)) >= 20
    assert float(found.smallest_silent.min()) > 0.5
