"""Studies fly the same whether their functions are compiled or not, and what was compiled of other
sources is never flown."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from swarm_ctl.study.batch import batch_flight, compiled, flight
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import Study
from tests.unit.study.flown import held_alike

LATE: dict[str, Any] = {
    "missions": 3,
    "seed": 4,
    "limit_s": 6.0,
    "loss": "0:0.2",
    "silent": 0.5,
    "lag_s": "0.3:0.6",
}


def missions(**settings: Any) -> Batch:
    """The one block of a small study."""
    ((cell, first, count),) = blocks(Study.model_validate(LATE | settings))
    return draw(cell, first, count)


@pytest.mark.parametrize(
    "settings",
    [
        {"n": 4, "safety": "align", "start": "crossing", "slots": "given", "delay_s": "0:0.2"},
        {"n": 5, "safety": "exchange", "slots": "random", "jitter_s": 0.2, "burst_s": 0.3},
        {"n": 18, "safety": "align", "slots": "random", "area": 12.0, "limit_s": 1.5},
        {"n": 3, "safety": "off", "vehicle": "ideal", "slots": "random", "lag_s": 0.55},
    ],
)
def test_interpreted_and_compiled_missions_are_the_same(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To 1e-9: a compiler rounds otherwise in the last digit."""
    pytest.importorskip("numba")
    batch = missions(**settings)
    whole = fly(batch)
    monkeypatch.setattr(batch_flight, "compiled", lambda _: flight.fly)
    held_alike(whole, fly(batch), 1e-9)


def test_all_that_compiled_functions_take_from_elsewhere_is_in_the_key_of_the_cache() -> None:
    """A constant or a type of another module is compiled in: where that module changes, all is
    compiled anew."""
    names = {module.__name__ for module in compiled.SOURCES}
    for module in compiled._MODULES:
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("swarm_ctl."):
                assert node.module in names, f"{module.__name__} takes names from {node.module}"


def test_a_changed_source_has_a_cache_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where only a constant of a module changes whose functions are never compiled."""
    pytest.importorskip("numba")
    folder, read = compiled.cache_folder.__wrapped__, inspect.getsource
    before = folder()

    def changed(module: ModuleType) -> str:
        return read(module).replace("FRESH_S: Final = 0.5", "FRESH_S: Final = 0.6")

    monkeypatch.setattr(inspect, "getsource", changed)
    assert folder() != before


def test_a_cache_that_cannot_be_written_costs_time_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    (tmp_path / "file").write_text("in the way")
    assert not compiled._writable(compiled.cache_folder.__wrapped__())
