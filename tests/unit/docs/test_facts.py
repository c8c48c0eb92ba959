"""What the pages state of the code is what the code does."""

from __future__ import annotations

import math
import re
import tomllib

import pytest
from typer.main import get_command

from swarm_ctl.cli.app import app
from swarm_ctl.core.control.navigation import DRIFT_MAX_MPS
from swarm_ctl.core.kernel import constraints, wish
from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.plan import Compensation, Plan
from swarm_ctl.core.swarm import gain_update
from swarm_ctl.mavlink.autopilots.timing import TAKEOFF_MPS
from swarm_ctl.mission.checks.envelope import ENVELOPE
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.station.picture.alarms import RULES
from tests.unit.docs import api_reference, command_reference, mission_reference, study_reference
from tests.unit.docs.pages import PAGES, ROOT, blocks

MISSION = blocks(PAGES["missions"])[0].text
OPTIONS = {
    name: {
        option
        for each in (command, *getattr(command, "commands", {}).values())
        for parameter in each.params
        for option in parameter.opts
    }
    for name, command in get_command(app).commands.items()  # type: ignore[attr-defined]
}
README = (ROOT / "README.md").read_text()
TEXT = {name: path.read_text() for name, path in PAGES.items()}


def plan(more: str = "", law: str = "") -> Plan:
    """The mission of the page, with more sections or other fields of the law."""
    return loads(MISSION.replace("r_in: 0.5", f"r_in: 0.5{law}") + more).plan


def test_the_page_of_studies_is_the_code_s() -> None:
    assert TEXT["studies"] == study_reference.page(), f"write it: {study_reference.COMMAND}"


def test_the_pages_have_every_alarm_and_cause() -> None:
    rows = re.findall(r"^\| ([a-z_ -]+) \| (error|warning) \|", TEXT["dashboard"], re.MULTILINE)
    assert rows == [(rule.name, rule.level.name.lower()) for rule in RULES]
    table = TEXT["verdict"].partition("| `cause` |")[2].partition("\n\n")[0]
    named = {word for row in table.splitlines() for word in re.findall(r"`([a-z ]+)`", row)}
    assert named == {cause.value for cause in Cause}


def test_the_mission_reference_is_the_schema_s() -> None:
    assert TEXT["reference"] == mission_reference.page(), f"write it: {mission_reference.COMMAND}"


def test_what_goes_beyond_the_limits_is_on_the_page_of_missions() -> None:
    assert f"up to {DRIFT_MAX_MPS:g} m/s more than this" in TEXT["reference"]
    assert f"a PX4 is told {TAKEOFF_MPS:g} m/s at most" in TEXT["reference"]


def test_the_default_gains_are_those_of_the_law_s_page() -> None:
    page = TEXT["law"]
    assert "`kappa * h` is 4 a second for a usual mission" in page
    assert "`h = 1 / kappa` on stop points without them" in page
    assert plan().kappa == pytest.approx(1 / plan().tick_s)
    assert plan().kappa * plan().law.h == pytest.approx(4)
    unsafe = plan("safety: {filter: false, guard: false, release: false}\n")
    assert unsafe.kappa * unsafe.law.h == pytest.approx(1)
    plain = plan(law=", compensation: none")
    assert plain.compensation is Compensation.NONE
    assert plain.law.h == 0.005


def test_the_limits_of_tune_are_those_of_the_page() -> None:
    (sentence,) = re.findall(r"In flight `delta_a` may be up to .*", TEXT["in-flight"])
    numbers = [
        float(number) for number in re.findall(r"(?<![\w.])\d[\d.]*\d|(?<![\w.])\d", sentence)
    ]
    assert numbers == [
        gain_update.DELTA_A_AT_MOST,
        gain_update.DELTA_L_AT_MOST,
        gain_update.H_SAFE_AT_MOST,
        gain_update.H_AT_MOST,
        gain_update.SAFE_RATE_AT_MOST,
        gain_update.RATE_AT_MOST,
        gain_update.PLAIN_RATE_AT_MOST,
    ]


def test_the_envelope_is_that_of_the_safety_page() -> None:
    for each in ENVELOPE:
        row = f"| `{'.'.join(each.place)}` | {each.name} | {each.studied} | {each.accepted} |"
        assert row.replace("  |", " |") in TEXT["safety-evidence"], row


def test_the_constants_of_the_filter_are_those_of_the_safety_page() -> None:
    page, c = TEXT["safety-evidence"], constraints
    assert f"min({c._ESCAPE:g} v_max, -{c.RATE:g} * share * (x - D_j))" in page
    guard = f"-{0.5 * c._GUARD_RATE:g} ({c._GUARD_AT:g} r - x)"
    assert f"min({c._GUARD_PULL:g} v_max, {guard}" in page
    assert f"`r_in + {c._KEEP_OUT:g} (r_out - r_in)`" in page
    assert f"{c._SPARE - 1:.0%} above `r_in`".replace("%", " %") in page
    assert f"a lag {c._LAG_ERROR - 1:.0%} longer".replace("%", " %") in page
    assert f"`{c.RATE:g} A <= 1/e`, which is {1 / (math.e * c.RATE):.2f} s" in page
    assert f"at {wish.ALIGN_RATE:g} a second towards the mean error" in TEXT["law"]


def test_each_mission_is_in_the_list() -> None:
    listed = re.findall(
        r"^\| `(\w+\.yaml)`", (ROOT / "missions" / "README.md").read_text(), re.MULTILINE
    )
    assert sorted(listed) == sorted(path.name for path in (ROOT / "missions").glob("*.yaml"))


def test_the_pages_of_commands_and_calls_are_the_code_s() -> None:
    assert TEXT["commands"] == command_reference.page(), f"write it: {command_reference.COMMAND}"
    assert TEXT["python-calls"] == api_reference.page(), f"write it: {api_reference.COMMAND}"


def test_each_install_by_role_is_in_the_list() -> None:
    """And the README's first command installs what `run` needs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    listed = set(re.findall(r"^\| `pip install .*'\.\[(\w+)\]'`", TEXT["install"], re.MULTILINE))
    assert listed == set(project["optional-dependencies"])
    assert "pip install -q '.[ground]' && .venv/bin/swarm-ctl run" in README


def test_the_layers_are_those_of_the_import_rule() -> None:
    """In docs/understand/architecture.md."""
    linter = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    contracts = [c["layers"] for c in linter["contracts"] if c["type"] == "layers"]
    (layers,) = [names for names in contracts if "swarm_ctl.core" in names]
    rule = " -> ".join(layers).replace("swarm_ctl.", "")
    (page,) = [b.text for b in blocks(PAGES["architecture"]) if "testing ->" in b.text]
    assert " ".join(page.split()) == rule


def test_each_option_in_a_command_exists() -> None:
    """`swarm-ctl COMMAND --option` of every page and of the README."""
    texts = [*TEXT.values(), README, (ROOT / "sim" / "README.md").read_text()]
    for text in texts:
        for name, rest in re.findall(r"swarm-ctl (\w+)([^`\n]*(?:\\\n[^`\n]*)*)", text):
            if name in OPTIONS:
                used = set(re.findall(r"(?<!\w)--[a-z][a-z0-9-]*", rest))
                assert used - OPTIONS[name] <= {"--help"}, (name, rest)
