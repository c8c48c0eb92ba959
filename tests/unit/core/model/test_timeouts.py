"""The table of timings says what the code does."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import swarm_ctl
from swarm_ctl.core.model import timeouts
from swarm_ctl.core.model.plan import Policies

PACKAGE = Path(swarm_ctl.__file__).parent
NAMED = sorted(
    set(
        re.findall(
            r"`((?:\w+\.)?\w*_(?:s|S)|\w+\._GROWTH|\w+\.DRIFT)` ([\d.]+)", timeouts.__doc__ or ""
        )
    )
)


def value(name: str) -> Any:
    """Of a constant of `timeouts`, of another module (`module.CONSTANT`), or of a policy."""
    where, _, what = name.rpartition(".")
    if where == "policies":
        return getattr(Policies(), what)
    if not where:
        return getattr(timeouts, what)
    (file,) = PACKAGE.rglob(f"{where}.py")
    return getattr(
        import_module(".".join(("swarm_ctl", *file.relative_to(PACKAGE).with_suffix("").parts))),
        what,
    )


@pytest.mark.parametrize(("name", "told"), NAMED)
def test_each_number_is_the_code_s(name: str, told: str) -> None:
    assert value(name) == float(told)


def test_nothing_of_the_module_is_missing_in_its_table() -> None:
    assert len(NAMED) > 20
    constants = [name for name in vars(timeouts) if name.endswith("_S")]
    assert [name for name in constants if f"`{name}`" not in (timeouts.__doc__ or "")] == []
    timeout = timeouts.SETPOINT_TIMEOUT_S
    words = f"`SETPOINT_TIMEOUT_S`: {timeout['ardupilot']} (ArduCopter), {timeout['px4']} (PX4)"
    assert words in (timeouts.__doc__ or "")
