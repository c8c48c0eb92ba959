"""The `.tlog` of a link: pymavlink's own reader finds every frame with its time."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from swarm_ctl.core.model.vehicle import FlyGoal
from swarm_ctl.mavlink import tlog as tlog_module
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.tlog import TlogWriter
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire

STARTED_US = 1_800_000_000_000_000


def read(path: Path) -> list[tuple[str, float]]:
    """(type, mission time) of every message that pymavlink's log reader finds."""
    log = mavutil.mavlogfile(str(path))
    found = []
    while (message := log.recv_match()) is not None:
        found.append((message.get_type(), message._timestamp - STARTED_US * 1e-6))
    log.close()
    return found


def test_both_directions_with_their_times(tmp_path: Path) -> None:
    """What the vehicle said and what it was told, in order, with the mission's time."""
    path = tmp_path / "1.tlog"
    ours, theirs = memory_wires()
    writer = TlogWriter(path, STARTED_US)
    vehicle = wire.Vehicle(theirs, sysid=1)
    link = VehicleLink(ours, "ardupilot", 1, writer.take)
    vehicle.say(wire.heartbeat(custom_mode=4, armed=True))
    link.receive(1.0)
    vehicle.say(wire.local_position(boot_ms=2000))
    link.receive(2.0)
    link.pursue(FlyGoal(velocity_ned_mps=(1.0, 0.0, 0.0)), 2.5)
    sent = link.counters.setpoints
    link.close()
    writer.close()
    found = read(path)
    assert found[:2] == [
        ("HEARTBEAT", pytest.approx(1.0)),
        ("LOCAL_POSITION_NED", pytest.approx(2.0)),
    ]
    setpoints = [time for name, time in found if name == "SET_POSITION_TARGET_LOCAL_NED"]
    assert sent == 1
    assert setpoints == [pytest.approx(2.5)]


def test_a_stuck_disk_does_not_stop_the_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`take` returns while the thread hangs in a write; the oldest frames are given up and
    counted."""
    monkeypatch.setattr(tlog_module, "_LIMIT", 10)
    monkeypatch.setattr(tlog_module, "_TURN_WALL_S", 0.0)
    gate, inside = threading.Event(), threading.Event()
    writer = TlogWriter(tmp_path / "1.tlog", STARTED_US)
    file = writer._file

    class Stuck:
        def write(self, data: Any) -> int:
            inside.set()
            gate.wait()
            return file.write(data)

        def close(self) -> None:
            file.close()

    writer._file = Stuck()  # type: ignore[assignment]
    frame = common.MAVLink(None).heartbeat_encode(6, 8, 0, 0, 4).pack(common.MAVLink(None))
    writer.take(frame, 0.0)
    assert inside.wait(5)
    for k in range(1, 31):
        writer.take(frame, float(k))
    gate.set()
    writer.close()
    assert writer.dropped == 20
    assert [round(time) for _, time in read(tmp_path / "1.tlog")] == [0, *range(21, 31)]
