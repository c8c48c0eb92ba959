"""The plan as a file: what was written is read again with the same hash, and nothing else is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from annotated_types import Ge, Le
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarm_ctl.core.model.fleet import Fleet, FleetAgent
from swarm_ctl.core.model.plan import GroupPlan, Plan
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.mission.compile.plan_file import (
    is_plan_file,
    plan_from_json,
    plan_to_json,
    read_plan,
)
from swarm_ctl.runfolder.manifest import Manifest
from tests.unit.mission.example import edited
from tests.unit.plans import steps_of, with_group
from tests.unit.report.run_folders import PLAN, manifest

FLEET = Fleet(tuple(FleetAgent(agent.id, agent.id, "px4") for agent in PLAN.agents))

numbers = st.floats(-1e6, 1e6, allow_nan=False)
points = st.tuples(numbers, numbers)
steps = st.one_of(
    st.builds(TakeoffStep, numbers, numbers),
    st.builds(
        FormStep, st.text(), st.lists(points, max_size=3).map(tuple), numbers, numbers, numbers
    ),
    st.builds(HoldStep, numbers, numbers),
    st.builds(LandStep, numbers),
)


def again(plan: Plan) -> Plan:
    return plan_from_json(plan_to_json(plan, FLEET)).plan


@given(st.lists(steps, max_size=5).map(tuple), numbers, st.text())
def test_a_plan_comes_back_as_it_was(chosen: tuple[Any, ...], unit_m: float, name: str) -> None:
    plan = replace(with_group(PLAN, steps=chosen), unit_m=unit_m, name=name)
    assert again(plan) == plan
    assert again(plan).hash() == plan.hash()
    assert [type(step) for step in steps_of(again(plan))] == [type(step) for step in chosen]


@pytest.mark.parametrize("speed_mps", [0.1, 0.15, 0.2, 0.25, 0.3, 5, 8])
def test_what_a_mission_derives_is_within_the_bounds_of_its_plan(speed_mps: float) -> None:
    """A mission that is accepted gives a plan file that is. Twice 0.1 m/s is no speed limit."""
    slow = f"vehicle: {{limits: {{speed_mps: {speed_mps}}}}}\n"
    loaded = loads(edited(("law:\n", f"{slow}law:\n")))
    plan = plan_from_json(plan_to_json(loaded.plan, loaded.fleet)).plan
    assert plan == loaded.plan
    assert plan.policies.max_speed_mps == max(0.5, 2 * speed_mps)
    assert plan.policies.return_speed_mps == max(0.1, speed_mps / 2)


def _places(value: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Where the plan's JSON has mappings."""
    if isinstance(value, dict):
        return [
            path,
            *(place for key, inner in value.items() for place in _places(inner, (*path, key))),
        ]
    if isinstance(value, list):
        return [place for k, inner in enumerate(value) for place in _places(inner, (*path, k))]
    return []


def test_an_unknown_field_is_refused_wherever_it_stands() -> None:
    text = plan_to_json(PLAN, FLEET)
    places = _places(json.loads(text))
    agents = len(PLAN.agents)
    # document, plan, its sections, its group, agents, lists, and the fleet's entries with responses
    lists = len(PLAN.shapes) + len(steps_of(PLAN))
    assert len(places) == 2 + 6 + 1 + agents + lists + 2 * agents
    for place in places:
        data = json.loads(text)
        inner = data
        for key in place:
            inner = inner[key]
        inner["surplus"] = 1
        with pytest.raises(InputError, match=r"surplus: unknown field; allowed: "):
            plan_from_json(json.dumps(data))


@pytest.mark.parametrize(
    "field", [field.name for field in fields(Plan) if field.default is MISSING]
)
def test_a_missing_or_mistyped_field_is_refused(field: str) -> None:
    whole = json.loads(plan_to_json(PLAN, FLEET))
    missing = {k: v for k, v in whole["plan"].items() if k != field}
    with pytest.raises(InputError, match=rf"^plan: plan\.{field}: is missing; allowed: "):
        plan_from_json(json.dumps(whole | {"plan": missing}))
    with pytest.raises(InputError, match=field):
        plan_from_json(json.dumps(whole | {"plan": whole["plan"] | {field: True}}))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"schema_version": 1, "plan": {}},
            "1 is of another version of swarm-ctl; allowed: 3, in a file that `swarm-ctl plan`",
        ),
        ({"plan_hash": "0" * 16}, "plan: plan_hash is 0000000000000000, the plan's is "),
        ({"fleet": []}, "allowed: one entry in the fleet for each of 1, 2, 3, 4, 5, 6"),
        ({"plan_hash": 7}, "plan: plan_hash: 7 is a number; allowed: text"),
    ],
)
def test_what_is_wrong_is_told_with_what_would_be_allowed(
    change: dict[str, Any], told: str
) -> None:
    data = json.loads(plan_to_json(PLAN, FLEET)) | change
    with pytest.raises(InputError) as caught:
        plan_from_json(json.dumps(data))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("groups", "told"),
    [
        ((), "plan: no agents in a group; allowed: groups of one and more"),
        ((replace(PLAN.groups[0], agents=()),), "plan: no agents in a group; allowed: groups of"),
        ((PLAN.groups[0], replace(PLAN.groups[0], name="b")), "plan: agent id 1, 2, 3, 4, 5, 6 mo"),
        ((PLAN.groups[0], replace(PLAN.groups[0], agents=())), "plan: group all after step 0 m"),
    ],
)
def test_each_agent_is_in_one_group(groups: tuple[GroupPlan, ...], told: str) -> None:
    """What asks for an agent's group finds one, and two groups are never taken for one."""
    plan = replace(PLAN, groups=groups)
    fleet = tuple(agent for agent in FLEET.agents if groups and groups[0].agents)
    with pytest.raises(ValidationError) as caught:  # the writer checks as the reader does
        plan_to_json(plan, replace(FLEET, agents=fleet))
    assert told in str(caught.value)


def _bounded() -> Iterator[tuple[str, str, float]]:
    """Section and field of the plan, and a number that its bounds do not allow."""
    for section in ("origin", "response", "limits", "policies"):
        kind = type(getattr(PLAN, section))
        for field, hint in get_type_hints(kind, include_extras=True).items():
            for bound in getattr(hint, "__metadata__", ()):
                if isinstance(bound, Ge):
                    yield section, field, float(bound.ge) - 0.5
                elif isinstance(bound, Le):
                    yield section, field, float(bound.le) + 0.5


@pytest.mark.parametrize(("section", "field", "value"), list(_bounded()))
def test_a_value_out_of_bounds_does_not_fly(section: str, field: str, value: float) -> None:
    """Also in a plan that was edited, and its hash made anew; in a run's manifest, too."""
    wrong = replace(PLAN, **{section: replace(getattr(PLAN, section), **{field: value})})
    what = rf"plan\.{section}\.{field}: {value} is out of range; allowed: a number from "
    with pytest.raises(InputError, match=what):
        plan_from_json(plan_to_json(wrong, FLEET))
    with pytest.raises(ValidationError, match=rf"plan\.{section}\.{field}\n"):
        Manifest.model_validate_json(
            manifest(wrong, plan_hash=wrong.fingerprint()).model_dump_json()
        )


def test_a_plan_that_was_edited_does_not_fly() -> None:
    """A gain of the law, after the mission's checks: the hash tells."""
    text = plan_to_json(PLAN, FLEET).replace('"tolerance_m": 0.5', '"tolerance_m": 5')
    with pytest.raises(InputError, match="it was changed after it was checked"):
        plan_from_json(text)


@pytest.mark.parametrize(
    ("was", "changed"),
    [
        ('"sysid": 1,', '"sysid": 101,'),
        ('"agent_sysid": 250', '"agent_sysid": 251'),
        ('"autopilot": "px4"', '"autopilot": "ardupilot"'),
        ('"endpoint": null', '"endpoint": "udpout:10.9.9.9:14550"'),
        ('"mesh": null', '"mesh": "tcp/10.9.9.9:7447"'),
        ('"signing": "off"', '"signing": "required"'),
    ],
)
def test_a_fleet_that_was_edited_does_not_fly(was: str, changed: str) -> None:
    """An agent speaks to the endpoints of its file, with its system ids: the hash is of them,
    too. It was of the plan alone."""
    text = plan_to_json(PLAN, FLEET)
    assert was in text
    with pytest.raises(InputError, match=r"whole_hash is .*, that of plan, fleet and signing is "):
        plan_from_json(text.replace(was, changed, 1))


def test_the_folder_of_keys_is_each_computers_own() -> None:
    text = plan_to_json(PLAN, FLEET).replace('"trust": null', '"trust": "trust/mine"')
    assert plan_from_json(text).trust == "trust/mine"


@pytest.mark.parametrize("text", ["", "{", "null", "[]", '{"plan": 3}'])
def test_what_is_no_plan_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^plan: "):
        plan_from_json(text)


def test_a_torn_file_is_refused_at_every_length(tmp_path: Path) -> None:
    """As what it is: a plan file that is not whole."""
    path, whole = tmp_path / "plan.json", plan_to_json(PLAN, FLEET)
    for length in range(25, len(whole) - 2, 97):
        path.write_text(whole[:length])
        assert is_plan_file(path)
        with pytest.raises(InputError, match=r"plan\.json: not JSON: .*allowed: a whole plan file"):
            read_plan(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.json: can't be read: No such file"):
        read_plan(tmp_path / "no.json")
