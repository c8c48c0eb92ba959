"""What the shell completes at tab: asked as bash asks."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.cli.shared.options import recorded_run
from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.errors import InputError
from swarm_ctl.runfolder.manifest import write_manifest
from tests.unit.cli.test_main import called
from tests.unit.plans import groups_mission
from tests.unit.report.run_folders import manifest

OLD, NEW = "runs/20260101-120000-square", "runs/20260102-120000-hexagon"


@pytest.fixture
def completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> object:
    """The words for a line that ends where tab was pressed, beside two runs."""
    monkeypatch.chdir(tmp_path)
    for name in (OLD, NEW):
        Path(name).mkdir(parents=True)
        # the new one flies, by agents that other hosts started: no process here tells of them;
        # begun before this machine was started, a run would have ended, whatever else it says
        write_manifest(Path(name), manifest(elsewhere=name == NEW, epoch_s=0.0))

    def complete(line: str) -> list[str]:
        monkeypatch.setenv("_SWARM_CTL_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        assert called(monkeypatch) == 0
        return capsys.readouterr().out.split()

    return complete


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        (
            "send ",
            ["hold", "resume", "next", "form", "move", "follow", "goto", "tune", "zone", "readmit"],
        ),
        ("send l", []),
        ("send ki", []),
        ("send ret", []),
        ("send form ", ["hexagon"]),
        ("send form l", []),
        ("send form hexagon ", []),
        ("send tune h", ["h=0.05"]),
        ("send hold ", []),
        ("send land ", []),
        ("send hold --agents ", ["1", "2", "3", "4", "5", "6"]),
        ("send hold --agents 2,3,", ["2,3,1", "2,3,4", "2,3,5", "2,3,6"]),
        ("send hold --run ", [NEW, OLD]),
        (f"send --run {OLD} form ", ["hexagon"]),
        ("send --run nowhere form ", []),
        ("station ", [NEW, OLD]),
        ("replay runs/20260101", [OLD]),
        ("report ", [NEW, OLD]),
    ],
)
def test_orders_shapes_runs_and_agents(completed: object, line: str, wanted: list[str]) -> None:
    """And no order that lands, returns or kills."""
    assert callable(completed)
    assert completed(f"swarm-ctl {line}") == wanted


def test_a_folder_of_runs_is_no_run(completed: object, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: has no recording; allowed: a run folder with one"):
        recorded_run(tmp_path / "empty", print)
    with pytest.raises(InputError, match=f"runs is no run folder, it has 2; the newest: {NEW}"):
        recorded_run(Path("runs"), print)
    assert recorded_run(Path(NEW), print) == Path(NEW)


def test_the_newest_run_with_a_recording_is_replayed(completed: object) -> None:
    """A newer one that has none is passed over, and named; none at all is an error."""
    told: list[str] = []
    with pytest.raises(InputError, match="no run in runs/ has a recording"):
        recorded_run(None, told.append)
    (Path(OLD) / "recording.mcap").touch()
    told.clear()
    assert recorded_run(None, told.append) == Path(OLD)
    assert told == [f"{NEW} has no recording; the one before it is taken"]
    (Path(NEW) / "recording.mcap").touch()
    assert recorded_run(None, told.append) == Path(NEW)


def test_the_groups_of_a_mission_are_completed(completed: object) -> None:
    """Beside its agents."""
    assert callable(completed)
    mission = groups_mission()
    fleet = tuple(
        FleetAgent(agent.id, agent.id, "ardupilot", f"udpout:127.0.0.1:{14600 + agent.id}")
        for agent in mission.plan.agents
    )
    write_manifest(Path(NEW), manifest(mission.plan, fleet=fleet, elsewhere=True))
    asked = "swarm-ctl send hold --agents "
    assert completed(asked)[:4] == ["@scouts", "@sweepers", "@rest", "1"]
    assert completed(f"{asked}@s") == ["@scouts", "@sweepers"]
    assert completed(f"{asked}@scouts,@s") == ["@scouts,@sweepers"]
