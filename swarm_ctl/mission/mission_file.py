"""A mission file whole.

Docstrings of sections are the descriptions in the published JSON Schema. What several fields must
be together is in `checks/mission_checks.py`.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Field

from swarm_ctl.mission.input.units import in_units
from swarm_ctl.mission.sections.fleet_section import FleetSection, VehicleSection
from swarm_ctl.mission.sections.mission_sections import (
    AgentEntry,
    FenceSection,
    LawSection,
    OriginSection,
    PolicySection,
    SafetySection,
    TargetSection,
    WakeSection,
    ZoneSection,
)
from swarm_ctl.mission.sections.section import AgentId, Links, Name, Section, Timeout
from swarm_ctl.mission.sections.shape_sections import Shape
from swarm_ctl.mission.sections.simulation_section import SimulationSection
from swarm_ctl.mission.steps.table import LAST, StepEntry

_R_OUT_UNITS: Final = 1.5


class MissionFile(Section):
    """A swarm_ctl mission."""

    version: Literal[1]
    name: Name
    """A-Z, a-z, 0-9, - and _; no space. Part of the name of the run's folder."""
    origin: OriginSection
    lengths: Literal["units", "metres"] = "units"
    """Unit of all lengths without a suffix: units of `unit_m` metres, or metres."""
    unit_m: float = Field(default=5.0, ge=0.1, le=1000)
    """Metres per unit of the law. Default: 5; with `lengths: metres` law.r_out / 1.5."""
    tick_s: float = Field(default=0.05, ge=0.01, le=1)
    """The control loop's period."""
    prepare_timeout_s: Timeout = 120.0
    """How long agents wait until all vehicles are healthy and all agents are heard."""
    law: LawSection
    vehicle: VehicleSection = VehicleSection.model_construct()
    safety: SafetySection = SafetySection.model_construct()
    wake: WakeSection = WakeSection.model_construct()
    policies: PolicySection = PolicySection.model_construct()
    fence: FenceSection = FenceSection.model_construct()
    zones: dict[Name, ZoneSection] = Field(default={}, max_length=250)
    """Places that no vehicle enters, by name; or the path of a GeoJSON, KML or QGroundControl
    `.plan` file, relative to the mission file."""
    targets: dict[Name, TargetSection] = Field(default={}, max_length=20)
    """What `follow` may follow, by name."""
    neighbours: Literal["starts"] | Links = "starts"
    """starts: agents that start within `r` of each other are neighbours (the paper's rule); or a
    list of links, [id, id]."""
    agents: tuple[AgentEntry, ...] = Field(min_length=1, max_length=250)
    """At most 250, the number of sysids."""
    shapes: dict[Name, Shape] = Field(default={})
    groups: dict[Name, Annotated[tuple[AgentId, ...], Field(min_length=1)]] = Field(
        default={}, max_length=250
    )
    """The agents of each group, by its name, for `split` and for orders. An agent may be in
    several, but not in two of one split."""
    steps: tuple[StepEntry, ...] = Field(min_length=1, max_length=1000)
    fleet: FleetSection | None = None
    """The vehicles, or the path of a fleet file relative to this file. Default: all simulated."""
    simulation: SimulationSection = SimulationSection.model_construct()

    def in_units(self) -> MissionFile:
        """The same, with every length in units of its `unit_m`. A mission in metres that names
        none gets `r_out` / 1.5: the law's repulsion is tuned for radii of the paper's size."""
        if self.lengths == "units":
            return self
        given = "unit_m" in self.model_fields_set
        unit_m = self.unit_m if given else self.law.r_out / _R_OUT_UNITS
        converted: MissionFile = in_units(self, unit_m)
        return converted.model_copy(update={"unit_m": unit_m, "lengths": "units"})


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a mission file, for editors."""
    schema = MissionFile.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    fleet = schema["properties"]["fleet"]
    fleet["anyOf"].append(
        {"type": "string", "description": "path of a fleet file, relative to this file"}
    )
    zones = schema["properties"]["zones"]
    named = {"type": "string", "description": "path of a file of zones, relative to this file"}
    told = ("title", "description", "default")
    inline = {key: zones.pop(key) for key in [*zones] if key not in told}
    zones["anyOf"] = [inline, named]
    schema["properties"]["steps"]["items"] = {
        "anyOf": [schema["properties"]["steps"]["items"], {"enum": list(LAST)}]
    }
    return schema
