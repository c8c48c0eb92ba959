"""What `validate` says of the vehicles."""

import pytest

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, VehicleKind
from swarm_ctl.report.page.mission_table import pilots

ENDPOINT = "tcp:10.0.0.1:5760"


JOYSTICK, STICKS = "joystick does nothing", "COM_RC_OVERRIDE has bit 1"


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (FleetAgent(1, 1, "ardupilot", ENDPOINT), JOYSTICK),
        (FleetAgent(1, 1, "ardupilot", vehicle=VehicleKind.ARDUCOPTER), JOYSTICK),
        (FleetAgent(1, 1, "ardupilot"), ""),
        (FleetAgent(1, 1, "px4", ENDPOINT), STICKS),
        (FleetAgent(1, 1, "px4"), ""),
    ],
    ids=["an endpoint", "started by run", "simulated", "PX4", "simulated PX4"],
)
def test_it_is_said_what_a_real_autopilot_leaves_to_pilots(entry: FleetAgent, said: str) -> None:
    lines = list(pilots(Fleet((entry,))))
    assert [(said in line, "agent 1:" in line) for line in lines] == (
        [(True, True)] if said else []
    )
