"""`run.json` and the plan as JSON: what was written is read again, and nothing else is."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarm_ctl.core.model.plan import FormStep, HoldStep, LandStep, Plan, TakeoffStep
from swarm_ctl.errors import InputError
from swarm_ctl.report.folder.manifest import (
    Manifest,
    fingerprint,
    plan_from_json,
    plan_to_json,
    read_manifest,
    write_manifest,
)
from tests.unit.report.run_folders import PLAN, SYSIDS, manifest

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


@given(st.lists(steps, max_size=5).map(tuple), numbers, st.text())
def test_a_plan_comes_back_as_it_was(chosen: tuple[Any, ...], unit_m: float, name: str) -> None:
    plan = replace(PLAN, steps=chosen, unit_m=unit_m, name=name)
    again = plan_from_json(plan_to_json(plan))
    assert again == plan
    assert again.hash() == plan.hash()
    assert [type(step) for step in again.steps] == [type(step) for step in chosen]


def test_a_plan_built_with_whole_numbers_has_the_same_hash() -> None:
    plan = replace(PLAN, steps=(LandStep(90),), unit_m=5)
    assert plan_from_json(plan_to_json(plan)).hash() == plan.hash()


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
    places = _places(json.loads(plan_to_json(PLAN)))
    assert len(places) == 2 + 6 + len(PLAN.agents) + len(
        PLAN.steps
    )  # document, plan, its sections, agents, steps
    for place in places:
        data = json.loads(plan_to_json(PLAN))
        inner = data
        for key in place:
            inner = inner[key]
        inner["surplus"] = 1
        text = json.dumps(data)
        with pytest.raises(InputError):
            plan_from_json(text)


@pytest.mark.parametrize("field", [field.name for field in fields(Plan)])
def test_a_missing_or_mistyped_field_is_refused(field: str) -> None:
    whole = json.loads(plan_to_json(PLAN))
    for change in (
        {"plan": {k: v for k, v in whole["plan"].items() if k != field}},
        {"plan": whole["plan"] | {field: []}},
    ):
        if field in ("agents", "steps") and change["plan"].get(field) == []:
            continue
        text = json.dumps(change)
        with pytest.raises(InputError, match=field):
            plan_from_json(text)


@pytest.mark.parametrize("text", ["", "{", "null", "[]", '{"plan": 3}'])
def test_what_is_no_plan_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="plan"):
        plan_from_json(text)


def test_the_manifest_comes_back_as_it_was(tmp_path: Path) -> None:
    write_manifest(tmp_path, manifest())
    assert read_manifest(tmp_path) == manifest()
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
    assert manifest().agent_of_sysid == dict(zip(SYSIDS, range(1, 7), strict=True))


def test_the_manifests_hash_is_the_plans(tmp_path: Path) -> None:
    assert int(manifest().plan_hash, 16) == PLAN.hash()
    with pytest.raises(ValidationError, match="plan_hash"):
        manifest(plan_hash="0" * 16)
    write_manifest(tmp_path, manifest())
    path = tmp_path / "run.json"
    path.write_text(path.read_text().replace('"tolerance_m": 0.5', '"tolerance_m": 0.6'))
    with pytest.raises(InputError, match=r"run\.json.*plan_hash"):
        read_manifest(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda fleet: fleet[:-1], "different agents"),
        (lambda fleet: (*fleet[:-1], replace(fleet[-1], sysid=11)), "sysid 11 more than once"),
        (lambda fleet: (*fleet[:-1], replace(fleet[-1], id=1)), "agent id 1 more than once"),
    ],
)
def test_fleet_and_plan_must_fit(change: Any, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        manifest(fleet=change(manifest().fleet))


@pytest.mark.parametrize(
    "change", [{"speedup": 0.0}, {"started_at": "yesterday"}, {"surplus": 1}, {"schema_version": 2}]
)
def test_a_mistaken_manifest_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=next(iter(change))):
        manifest(**change)


def test_the_manifest_is_refused_at_every_torn_length(tmp_path: Path) -> None:
    write_manifest(tmp_path, manifest())
    path = tmp_path / "run.json"
    whole = path.read_bytes()
    for length in range(0, len(whole) - 2, 7):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"run\.json"):
            read_manifest(tmp_path)


def test_a_missing_manifest_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.json: No such file"):
        read_manifest(tmp_path)


def test_the_fingerprint_keeps_all_64_bits() -> None:
    assert len(fingerprint(PLAN)) == 16
    assert is_dataclass(manifest().plan)
    assert isinstance(manifest(), Manifest)
