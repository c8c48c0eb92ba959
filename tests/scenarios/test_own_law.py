"""An own law behind an entry point: one function for studies and agents."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.compile.loader import load, loads
from swarm_ctl.own_laws import LawError, law_of, pinned
from swarm_ctl.study.batch.batch import draw
from swarm_ctl.study.batch.batch_flight import BatchResult, fly
from swarm_ctl.study.parameter_space import Study
from tests.scenarios.swarm import VirtualSwarm
from tests.scenarios.test_steps import FORM, TEXT, THIRD, shape_error_m

HEXAGON = Path(__file__).parents[2] / "missions" / "hexagon.yaml"
SOURCE = '''
import numpy as np
from swarm_ctl.core.law.formation_law import LawResult

SHAPES = []

def law(own, own_slot, others, other_slots, neighbour, present, lower_id, law):
    """Consensus alone, a tenth faster than the paper's."""
    SHAPES.append(own.shape)
    linked = (neighbour & present)[..., None]
    apart = (others - other_slots - (own - own_slot)[..., None, :]) * linked
    gain = 1.1 * np.asarray(law.h)[..., None] / np.maximum(linked.sum(axis=-2), 1)
    consensus = gain * apart.sum(axis=-2)
    return LawResult(consensus, consensus, np.zeros_like(consensus), None)

def broken(own, *others):
    none = np.full_like(own, np.nan)
    return LawResult(none, none, none, None)
'''


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package that offers the laws `plain` and `broken`."""
    source = tmp_path / "plain_law.py"
    source.write_text(SOURCE)
    about = tmp_path / "plain_law-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: plain-law\nVersion: 1.0\n")
    points = "plain = plain_law:law\nbroken = plain_law:broken\n"
    (about / "entry_points.txt").write_text(f"[swarm_ctl.laws]\n{points}")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield source
    sys.modules.pop("plain_law", None)


def shapes() -> list[tuple[int, ...]]:
    """With which leading axes `plain` was called."""
    found: list[tuple[int, ...]] = sys.modules["plain_law"].SHAPES
    return found


def studied(own: str) -> BatchResult:
    """Twenty missions of six with late and lost states."""
    late = {"delay_s": ("0:0.1",), "loss": ("0:0.1",), "h": ("0.2",), "missions": 20}
    study = Study.model_validate(late | {"law": LawParameters(own=own)})
    return fly(draw(study.cells()[0], 0, 20))


def test_a_study_flies_it() -> None:
    """Its missions form, apart, and are not those of the paper's law."""
    own, papers = studied(pinned("plain")), studied("")
    assert own.converged.all()
    assert (own.smallest > 0.5).all()
    assert own.statuses.sum() == 0
    assert set(shapes()) <= {(k, 6, 2) for k in range(1, 21)}
    assert not np.allclose(own.time_s, papers.time_s)


def test_agents_fly_it() -> None:
    """A square on the virtual clock, by a mission that names the law."""
    text = TEXT + "  - land\n"
    mission = loads(text.replace("law: {", "law: {own: plain, "))
    assert mission.plan.law.own == pinned("plain")
    assert mission.plan.hash() != loads(text).plan.hash()
    swarm = VirtualSwarm(mission)
    shapes().clear()
    swarm.wait(lambda s: s.in_step(THIRD))
    assert shape_error_m(swarm, FORM) < 0.6
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert set(shapes()) == {(1, 2)}


def test_a_name_that_is_not_installed_is_refused_with_its_place() -> None:
    text = HEXAGON.read_text().replace("law:", "law:\n  own: plane", 1)
    with pytest.raises(MissionError, match=r"law\.own: law 'plane' is not .*broken, plain"):
        loads(text)


def test_other_code_under_the_same_name_is_refused(installed: Path) -> None:
    """An agent whose computer has another source than the plan's does not start."""
    planned = LawParameters(own=pinned("plain"))
    assert law_of(planned)
    installed.write_text(SOURCE.replace("1.1", "1.2"))
    sys.modules.pop("plain_law")
    importlib.invalidate_caches()
    with pytest.raises(InputError, match="the same source on each computer"):
        law_of(planned)
    with pytest.raises(InputError, match="the same source"):
        VirtualSwarm(replace(load(HEXAGON), plan=replace(load(HEXAGON).plan, law=planned)))


def test_a_law_that_gives_no_numbers_ends_its_flight() -> None:
    """NaN never becomes a setpoint."""
    with pytest.raises(LawError, match="law 'broken' gave"):
        studied(pinned("broken"))
