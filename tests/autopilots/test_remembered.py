"""Agents killed in the air on ArduCopter and PX4 themselves: the next flight on the same vehicles
gives them their own failsafe parameters back."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
import yaml

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.vehicle_memory import VehicleMemory
from tests.autopilots.sitl import Client, standing
from tests.system.running import Running

PAIR = Path(__file__).with_name("pair.yaml")
OWN = {
    1: {"FS_GCS_ENABLE": 0.0, "GUID_TIMEOUT": 3.0, "MAV_GCS_SYSID": 255.0},
    2: {"COM_OBL_RC_ACT": 0.0, "COM_OF_LOSS_T": 1.0},
}
LEFT = {
    1: {"FS_GCS_ENABLE": 5.0, "GUID_TIMEOUT": 0.5, "MAV_GCS_SYSID": 250.0},
    2: {"COM_OBL_RC_ACT": 4.0, "COM_OF_LOSS_T": 1.0},
}


def read(clients: dict[int, Client]) -> dict[int, dict[str, float]]:
    """The parameters of both vehicles, as they have them now."""
    return {i: {name: round(clients[i].get(name), 3) for name in OWN[i]} for i in OWN}


@pytest.mark.long
def test_the_next_flight_gives_killed_agents_vehicles_their_own_values_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed while they form; the next flight says what it found, completes, and puts it back."""
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path / "state"))
    memory = VehicleMemory(tmp_path / "state")
    kinds = (VehicleKind.ARDUCOPTER, VehicleKind.PX4)
    first, second = tmp_path / "first", tmp_path / "second"
    with standing(kinds, tmp_path / "vehicles") as vehicles:
        mission = yaml.safe_load(PAIR.read_text())
        mission["agents"][1]["start"] = [0, 10]
        mission["fleet"] = {
            "agents": [
                {"id": i, "endpoint": each.endpoint, "autopilot": each.kind.autopilot}
                for i, each in vehicles.items()
            ]
        }
        file = tmp_path / "pair.yaml"
        file.write_text(yaml.safe_dump(mission))
        options = ("run", file, "--headless", "--no-report")
        with Client(vehicles[1]) as one, Client(vehicles[2]) as two:
            clients = {1: one, 2: two}
            assert read(clients) == OWN
            first.mkdir()
            with Running(*options, cwd=first) as killed:
                killed.wait_for(lambda: "step 2/" in killed.output, 120.0)
                for i in OWN:
                    killed.kill(f"agent-{i}", signal.SIGKILL)
                assert killed.wait() == 1
                assert "has not confirmed its own failsafe parameters" in killed.output
            for client in clients.values():
                client.wait_for(lambda c=client: c.armed is False, seconds=90.0)  # type: ignore[misc]
            assert read(clients) == LEFT
            assert len(memory.entries()) == 2
            second.mkdir()
            with Running(*options, cwd=second) as flight:
                code = flight.wait(180.0)
                assert code == 0, flight.output
                said = (flight.folder / "events.jsonl").read_text()
            assert said.count("it still has our failsafe parameters of") == 2
            assert read(clients) == OWN
            assert memory.entries() == []
