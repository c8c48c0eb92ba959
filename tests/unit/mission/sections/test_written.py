"""Sections that are made of the plan's types."""

from __future__ import annotations

import inspect

import pytest

from swarm_ctl.core.model.plan import Limits, Policies
from swarm_ctl.mission.sections import section
from swarm_ctl.mission.sections.fleet_section import VehicleLimits
from swarm_ctl.mission.sections.mission_sections import PolicySection, SafetySection


def test_a_section_has_the_fields_of_its_type_and_says_what_was_given() -> None:
    """A value that the file gives goes before one that is derived."""
    assert list(PolicySection.model_fields) == [*Policies.__dataclass_fields__]
    section = PolicySection.model_validate({"wind_limit_mps": 12.0, "agent_lost": "hold"})
    assert section.model_fields_set == {"wind_limit_mps", "agent_lost"}
    assert section.at_speed(4.0).max_speed_mps == 8.0
    given = PolicySection.model_validate({"max_speed_mps": 3.0})
    assert given.at_speed(4.0) == Policies(max_speed_mps=3.0, return_speed_mps=2.0)
    assert VehicleLimits().planned() == Limits()


def test_no_default_stands_in_for_what_was_not_derived() -> None:
    """Twice another mission's speed would be a limit, too."""
    with pytest.raises(KeyError, match="max_speed_mps"):
        PolicySection().planned(return_speed_mps=1.0)
    assert not SafetySection().planned(**dict.fromkeys(SafetySection.model_fields, False)).filter


def test_without_sources_a_section_lacks_descriptions_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(_: object) -> str:
        raise OSError("could not get source code")

    whole = VehicleLimits.model_json_schema()["properties"]
    monkeypatch.setattr(inspect, "getsource", missing)
    section._classes.cache_clear()
    bare = VehicleLimits.model_json_schema()["properties"]
    section._classes.cache_clear()
    told = [field.pop("description", "") for field in whole.values()]
    assert list(map(bool, told)) == [True, True, False]
    assert bare == whole
