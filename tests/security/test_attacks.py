"""Attacks on whole runs, flown: what each does on an open mesh and links, and that with keys the
flight is the one without it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import pytest

from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.trust import provision
from tests.on_demand import on_demand
from tests.security.attacks import ATTACKS, Spoofed, positions, under
from tests.system.running import LOW, Running, raised

pytestmark = [pytest.mark.timeout(400), pytest.mark.realtime]

AGENTS: Final = range(1, 4)
SHORT: Final = "{duration_s: 5}"
assert SHORT in LOW.read_text()
MISSION: Final = LOW.read_text().replace(SHORT, "{duration_s: 12}")
"""Attacks need some 4 s of their own time, in which a flight in lockstep goes on."""
UNHARMED_M: Final = 10.0
"""The smallest distance of the flight without an attack."""
STEPPED: Final = ("--lockstep", "--speedup", "5")
KILLS: Final = ("kill from a zenoh client", "kill by the program")
SPOOFS: Final = ("one heartbeat in mode LAND", "forged positions")
"""Frames that an agent hears: it raises an alarm. Of others the simulated vehicle tells."""
HARM: Final[dict[str, tuple[str, str]]] = {
    **dict.fromkeys(KILLS, ("fallen", "killed by the operator")),
    "SET_POSITION_TARGET to two vehicles": ("not believed", ""),
    "a forced disarming": ("fallen", "the vehicle of agent 3 was disarmed in the air"),
    "SIM_MOTOR_STOP": ("fallen", "the vehicle of agent 3 fell"),
    "NAV_LAND in MAVLink 1": ("taken over", "the vehicle was switched to LAND"),
}
"""On an open mesh: the alarm, and the reason of the verdict."""


def with_keys(folder: Path) -> Path:
    """The mission with keys of its own."""
    agents = dict.fromkeys(AGENTS, "127.0.0.1")
    terms = provision.Terms(datetime.now(UTC))
    provision.new(folder / "trust", "low", agents, ["anna"], ["tv"], terms)
    mission = folder / "low.yaml"
    listed = ", ".join(f"{{id: {agent}}}" for agent in AGENTS)
    mission.write_text(f"{MISSION}fleet: {{trust: trust, agents: [{listed}]}}\n")
    return mission


@pytest.fixture
def open_mission(tmp_path: Path) -> Path:
    """The mission without keys."""
    mission = tmp_path / "low.yaml"
    mission.write_text(MISSION)
    return mission


@contextlib.contextmanager
def flight(
    mission: Path, where: Path, names: Sequence[str], how: Sequence[str] = STEPPED
) -> Iterator[Running]:
    """A run under attack since its vehicles form."""
    command = ("run", mission, "--headless", "--no-report", *how)
    with Running(*command, cwd=where) as running:
        running.wait_for_event("step 2:", 3)
        with contextlib.ExitStack() as attacks:
            for name in names:
                attacks.enter_context(under(ATTACKS[name], read_manifest(running.folder)))
            running.wait(350)
        yield running


def may_spoof() -> bool:
    """Whether this user may send with another's address."""
    try:
        Spoofed.probe()
    except PermissionError:
        return False
    return True


def assert_unharmed(running: Running, names: Sequence[str]) -> None:
    """Same outcome, smallest distance within 5 %, all of it authenticated; who heard forged frames
    says so."""
    assert running.process.returncode == 0, running.output
    summary = running.summary()
    assert summary["outcome"] == "completed"
    assert summary["min_true_distance_m"] == pytest.approx(UNHARMED_M, rel=0.05)
    assert summary["protection"] == {
        "mesh": "TLS",
        "operator": "operator anna",
        "authenticated": list(AGENTS),
        "signing": True,
        "signed": list(AGENTS),
    }
    assert "mesh TLS 3/3, links signed 3/3, operator anna" in running.output
    told = {name for name, _ in raised(running.folder)}
    assert ("refused frames" in told) == bool({*names} & {*SPOOFS})
    assert ("refused messages" in told) == bool({*names} & {*KILLS})
    refused = "refused on the mesh: a link: the other end speaks no TLS"
    assert (refused in running.output) == ("kill by the program" in names)
    to_vehicles = {*names} - {*SPOOFS, *KILLS}
    assert ("without a good signature refused" in running.output) == bool(to_vehicles)


def test_all_attacks_together_leave_a_flight_with_keys_unharmed(tmp_path: Path) -> None:
    """But for the one whose flood the lockstep itself would not stand."""
    names = [name for name in ATTACKS if name != "forged positions"]
    if not may_spoof():
        names.remove("one heartbeat in mode LAND")
    with flight(with_keys(tmp_path), tmp_path, names) as running:
        assert_unharmed(running, names)


@pytest.mark.long
@pytest.mark.parametrize("name", ATTACKS)
def test_with_keys_no_attack_does_harm(tmp_path: Path, name: str) -> None:
    if name in SPOOFS and not may_spoof():
        pytest.skip("needs root: frames with another's address")
    how = ("--speedup", "2") if ATTACKS[name] is positions else STEPPED
    with flight(with_keys(tmp_path), tmp_path, [name], how) as running:
        assert_unharmed(running, [name])


@pytest.mark.parametrize("name", [name if name == KILLS[1] else on_demand(name) for name in HARM])
def test_on_an_open_mesh_it_does_harm_that_is_told(
    tmp_path: Path, open_mission: Path, name: str
) -> None:
    """By an alarm, the verdict and the exit code."""
    alarm, reason = HARM[name]
    with flight(open_mission, tmp_path, [name]) as running:
        assert running.process.returncode == 1, running.output
        summary = running.summary()
        assert summary["outcome"] == "failed"
        assert reason in summary["reason"]
        assert alarm in {name for name, _ in raised(running.folder)}
        assert "a link:" not in running.output


@pytest.mark.long
@pytest.mark.parametrize("name", ["one heartbeat in mode LAND", "40 ground stations"])
def test_some_do_no_harm_on_an_open_link_either(
    tmp_path: Path, open_mission: Path, name: str
) -> None:
    """The next real heartbeat refutes a forged one; who is being served keeps its place."""
    if name in SPOOFS and not may_spoof():
        pytest.skip("needs root: frames with another's address")
    with flight(open_mission, tmp_path, [name]) as running:
        assert running.process.returncode == 0, running.output
        assert running.summary()["outcome"] == "completed"
