"""What a shared radio carries: the sizes are MAVLink's own, and the documented figures hold."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.fleet import RadioShare
from swarm_ctl.core.swarm.radio import MOST_HZ, PAYLOADS, POSITION, STREAMS_HZ, budget

MESSAGES = {kind.msgname: kind for kind in dialect.mavlink_map.values()}


def test_payloads_are_at_most_those_of_mavlink() -> None:
    """SYS_STATUS has extensions that no firmware fills."""
    assert PAYLOADS.keys() == STREAMS_HZ.keys()
    for name, size in PAYLOADS.items():
        whole = MESSAGES[name].unpacker.size
        assert size == (31 if name == "SYS_STATUS" else whole), name


@pytest.mark.parametrize(
    ("baud", "vehicles", "autopilot", "signed", "hz", "carried"),
    [
        (57600, 3, "ardupilot", False, 10, True),
        (57600, 3, "px4", False, 9, True),
        (57600, 3, "ardupilot", True, 6, True),
        (57600, 6, "ardupilot", False, 3, False),
        (115200, 6, "ardupilot", False, 10, True),
        (921600, 2, "ardupilot", False, MOST_HZ, True),
    ],
)
def test_setpoints_a_second(
    baud: int, vehicles: int, autopilot: str, signed: bool, hz: float, carried: bool
) -> None:
    share = RadioShare("serial:/dev/x", baud // 10, vehicles)
    found = budget(share, autopilot, signed=signed)
    assert (found.hz, found.carried) == (hz, carried)
    assert found.streams_hz[POSITION] == hz
    assert (found.needed_bytes_per_s <= share.bytes_per_s) is carried
