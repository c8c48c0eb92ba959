"""What `validate` says of the vehicles."""

import pytest

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, VehicleKind
from swarm_ctl.report.page.mission_table import joysticks

ENDPOINT = "tcp:10.0.0.1:5760"


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (FleetAgent(1, 1, "ardupilot", ENDPOINT), True),
        (FleetAgent(1, 1, "ardupilot", vehicle=VehicleKind.ARDUCOPTER), True),
        (FleetAgent(1, 1, "ardupilot"), False),
        (FleetAgent(1, 1, "px4", ENDPOINT), False),
    ],
    ids=["an endpoint", "started by run", "simulated", "PX4"],
)
def test_it_is_said_what_a_real_arducopter_denies_a_ground_station(
    entry: FleetAgent, said: bool
) -> None:
    lines = list(joysticks(Fleet((entry,))))
    assert [("joystick does nothing" in line, "agent 1" in line) for line in lines] == (
        [(True, True)] if said else []
    )
