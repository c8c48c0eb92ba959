"""`--vehicles` and the fleet's `vehicle` say what `run` starts for each agent."""

from __future__ import annotations

import pytest

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import kinds_of, load
from tests.system.running import HEXAGON

S, A, P = VehicleKind


@pytest.mark.parametrize(
    ("given", "kinds"),
    [
        ("px4", [P, P, P]),
        ("arducopter,px4", [A, P, A]),
        ("1-2=arducopter,3=px4", [A, A, P]),
        ("1,3=px4,2=simulated", [P, S, P]),
    ],
)
def test_kinds_are_dealt_in_turn_or_named_by_agent(given: str, kinds: list[VehicleKind]) -> None:
    assert kinds_of(given, [1, 2, 3]) == dict(zip([1, 2, 3], kinds, strict=True))


@pytest.mark.parametrize(
    "given", ["copter", "arducopter,", "1-2=px5", "1,2", "x=px4", "1=px4,2", "1-3=arducopter,2=px4"]
)
def test_a_wrong_choice_is_refused_with_what_is_allowed(given: str) -> None:
    with pytest.raises(InputError, match="allowed: "):
        kinds_of(given, [1, 2, 3])


def test_the_choice_decides_autopilot_and_response() -> None:
    fleet = load(HEXAGON, vehicles="1-3=arducopter,4=px4").fleet
    assert [a.started_as for a in fleet.agents] == [A, A, A, P, S, S]
    assert [a.autopilot for a in fleet.agents[2:5]] == ["ardupilot", "px4", "ardupilot"]
    assert fleet.agent(4).response == AUTOPILOT_KINDS["px4"].response


def test_only_agents_of_the_mission_can_be_chosen() -> None:
    with pytest.raises(InputError, match="agent 9 is not in this mission"):
        load(HEXAGON, vehicles="9=px4")
