"""One flight as a user starts it, from the command to the report, looked at from all sides."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from pymavlink import mavutil

from swarm_ctl import recording
from swarm_ctl.core.model.messages import AgentState, AgentStatus
from swarm_ctl.recording.mcap_reader import is_whole, messages
from tests.foreign.conftest import Flight
from tests.system.running import raised
from tests.system.test_run import assert_apart, assert_truth_ends_on_the_ground

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(200)]

Velocity = tuple[float, float, float]
LAND = 9
"""ArduCopter's number of the mode."""


def test_hexagon_completes(flight: Flight) -> None:
    """From command to disarmed: exit 0, every figure of the summary in its range, nothing left
    behind."""
    assert flight.code == 0, flight.stderr
    summary = json.loads((flight.folder / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert [step["result"] for step in summary["steps"]] == ["done"] * 5
    assert 5 < summary["time_to_form_s"] < 60
    assert summary["formation_error_m"] < 0.5
    assert set(summary["exit_codes"].values()) == {0}
    assert len(summary["exit_codes"]) == 8
    assert summary["setpoint_rate_hz"] > 9
    assert_apart(flight.folder)
    assert_truth_ends_on_the_ground(flight.folder)
    assert "COMPLETED" in flight.stderr


def test_it_raises_no_alarm(flight: Flight) -> None:
    """An alarm that a correct mission raises is a defect."""
    assert raised(flight.folder) == []


def test_json_lines_are_all_that_is_on_stdout(flight: Flight) -> None:
    lines = [json.loads(line) for line in flight.stdout.splitlines()]
    assert {agent["phase"] for agent in lines[-1]["agents"]} == {"ended"}, flight.stderr
    assert {line["version"] for line in lines} == {1}
    assert "hexagon: COMPLETED" in flight.stderr


def test_a_whole_run_is_recorded_and_reported(flight: Flight) -> None:
    """Each agent's states in order and hardly one missing; truth line by line; every setpoint in
    the tlogs."""
    folder = flight.folder
    assert f"report: {folder.relative_to(flight.cwd)}/report.html" in flight.stderr.replace(
        "\n", ""
    )
    assert (folder / "report.html").stat().st_size > 100_000
    assert is_whole(folder)
    sequences: dict[int, list[int]] = {}
    final: dict[int, AgentStatus] = {}
    for _, payload in recording.read(folder):
        if isinstance(payload, AgentState):
            sequences.setdefault(payload.agent, []).append(payload.seq)
        elif isinstance(payload, AgentStatus):
            final[payload.agent] = payload
    for agent in range(1, 7):
        heard = sequences[agent]
        assert heard == sorted(set(heard))
        # states go out unacknowledged: a busy machine may lose some on the way to the station, the
        # file none
        assert len(heard) > 0.97 * (heard[-1] - heard[0] + 1)
        assert (
            json.loads((folder / "agents" / f"{agent}.json").read_text())["outcome"]
            == final[agent].outcome
        )
    lines = [json.loads(line) for line in (folder / "truth.jsonl").read_text().splitlines()]
    truth = (message for message in messages(folder) if message.topic == "/truth")
    assert [json.loads(message.data) for message in truth] == lines
    with (folder / recording.RECORDING).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == sum(1 for _ in messages(folder))
    for agent in range(1, 7):
        account = json.loads((folder / "agents" / f"{agent}.json").read_text())
        flown, landing, received = _frames(folder / f"{agent}.tlog", agent)
        assert len(flown) == account["setpoints"]
        # asked to land, the driver stops the vehicle until its heartbeat tells the new mode
        assert set(landing) <= {(0.0, 0.0, 0.0)}
        assert received == account["vehicle_link"]["received"]


def _frames(path: Path, sysid: int) -> tuple[list[Velocity], list[Velocity], int]:
    """Setpoints before and after the first command to land, as MAVExplorer reads them; all frames
    of the vehicle."""
    log = mavutil.mavlink_connection(str(path))
    flown: list[Velocity] = []
    landing: list[Velocity] = []
    setpoints, received = flown, 0
    while (message := log.recv_match()) is not None:
        kind = message.get_type()
        assert kind != "BAD_DATA"
        received += message.get_srcSystem() == sysid
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            setpoints.append((message.vx, message.vy, message.vz))
        elif (
            kind == "COMMAND_LONG"
            and message.command == mavutil.mavlink.MAV_CMD_DO_SET_MODE
            and message.param2 == LAND
        ):
            setpoints = landing
    log.close()
    return flown, landing, received
