"""Agents started one by one by hand, as on real hosts: no `run`, no station, no shared parent
(with stations: `test_judged_flight.py`)."""

from __future__ import annotations

import re
import signal
import time
from contextlib import closing
from pathlib import Path

import pytest

from swarm_ctl.cli.app import app
from swarm_ctl.cli.flight.station import station
from swarm_ctl.errors import InputError
from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json
from swarm_ctl.runfolder.truth import load_truth
from tests.system.pair import (
    BARE,
    SPEEDUP,
    agent,
    agent_in_waiting,
    ended,
    listener_of,
    pair_mission,
    simulator,
)

pytestmark = pytest.mark.timeout(120)


def test_an_agent_is_killed_and_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL while they form, started again by hand, with a clock of its own: it takes its vehicle
    over, both complete, apart; no station. All have the plan that was fetched before. Its link is
    signed: it signs on above its last stamp."""
    speedup, epoch_s = SPEEDUP, time.monotonic()
    mission = pair_mission(tmp_path, settle_s=5)  # it is killed before the step is done
    key = tmp_path / "mavlink.key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    signed = ("--signing-key", str(key))
    truth, plan = tmp_path / "truth.jsonl", Path(named_by_hash(mission.plan, mission.fleet))
    kept = tmp_path / "state" / "plans"
    monkeypatch.setenv("SWARM_CTL_STATE", str(kept.parent))
    kept.mkdir(parents=True)
    (kept / f"{plan}.json").write_text(plan_to_json(mission.plan, mission.fleet))
    flown = simulator(mission, epoch_s, speedup, key, truth_path=str(truth))
    agents = {i: agent(plan, i, epoch_s, speedup, *(signed if i == 1 else ())) for i in (1, 2)}
    again = agent_in_waiting(plan, 1, time.monotonic(), speedup, *signed)
    processes = [flown, again, *agents.values()]
    with closing(listener_of(mission, keys.STATUS, keys.EVENT)) as listener, ended(processes):
        forming: set[int] = set()
        while len(forming) < 2:
            assert all(each.poll() is None for each in agents.values()), [
                each.communicate()[1] for each in agents.values()
            ]
            forming |= {
                status.agent for status, _ in listener.take(keys.STATUS) if status.step == 2
            }
            time.sleep(0.01)
        agents[1].kill()
        agents[1].wait()
        agents[1] = again
        assert again.stdin is not None
        again.stdin.close()
        codes = [each.wait(60) for each in agents.values()]
        assert codes == [0, 0], [each.communicate()[1] for each in agents.values()]
        said = [event.text for event, _ in listener.take(keys.EVENT)]
        assert any(
            "took over its vehicle in the air; rejoins at step 2" in text for text in said
        ), said
        assert said.count("ended: completed") == 2
        assert flown.stdin is not None
        flown.stdin.close()  # its lifeline: it ends, and finishes the truth
        assert flown.wait(20) == 0
        r_in_m = mission.plan.law.r_in * mission.plan.unit_m
        assert min(load_truth(truth).minima.values()) > r_in_m


def test_ctrl_c_ends_the_wait_for_a_plan(tmp_path: Path) -> None:
    """An agent that waits has no vehicle to look after: it ends at once."""
    at = pair_mission(tmp_path).fleet.agents[0].mesh or ""
    waiting = agent(Path("pair@3fa9c1d2e4b5"), 1, time.monotonic(), 1.0, "--mesh", at)
    with ended([waiting]):
        assert waiting.stderr is not None
        assert waiting.stderr.readline().startswith(b"agent: waits 60 s for pair@3fa9c1d2e4b5")
        waiting.send_signal(signal.SIGINT)
        assert waiting.wait(10) == 130


def test_one_agent_lands_on_sigint(tmp_path: Path) -> None:
    """Without its peer it waits on the ground; Ctrl-C ends it cleanly, and it says how."""
    alone = agent(pair_mission(tmp_path).source, 1, time.monotonic(), 10.0)
    with ended([alone]):
        assert alone.stderr is not None
        assert alone.stderr.readline() == b"agent: ready\n"
        alone.send_signal(signal.SIGINT)
        assert alone.wait(30) == 0
        told = alone.stderr.read().decode()
        assert told.endswith("agent: aborted: Ctrl-C\n")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (
            ["--mesh", "tcp/10.0.0.5"],
            "--mesh tcp/10.0.0.5: no endpoint of the mesh; allowed: tcp/HOST:PORT",
        ),
        (["--mesh", "tcp/10.0.0.5:99999"], "no endpoint of the mesh"),
        ([], "its fleet does not say where agents listen (`mesh`)"),
        (["runs/x", "--mesh", "tcp/10.0.0.5:7447"], "both a run folder"),
    ],
)
def test_a_station_needs_endpoints(tmp_path: Path, arguments: list[str], why: str) -> None:
    """As the fleet of the mission or the command line names them."""
    path = tmp_path / "bare.yaml"
    path.write_text(BARE)
    run = Path(arguments[0]) if arguments[0:1] == ["runs/x"] else None
    with pytest.raises(InputError, match=re.escape(why)):
        station(run, mission=path, mesh=arguments[-1:])


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--id", "9"], "allowed: 1, 2"),
        (["--id", "1"], "has no `endpoint` in the fleet"),
        (["--id", "1", "--endpoint", "udpout:127.0.0.1:1"], "has no `mesh` in the fleet"),
    ],
)
@pytest.mark.parametrize("kind", ["plan", "mission"])
def test_an_agent_needs_its_addresses(
    kind: str, arguments: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the fleet of either file, or as options; what is missing is named."""
    path, plan = tmp_path / "bare.yaml", tmp_path / "plan.json"
    path.write_text(BARE)
    loaded = load(path)
    plan.write_text(plan_to_json(loaded.plan, loaded.fleet))
    file = str(plan if kind == "plan" else path)
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "agent", file, *arguments])
    with pytest.raises(InputError, match=re.escape(why)):
        app()
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "agent", str(plan), "--fleet", "x", *arguments])
    with pytest.raises(InputError, match="is a plan file and has its fleet; allowed: --endpoint"):
        app()
