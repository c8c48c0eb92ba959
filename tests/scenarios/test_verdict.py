"""What a flight is called when something happens to its vehicles that no agent admits: a whole
swarm on the virtual clock, its truth and its agents' last words judged as a run folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.engine.launch.sim_config import simulator_config
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary
from swarm_ctl.runfolder.manifest import Manifest, write_manifest
from swarm_sim.config import SimConfig
from swarm_sim.firmware.message import Message
from swarm_sim.world.truth_recorder import TruthFile, TruthRecorder
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, landing_fast

TEXT = """\
version: 1
name: trouble
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 45, r_out: 9, r_in: 3}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 12]}
shapes:
  row: {kind: line, spacing: 12}
steps:
  - takeoff: {height_m: 5}
  - form: {shape: row, settle_s: 2}
  - hold: {duration_s: 5}
  - land
policies: {agent_lost: continue, fence: continue}
fleet:
  agents: [{id: 1}, {id: 2, autopilot: px4}]
"""
HOLD, LANDING = 3, 4


def flown(where: Path, step: int, deed: Callable[[VirtualSwarm], None]) -> Summary:
    """The summary of the flight in which `deed` is done a second after `step` began. The agents say
    that all went well, and their processes, too."""
    mission = loads(TEXT)
    swarm = landing_fast(VirtualSwarm(mission))
    vehicles = [
        replace(entry, endpoint=f"udpin:127.0.0.1:{1000 + entry.sysid}")
        for entry in mission.fleet.agents
    ]
    settings = simulator_config(mission.plan, vehicles, mission.file.simulation)
    config = SimConfig.model_validate(settings | {"epoch_s": 0.0, "seed": 1})
    recorder = TruthRecorder(swarm.hub.world, config, TruthFile(where / "truth.jsonl"))
    swarm.hub.recorder = recorder
    swarm.wait(lambda s: s.in_step(step))
    swarm.run(1)
    deed(swarm)
    swarm.fly()
    until_s = swarm.now + 60.0
    while not swarm.all_down and swarm.now < until_s:
        swarm.tick()
    recorder.close()
    _account(where, mission, swarm)
    return summarise(where, {"agent-1": 0, "agent-2": 0, "simulator": 0, "station": 0})


def _account(where: Path, mission: LoadedMission, swarm: VirtualSwarm) -> None:
    fleet = tuple(replace(entry, endpoint="udpout:h:1") for entry in mission.fleet.agents)
    made = Manifest(
        mission="trouble.yaml",
        swarm="trouble",
        started_at=datetime(2026, 1, 1, tzinfo=UTC),
        speedup=1.0,
        epoch_s=0.0,
        headless=True,
        plan=mission.plan,
        plan_hash=mission.plan.fingerprint(),
        fleet=fleet,
        simulated=(1, 2),
    )
    write_manifest(where, made)
    (where / "agents").mkdir()
    for i, member in swarm.members.items():
        assert member.status is not None
        well = replace(member.status, outcome=Outcome.COMPLETED, reason="")
        (where / "agents" / f"{i}.json").write_text(json.dumps(asdict(well)))
    for name in ("events.jsonl", "statuses.jsonl"):
        (where / name).touch()


def nothing(_: VirtualSwarm) -> None:
    """All goes well."""


def disarm(swarm: VirtualSwarm) -> None:
    """One forged MAVLink command: force-disarm vehicle 2 in the air."""
    fields = {"command": 400, "param1": 0.0, "param2": 21196.0}
    fields |= {"target_system": 2, "target_component": 1}
    command = fields | {f"param{k}": 0.0 for k in range(3, 8)}
    swarm.hub.world.handle(1, Message("COMMAND_LONG", command | {"confirmation": 0}, (255, 190)))


def motors_stop(swarm: VirtualSwarm) -> None:
    """The motors of vehicle 1 fail."""
    swarm.hub.world.vehicles[0].firmware.parameters.set("SIM_MOTOR_STOP", 1.0)


def thrown(swarm: VirtualSwarm) -> None:
    """Vehicle 1 is thrown past vehicle 2 with 600 m/s: 12 m within one step of the physics, so that
    no sample has the two near each other."""
    first, _ = swarm.hub.world.groups.values()
    for north_m in (6.0, -6.0):
        north, east = swarm.positions()[2]
        first.state.position[0, :2] = [north + north_m, east + 1.0]
        swarm.tick()


def together(swarm: VirtualSwarm) -> None:
    """A gust that no agent can answer carries vehicle 1 into vehicle 2, at the same height."""
    first, second = swarm.hub.world.groups.values()
    place = second.state.position[0]
    first.state.position[0] = [place[0], place[1] - 0.4, place[2]]


@pytest.mark.parametrize(
    ("step", "deed", "told"),
    [
        (HOLD, nothing, ""),
        (HOLD, disarm, "the vehicle of agent 2 was disarmed in the air at"),
        on_demand(HOLD, motors_stop, "the vehicle of agent 1 fell: it hit the ground at"),
        (LANDING, motors_stop, "the vehicle of agent 1 fell: it hit the ground at"),
        (HOLD, thrown, "agents 1-2 were"),
        (HOLD, together, "the vehicles of agents 1-2 collided at"),
    ],
)
def test_the_truth_decides(
    tmp_path: Path, step: int, deed: Callable[[VirtualSwarm], None], told: str
) -> None:
    summary = flown(tmp_path, step, deed)
    assert summary.outcome == ("failed" if told else "completed"), summary.reason
    assert summary.reason.startswith(told), summary.reason
    assert not told or f"in step {step} (" in summary.reason
    assert set(summary.judged_by.values()) == {"truth"}
