"""Floods from a stranger on an open mesh, at real processes over real zenoh: every agent goes on
sending setpoints, no process grows, the agents hear each other and an operator's command."""

from __future__ import annotations

import itertools
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from swarm_ctl.core.model.messages import (
    Ack,
    AgentStatus,
    Answers,
    ClockNews,
    Command,
    RefusalReason,
)
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.runfolder.manifest import Manifest, read_manifest
from tests.security.flooder import KINDS, SILENT, STATE
from tests.system.pair import BARE
from tests.system.running import ROOT, Running

LEAST_HZ, MOST_MB, OLDEST_S = 19.0, 64, 2.0
"""An agent is lost after 3 s without a state."""
SMALL = ("states of an unknown agent", "holds for an agent that is none")
OBEYED_S = 3.0
"""After this an operator's command has been answered by all agents."""
HOVERS = 3
"""The step in which the vehicles hold their places."""
MISSION = BARE.replace("  - land", "  - hold: {duration_s: 600}\n  - land").replace(
    "tick_s: 0.1", "tick_s: 0.05"
)
"""At 20 Hz, which `LEAST_HZ` is 95 % of."""


@dataclass
class Watch:
    """What the agents say, and what their processes take, as long as a flood goes on."""

    flight: Running
    manifest: Manifest
    node: Node
    statuses: dict[int, list[AgentStatus]] = field(default_factory=dict)
    acks: list[Ack] = field(default_factory=list)
    before: dict[int, float] = field(default_factory=dict)
    grown_mb: dict[int, float] = field(default_factory=dict)
    obeyed_after_s: float | None = None

    def look(self) -> None:
        for status, _ in self.node.take(keys.STATUS):
            self.statuses.setdefault(status.agent, []).append(status)
        self.acks += [ack for ack, _ in self.node.take(keys.ACK)]
        for pid in self.flight.pids.values():
            now_mb = resident_mb(pid)
            grown_mb = now_mb - self.before.setdefault(pid, now_mb)
            self.grown_mb[pid] = max(grown_mb, self.grown_mb.get(pid, 0.0))

    def obeyed(self) -> set[int]:
        """The agents that have answered the operator's command."""
        return {ack.agent for ack in self.acks if ack.command == "honest"}

    def hovers(self) -> bool:
        """Both agents hold their places."""
        self.look()
        newest = [told[-1] for told in self.statuses.values()]
        return len(newest) == 2 and all(status.step == HOVERS for status in newest)

    def anew(self) -> None:
        """From now on."""
        self.statuses, self.before, self.grown_mb = {}, {}, {}
        self.look()

    def rates_hz(self) -> dict[int, float]:
        """Of each agent's setpoints."""
        ends = {agent: (told[0], told[-1]) for agent, told in self.statuses.items()}
        return {
            agent: (last.setpoints - first.setpoints) / (last.time_s - first.time_s)
            for agent, (first, last) in ends.items()
        }

    def oldest_s(self) -> float:
        """How old an agent's newest state of the other was at most, when it told."""
        told = [status for each in self.statuses.values() for status in each]
        return max(link.age_s or 0.0 for status in told for link in status.links.values())


def resident_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


@contextmanager
def hovering(folder: Path) -> Iterator[Watch]:
    """A run of two agents in the air, with a station."""
    mission = folder / "pair.yaml"
    mission.write_text(MISSION)
    with Running("run", mission, "--headless", "--seed", "1", cwd=folder) as flight:
        flight.wait_for(lambda: len(list(folder.glob("runs/*/processes.json"))) == 1)
        manifest = read_manifest(flight.folder)
        transport = ZenohTransport([], manifest.agents_mesh, time.monotonic)
        with closing(Node(transport, manifest.swarm, "watch")) as node:
            node.listen(keys.STATUS, keys.ACK, agents=(1, 2))
            watch = Watch(flight, manifest, node)
            flight.wait_for(watch.hovers)
            yield watch


def flooded(watch: Watch, kinds: tuple[str, ...], seconds: float) -> dict[str, int]:
    """The floods all at once, at the first agent; how much each sent. Within them an operator
    commands, from a station whose beacon was never heard."""
    endpoint, swarm = watch.manifest.agents_mesh[0], watch.manifest.swarm
    watch.anew()
    with flooding(kinds, swarm, seconds, endpoint, aside=True) as floods:
        told_s = command_due_s = time.monotonic() + 1.0
        while any(each.poll() is None for each in floods):
            watch.look()
            if watch.obeyed() == {1, 2} and watch.obeyed_after_s is None:
                watch.obeyed_after_s = time.monotonic() - told_s
            if time.monotonic() >= command_due_s:
                command_due_s += 0.5
                at_s = time.monotonic() - watch.manifest.epoch_s
                watch.node.send(keys.COMMAND, Command("honest", "hold", (), at_s, number=1))
            time.sleep(0.05)
        watch.look()
        return {kind: int(each.communicate()[0]) for kind, each in zip(kinds, floods, strict=True)}


@contextmanager
def flooding(
    kinds: tuple[str, ...], swarm: str, seconds: float, endpoint: str, *, aside: bool = False
) -> Iterator[list[subprocess.Popen[str]]]:
    """A process for each flood; behind the block, none. `aside`: it takes no core that others want,
    as a stranger on a machine of its own."""
    command = [sys.executable, "-m", "tests.security.flooder"]
    more = [swarm, str(seconds), endpoint, *(["aside"] * aside)]
    floods = [
        subprocess.Popen([*command, kind, *more], cwd=ROOT, stdout=subprocess.PIPE, text=True)
        for kind in kinds
    ]
    try:
        yield floods
    finally:
        for each in floods:
            each.kill()
            each.wait()
            assert each.stdout is not None
            each.stdout.close()


def unharmed(watch: Watch, sent: dict[str, int]) -> None:
    """The row's figures are in what pytest shows of a failure, and with `-s`."""
    rates = {agent: round(hz, 1) for agent, hz in watch.rates_hz().items()}
    names = {pid: name for name, pid in watch.flight.pids.items()}
    grown = {names[pid]: round(mb, 1) for pid, mb in watch.grown_mb.items()}
    print(f"sent {sent}; oldest state {watch.oldest_s():.2f} s; {watch.obeyed_after_s=}")
    print(f"setpoints [Hz] {rates}; grown [MB] {grown}")
    assert all(sent.values())
    assert len(rates) == 2
    assert min(rates.values()) >= LEAST_HZ
    assert max(grown.values()) <= MOST_MB
    assert watch.oldest_s() < OLDEST_S
    assert watch.obeyed_after_s is not None
    assert watch.obeyed_after_s < OBEYED_S


@pytest.mark.timeout(60)
def test_a_member_is_heard_in_a_flood() -> None:
    """Two sessions and three floods at one of them: it hears the other's states without a gap of a
    second, its clock words and its commands, and takes no memory."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    endpoint, own = f"tcp/127.0.0.1:{port}", os.getpid()
    kinds = (
        "states of an unknown agent",
        "holds for an agent that is none",
        "clock words of 10 MB",
    )
    heard_s: dict[str, list[float]] = {"state": [], "clock": [], "command": []}
    channels = (keys.STATE, keys.CLOCK, keys.COMMAND)
    with (
        closing(Node(ZenohTransport([endpoint], [], time.monotonic), "pair", 1)) as here,
        closing(Node(ZenohTransport([], [endpoint], time.monotonic), "pair", 2)) as there,
        flooding(kinds, "pair", 3.0, endpoint) as floods,
    ):
        here.listen(*channels, agents=(1, 2))
        before, most, sent = resident_mb(own), 0.0, 0
        reasons = set[RefusalReason]()
        while any(each.poll() is None for each in floods):
            sent += 1
            there.send(keys.STATE, replace(STATE, agent=2, seq=sent))
            there.send(keys.CLOCK, ClockNews(2, 1.0, Answers.REGULAR, ()))
            there.send(keys.COMMAND, Command("honest", "hold", (), 1.0, station="2"))
            for channel in channels:
                for payload, at_s in here.take(channel):
                    if "2" in (getattr(payload, "station", ""), str(getattr(payload, "agent", ""))):
                        heard_s[channel.name].append(at_s)
            reasons |= {refusal.reason for refusal in here.refused(time.monotonic())}
            most = max(most, resident_mb(own))
            time.sleep(0.05)
        told = [int(each.communicate()[0]) for each in floods]
    assert min(told[:2]) > 1000
    assert told[2] >= 1
    assert RefusalReason.TOO_MANY in reasons
    gaps_s = {name: max(b - a for a, b in itertools.pairwise(t)) for name, t in heard_s.items()}
    print(f"floods {told}; of {sent} words {[len(t) for t in heard_s.values()]}; gaps {gaps_s}")
    assert max(gaps_s["state"], gaps_s["clock"]) < 1.0
    assert len(heard_s["command"]) > sent / 4, "each is sent again until it is acknowledged"
    assert most - before <= MOST_MB


@pytest.mark.long
@pytest.mark.timeout(300)
def test_several_floods_at_once(tmp_path: Path) -> None:
    """States of an unknown agent, holds for an agent that is none, clock words of 10 MB and 500
    silent connections: a flight goes on as if there were none."""
    with hovering(tmp_path) as watch:
        kinds = (*SMALL, "clock words of 10 MB", SILENT)
        unharmed(watch, flooded(watch, kinds, 4.0))


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.parametrize("kind", KINDS)
def test_a_flood(kind: str, tmp_path: Path) -> None:
    """Of each kind, for 15 s."""
    with hovering(tmp_path) as watch:
        unharmed(watch, flooded(watch, (kind,), 15.0))
