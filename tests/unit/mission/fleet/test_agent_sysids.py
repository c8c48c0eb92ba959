"""The system ids that agents speak with: given, chosen, refused, and what `validate` says."""

from __future__ import annotations

import pytest

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import LoadedMission, loads

_HEAD = """
version: 1
name: ids
origin: {lat_deg: 47.4, lon_deg: 8.5, alt_m: 488}
lengths: metres
law: {r: 60, r_out: 7, r_in: 2.5}
agents:
"""
_STEPS = """
steps:
  - takeoff: {height_m: 6}
  - land
"""


def mission(count: int = 2, fleet: str = "") -> LoadedMission:
    agents = "".join(f"  - {{id: {k}, start: [0, {10 * k}]}}\n" for k in range(1, count + 1))
    return loads(_HEAD + agents + _STEPS + fleet)


def said(loaded: LoadedMission) -> str:
    return "\n".join(str(warning) for warning in loaded.warnings)


def test_given_ids_are_kept_and_others_avoid_them() -> None:
    fleet = "fleet: {agents: [{id: 1}, {id: 2, sysid: 249, agent_sysid: 250}, {id: 3, sysid: 248}]}"
    assert [agent.agent_sysid for agent in mission(2, fleet).fleet.agents] == [247, 250]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{id: 2, agent_sysid: 1}", "agent 2 can't speak as 1, a vehicle's sysid"),
        ("{id: 2, agent_sysid: 255}", "255 is out of range"),
        ("{id: 2, agent_sysid: 200}, {id: 3, agent_sysid: 200}", "200 is taken"),
    ],
)
def test_an_id_that_clashes_is_refused(entry: str, message: str) -> None:
    with pytest.raises(MissionError, match=message):
        mission(2, f"fleet: {{agents: [{{id: 1}}, {entry}]}}")


def test_it_is_said_when_ids_repeat() -> None:
    assert "the MAVLink system ids do not suffice" not in said(mission(2))
    assert "the MAVLink system ids do not suffice: 2 agents share theirs" in said(mission(127))
