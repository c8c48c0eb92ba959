"""Vehicles whose agents were killed, with real processes: `doctor` shows what was left, the next
flight and `doctor --restore` give the vehicles their own parameters back."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.engine.vehicle_memory import VehicleMemory
from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import LoadedMission
from tests.system.pair import agent, ended, listener_of, pair_mission, simulator
from tests.system.running import SWARM_CTL

pytestmark = pytest.mark.timeout(240)

SPEEDUP = 2.0
"""A stall of half a second on a busy machine is 1 s of the mission: the patience of a PX4."""
OWN = {1: {"GUID_TIMEOUT": 3.0, "FS_GCS_ENABLE": 0.0, "MAV_GCS_SYSID": 255.0}}
OWN[2] = {"COM_OBL_RC_ACT": 0.0}
LEFT = {1: {"GUID_TIMEOUT": 0.5, "FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 250.0}}
LEFT[2] = {"COM_OBL_RC_ACT": 4.0}


def doctor(fleet: Path, *options: str) -> tuple[int, dict[int, dict[str, Any]]]:
    """Its exit code, and what it says of each agent's vehicle."""
    command = [SWARM_CTL, "doctor", "--fleet", fleet, "--json", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.stderr == ""
    return done.returncode, {each["agent"]: each for each in json.loads(done.stdout)["vehicles"]}


def values(report: dict[str, Any], *, of: dict[str, float]) -> dict[str, float]:
    """Those of its parameters that `of` names."""
    return {row["name"]: row["value"] for row in report["parameters"] if row["name"] in of}


def killed_in_flight(mission: LoadedMission, epoch_s: float) -> None:
    """Both agents, while they form."""
    agents = [agent(mission.source, i, epoch_s, SPEEDUP) for i in (1, 2)]
    phases: dict[int, Phase] = {}
    with closing(listener_of(mission, keys.STATUS)) as listener, ended(agents):
        while set(phases.values()) != {Phase.FLY} or len(phases) < 2:
            assert all(each.poll() is None for each in agents)
            phases |= {status.agent: status.phase for status, _ in listener.take(keys.STATUS)}
            time.sleep(0.02)
        for each in agents:
            each.send_signal(signal.SIGKILL)


def until_down(mission: LoadedMission) -> dict[int, dict[str, Any]]:
    """What the doctor says when both vehicles are disarmed."""
    while True:
        code, found = doctor(mission.source)
        assert code == 1
        if not any(report["armed"] for report in found.values()):
            return found


@pytest.mark.long
def test_killed_agents_vehicles_get_their_own_values_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One by `doctor --restore`, the other by the next flight; both came down by what was left."""
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path / "state"))
    memory = VehicleMemory(tmp_path / "state")
    # Each vehicle lands close to its start, so that the next flight may begin there.
    mission, epoch_s = pair_mission(tmp_path, 3, 5), time.monotonic()
    second = tmp_path / "second.yaml"
    endpoint = mission.fleet.agent(2).endpoint
    second.write_text(f'agents: [{{id: 2, endpoint: "{endpoint}", autopilot: px4}}]')
    with ended([simulator(mission, epoch_s, SPEEDUP)]):
        killed_in_flight(mission, epoch_s)
        found = until_down(mission)
        for i in (1, 2):
            assert values(found[i], of=LEFT[i]) == LEFT[i]
            assert found[i]["attention"][0].startswith("not its own values")
            assert found[i]["flight"].startswith("pair of ")

        code, found = doctor(second, "--restore")
        assert code == 0
        assert values(found[2], of=OWN[2]) == OWN[2]
        assert "COM_OBL_RC_ACT" in found[2]["restored"]
        assert [entry.vehicle.sysid for entry in memory.entries()] == [1]

        flown = [agent(mission.source, i, epoch_s, SPEEDUP) for i in (1, 2)]
        with ended(flown):
            said = [each.communicate(timeout=90)[1].decode() for each in flown]
            assert [each.returncode for each in flown] == [0, 0], said
        code, found = doctor(mission.source)
        assert code == 0
        assert {i: values(found[i], of=OWN[i]) for i in (1, 2)} == OWN
        assert memory.entries() == []
