"""The table of timings says what the code does."""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any

import pytest

from swarm_ctl.core import freshness
from swarm_ctl.core.plan import Policies

ELSEWHERE = {
    "messages": "swarm_ctl.mavlink.messages",
    "timing": "swarm_ctl.mavlink.autopilots.timing",
    "fleet": "swarm_ctl.runtime.fleet",
    "zenoh_transport": "swarm_ctl.mesh.zenoh_transport",
}
NAMED = sorted(set(re.findall(r"`((?:\w+\.)?\w*_(?:s|S)|\w+\._GROWTH|\w+\.DRIFT)` ([\d.]+)", freshness.__doc__ or "")))


def value(name: str) -> Any:
    """Of a constant of `freshness`, of `module.CONSTANT` of the core or as above, or of a policy."""
    where, _, what = name.rpartition(".")
    if where == "policies":
        return getattr(Policies(), what)
    return getattr(import_module(ELSEWHERE.get(where, f"swarm_ctl.core.{where}")) if where else freshness, what)


@pytest.mark.parametrize(("name", "told"), NAMED)
def test_each_number_is_the_code_s(name: str, told: str) -> None:
    assert value(name) == float(told)


def test_nothing_of_the_module_is_missing_in_its_table() -> None:
    assert len(NAMED) > 20
    constants = [name for name in vars(freshness) if name.endswith("_S")]
    assert [name for name in constants if f"`{name}`" not in (freshness.__doc__ or "")] == []
    timeout = freshness.SETPOINT_TIMEOUT_S
    words = f"`SETPOINT_TIMEOUT_S`: {timeout['ardupilot']} (ArduCopter), {timeout['px4']} (PX4)"
    assert words in (freshness.__doc__ or "")
