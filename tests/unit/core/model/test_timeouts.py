"""The pages of time-outs and of the safety's evidence have the numbers of the code."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import swarm_ctl
from swarm_ctl.core.model import timeouts
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import Policies
from swarm_ctl.mavlink.telemetry.estimate import EKF_RULES, ESTIMATOR_RULES
from tests.unit.docs.pages import PAGES

PACKAGE = Path(swarm_ctl.__file__).parent
TABLE = PAGES["timeouts"].read_text()
SAFETY = PAGES["safety-evidence"].read_text()
NUMBERS = sorted(
    set(re.findall(r"`((?:\w+\.)*[A-Za-z_]+)` (\d+(?:\.\d+)?)", TABLE))
    | set(re.findall(r"`(\w+\.\w+)` (\d+(?:\.\d+)?)", SAFETY))
)


def value(name: str) -> Any:
    """A constant of `timeouts`, of another module (`module.CONSTANT`, with its
    package where two modules have that name), or a policy."""
    where, _, what = name.rpartition(".")
    if where == "policies":
        return getattr(Policies(), what)
    if not where:
        return getattr(timeouts, what)
    (file,) = PACKAGE.rglob(f"{where.replace('.', '/')}.py")
    module = (PACKAGE.name, *file.relative_to(PACKAGE).with_suffix("").parts)
    return getattr(import_module(".".join(module)), what)


@pytest.mark.parametrize(("name", "number"), NUMBERS)
def test_each_number_is_the_number_in_the_code(name: str, number: str) -> None:
    assert value(name) == float(number)


def test_the_ratios_of_the_safety_page_are_those_of_the_code() -> None:
    assert f"ArduCopter {EKF_RULES.most_ratio:g}, PX4 {ESTIMATOR_RULES.most_ratio:g} |" in SAFETY


def test_no_constant_of_the_module_is_missing_in_the_table() -> None:
    assert len(NUMBERS) > 20
    assert ("policies.position_accuracy_flight_m", "2.0") in NUMBERS
    constants = [name for name in vars(timeouts) if name.isupper()]
    assert [name for name in constants if f"`{name}`" not in TABLE] == []
    ardupilot, px4 = (AUTOPILOT_KINDS[name].setpoint_timeout_s for name in ("ardupilot", "px4"))
    assert f"`setpoint_timeout_s`: {ardupilot} (ArduCopter), {px4} (PX4)" in TABLE
    longest_s = max(kind.setpoint_timeout_s for kind in AUTOPILOT_KINDS.values())
    assert longest_s == timeouts.SILENT_FLIES_S
