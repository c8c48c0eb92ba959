"""What real runs leave behind: recordings that match what was sent, and survive the kill of who
wrote them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from mcap.reader import make_reader
from pymavlink import mavutil

from swarm_ctl import recording
from swarm_ctl.core.model.messages import AgentState, AgentStatus
from swarm_ctl.recording.mcap_reader import is_whole, messages
from tests.system.conftest import Whole
from tests.system.running import LOW, Running

pytestmark = pytest.mark.timeout(240)

Velocity = tuple[float, float, float]
LAND = 9
"""ArduCopter's number of the mode."""
RUN = ("run", LOW, "--lockstep", "--speedup", "9", "--headless")


def test_a_whole_run_is_recorded_and_reported(whole: Whole) -> None:
    """Each agent's states in order and hardly one missing; truth line by line; every setpoint in
    the tlogs."""
    folder = whole.folder
    assert f"report: {folder.relative_to(whole.cwd)}/report.html" in whole.stderr.replace("\n", "")
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


def test_a_killed_station_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    """SIGKILL in flight: the file reads up to the last chunk, `replay` and `report` give it its
    footer, and say so."""
    with Running(*RUN, "--no-report", cwd=tmp_path) as running:
        running.wait_for_event("step 2: form hexagon", 6)
        before_s = max(
            payload.time_s
            for _, payload in recording.read(running.folder)
            if isinstance(payload, AgentState)
        )
        running.kill("station")
        running.wait()
        running.assert_nothing_left()
        folder = running.folder
    assert not is_whole(folder)
    last_s = max(
        payload.time_s for _, payload in recording.read(folder) if isinstance(payload, AgentState)
    )
    assert last_s >= before_s
    alone = tmp_path / "alone.mcap"
    shutil.copy(folder / recording.RECORDING, alone)
    with Running("replay", alone, "--json", "--from", "end", cwd=tmp_path) as replaying:
        assert replaying.wait() == 0, replaying.output
        note, line = replaying.output.splitlines()
    assert "recovered up to its last second" in note
    assert last_s - 1e-6 <= json.loads(line)["time_s"] <= last_s + 1.0
    assert is_whole(alone)
    with Running("report", folder, cwd=tmp_path) as reporting:
        assert reporting.wait() == 0, reporting.output
    assert is_whole(folder)
    assert "recovered up to its last second" in (folder / "report.html").read_text()
