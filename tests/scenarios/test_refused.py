"""A stranger on an open mesh speaks for an agent under a key of its own: the flight goes on as if
it were not there, the log and an alarm name the key's owner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.payloads import encode
from swarm_ctl.mission.compile.loader import load
from tests.scenarios.swarm import VirtualSwarm
from tests.scenarios.watched import Watch
from tests.system.pair import BARE

WORDS = "a state under agent 7's key says agent 1"


def test_a_state_that_says_yield(tmp_path: Path) -> None:
    """For 12 s, 20 a second, under agent 7's key, for agent 1: each is refused, agent 2 tells it at
    once and every ten seconds, and the flight is completed."""
    path = tmp_path / "pair.yaml"
    path.write_text(BARE)
    swarm = VirtualSwarm(load(path))
    watch, stranger = Watch(swarm), MemoryTransport(swarm.mesh)
    forged = AgentState(
        1,
        10**6,
        0.0,
        swarm.plan.hash(),
        Phase.YIELD,
        2,
        False,
        True,
        (0, 0, -5),
        (0, 0, 0),
        (0, 0),
        (0, 0),
    )
    watch.wait(lambda swarm: swarm.in_step(2))
    for _ in range(240):
        forged = replace(forged, seq=forged.seq + 1, time_s=swarm.now)
        stranger.publish(keys.STATE.key("test", 7), encode(forged), keys.STATE.qos)
        watch.tick()
    watch.fly()
    said = [event.text for event in swarm.events if event.agent == 2 and WORDS in event.text]
    alarms = {alarm for alarm, _ in watch.raised}
    assert swarm.outcomes() == {1: "completed", 2: "completed"}
    assert 2 <= len(said) <= 3
    assert "refused messages" in alarms
