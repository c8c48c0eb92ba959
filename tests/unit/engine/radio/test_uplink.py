"""What goes first over a radio that several vehicles share, and what is thinned."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_ctl.engine.radio.switch import MOST_WAITING, SETPOINT_KEPT_S, Lane, Uplink
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame

TICK_S = 0.05
SETPOINT, HEARTBEAT, COMMAND = 84, 0, 76


def frame(message: Any, system: int = 250, *, signed: bool = False) -> MavlinkFrame:
    codec = outgoing.dialect.MAVLink(None, system, outgoing.AGENT_COMPONENT)
    if signed:
        codec.signing.secret_key = bytes(32)
        codec.signing.sign_outgoing = True
    return Framer().feed(message.pack(codec))[0]


def setpoint(north: float, **more: Any) -> MavlinkFrame:
    return frame(outgoing.velocity(1, (north, 0.0, 0.0), 0.0), **more)


def request(number: int, **more: Any) -> MavlinkFrame:
    return frame(outgoing.request(1, number), **more)


def mode(number: float = 9.0, **more: Any) -> MavlinkFrame:
    return frame(outgoing.command(1, outgoing.SET_MODE, 1.0, number), **more)


def test_an_old_setpoint_is_not_sent_so_a_dead_agents_vehicle_stops() -> None:
    lane = Lane(10.0)
    lane.put(setpoint(1.0), 0.0)
    assert lane.rank(SETPOINT_KEPT_S + 0.01) is None
    assert lane.thinned == 1


def test_a_command_goes_before_setpoints_and_these_before_heartbeats_and_requests() -> None:
    lane = Lane(10.0)
    for each in (request(1), frame(outgoing.heartbeat()), setpoint(1.0), mode()):
        lane.put(each, 0.0)
    order = [lane.take(0.0).message_id for _ in range(4)]
    assert order == [COMMAND, SETPOINT, HEARTBEAT, COMMAND]


def test_a_request_that_is_repeated_waits_once_and_keeps_its_place() -> None:
    lane = Lane(10.0)
    for number in (1, 2, 1):
        lane.put(request(number), 0.0)
    assert [lane.take(0.0).raw for _ in range(2)] == [request(1).raw, request(2).raw]
    assert lane.dropped == 0


def test_a_full_lane_takes_a_command_and_says_what_it_dropped() -> None:
    lane = Lane(10.0)
    for number in range(MOST_WAITING + 3):
        lane.put(request(number), 0.0)
    lane.put(mode(), 0.0)
    assert lane.dropped == 4
    assert lane.take(0.0).raw == mode().raw


def test_signed_frames_leave_in_the_order_of_their_stamps() -> None:
    """A vehicle refuses an older stamp as a replay."""
    lane = Lane(10.0)
    frames = [request(1, signed=True), setpoint(1.0, signed=True), mode(signed=True)]
    for each in frames:
        lane.put(each, 0.0)
    assert [lane.take(0.0).raw for _ in range(3)] == [each.raw for each in frames]


def test_a_signed_setpoint_that_is_not_due_is_dropped_before_a_newer_frame() -> None:
    lane = Lane(10.0)
    lane.put(setpoint(1.0, signed=True), 0.0)
    lane.take(0.0)
    lane.put(setpoint(2.0, signed=True), 0.05)
    newer = mode(signed=True)
    lane.put(newer, 0.05)
    assert lane.take(0.05).raw == newer.raw
    assert lane.rank(0.2) is None


def test_a_flood_of_one_agent_leaves_the_others_their_setpoints() -> None:
    lanes = {1: Lane(10.0), 2: Lane(10.0), 3: Lane(10.0)}
    uplink, sent = Uplink(lanes, 5760), {1: 0, 2: 0, 3: 0}
    for tick in range(400):
        now = tick * TICK_S
        for number in range(20):
            lanes[1].put((mode if number % 2 else request)(tick * 20 + number), now)
        for agent in (2, 3):
            lanes[agent].put(setpoint(1.0), now)
        for agent, _ in uplink.take(0.0, now):
            sent[agent] += 1
    assert sent[2] == pytest.approx(200, abs=4)
    assert sent[3] == pytest.approx(200, abs=4)


def test_what_comes_down_is_not_there_for_what_goes_up_but_a_third_always_is() -> None:
    def bytes_up(down: float) -> int:
        lanes = {k: Lane(20.0) for k in range(10)}
        uplink, total = Uplink(lanes, 6000), 0
        for tick in range(100):
            for lane in lanes.values():
                lane.put(setpoint(1.0), tick * TICK_S)
            total += sum(len(each.raw) for _, each in uplink.take(down, tick * TICK_S))
        return total // 5

    assert bytes_up(0.0) == pytest.approx(5400, rel=0.05)
    assert bytes_up(3000.0) == pytest.approx(2400, rel=0.05)
    assert bytes_up(99999.0) == pytest.approx(2000, rel=0.05)
