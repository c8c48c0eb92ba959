"""Agents with clocks of their own, on the virtual clock: they fly as if there were one, and see
late news as late."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from swarm_ctl.core.model.timeouts import FRESH_S
from swarm_ctl.core.swarm.peers import Peer
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.impaired import ImpairedTransport, Impairment
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.transport import Inlet, Transport
from tests.scenarios.swap import FORM, IDS, ahead, mission
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, landing_fast
from tests.scenarios.test_steps import assert_good

CLOCKS = {1: ahead(3600.0, 1e-4), 2: ahead(-0.3), 3: ahead(5.0, -1e-4), 4: ahead(0.2)}


Clocks = dict[int, Callable[[float], float]]


def impaired(clocks: Clocks) -> tuple[VirtualSwarm, dict[int, ImpairedTransport]]:
    """A swarm, and how each of its agents hears the others."""
    transports, swarms = dict[int, ImpairedTransport](), list[VirtualSwarm]()

    def wrap(inner: Transport, agent: int) -> Transport:
        names: list[int | str] = [*IDS, "station"]
        now = lambda: swarms[0].now  # noqa: E731
        transports[agent] = ImpairedTransport(inner, names, Impairment(), now, agent)
        return transports[agent]

    swarms.append(VirtualSwarm(mission(rate_hz=10), mesh=wrap, clocks=clocks))
    return landing_fast(swarms[0]), transports


def peer(swarm: VirtualSwarm, agent: int, other: int) -> Peer:
    """The other as the agent hears it."""
    return next(p for p in swarm.members[agent].agent._peers if p.id == other)


def test_they_fly_as_with_one_clock() -> None:
    """To the same places in the same time; and each link's report tells the offset, to half the
    round trip."""
    one, own = (landing_fast(VirtualSwarm(mission(rate_hz=10), clocks=c)) for c in ({}, CLOCKS))
    for swarm in (one, own):
        swarm.fly()
        assert_good(swarm)
    assert own.now == pytest.approx(one.now, abs=1.0)
    assert own.closest_m == pytest.approx(one.closest_m, abs=0.3)
    for i, member in own.members.items():
        assert member.status is not None
        told_s = member.status.time_s
        for j, link in member.status.links.items():
            assert link.clock_ahead_s is not None
            assert link.round_trip_s is not None
            true_s = told_s / (
                1.0 + (1e-4 if i == 1 else -1e-4 if i == 3 else 0.0)
            )  # near enough for a drift
            truth = CLOCKS[j](0.0) - CLOCKS[i](0.0)
            assert (
                abs(link.clock_ahead_s - truth)
                <= 0.5 * link.round_trip_s + 2e-4 * abs(true_s) + 1e-3
            )


@pytest.mark.parametrize(
    ("clocks", "why"),
    [
        ({}, "waiting for the others"),
        (CLOCKS, "agent 4 is heard and has not answered yet: its clock is not known"),
    ],
    ids=["one clock", "own clocks"],
)
def test_no_agent_flies_with_one_that_hears_no_peer(clocks: Clocks, why: str) -> None:
    """Agent 4 is heard, and says that it is not ready, or does not say how old its states are."""
    swarm, transports = impaired(clocks)
    transports[4].silent |= {"1", "2", "3"}
    swarm.run(8.0)
    reasons = [m.status.reason for m in swarm.members.values() if m.status]
    assert reasons == [why] * 3 + ["agents 1-3 not heard"]
    assert {goal for m in swarm.members.values() for goal in m.goals} == {"StandbyGoal"}


def test_agents_of_one_clock_say_no_clock_words() -> None:
    """They know each other's clocks exactly from the first state on. An agent that was started
    again by hand, with a clock of its own that is behind, is heard, asks and is answered, and flies
    with the others again."""
    swarm = VirtualSwarm(mission("continue", rate_hz=10))
    listener = Node(MemoryTransport(swarm.mesh), "test", "listener")
    listener.listen(keys.CLOCK)
    swarm.wait(lambda s: s.in_step(FORM), 60)
    assert not listener.take(keys.CLOCK)
    report = peer(swarm, 1, 2).report(swarm.now)
    assert (report.clock_ahead_s, report.round_trip_s) == (0.0, 0.0)
    swarm.kill(3)
    swarm.run(1.5)
    began_s = swarm.now
    swarm.restart(3, clock=lambda now: now - began_s)
    swarm.run(2.0)  # clock words come once a second
    for i, j, ahead_s in ((1, 3, -began_s), (3, 1, began_s), (1, 2, 0.0)):
        known = peer(swarm, i, j).report(swarm.members[i].clock(swarm.now)).clock_ahead_s
        assert known == pytest.approx(ahead_s, abs=0.03)
    swarm.wait(lambda s: any("rejoins at step 2" in event.text for event in s.events), 60)
    assert_arrives(swarm)


def test_news_that_is_late_one_way_is_seen_as_late() -> None:
    """Agent 4 hears all peers 0.4 s late and is heard at once: it knows that the news may be so
    old, whatever the clocks, and no agent comes too near.
    """
    swarm, transports = impaired(CLOCKS)
    transports[4].impairment = Impairment(delay_s=0.4)
    swarm.wait(lambda s: s.in_step(FORM), 60)
    youngest, ages = 1.0, []
    for _ in range(150):
        swarm.tick()
        now = swarm.members[4].clock(swarm.now)
        for other in (1, 2, 3):
            heard = peer(swarm, 4, other)
            youngest = min(youngest, heard.view(now).age_at_most_s)
            ages.append(heard.age(now))
    assert youngest >= 0.4 - 1e-3
    assert min(ages) >= 0.2 - 1e-2
    assert max(ages) <= FRESH_S
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


class Polled:
    """As the real mesh gives it: news is received when it is looked for, but for what is to be
    timed."""

    def __init__(self, inner: Transport, swarm: list[VirtualSwarm]) -> None:
        self._inner, self._swarm = inner, swarm
        self.publish, self.close, self.refused = inner.publish, inner.close, inner.refused

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        inlet = self._inner.subscribe(key_expression, timed=timed)
        drain = inlet.drain
        if not timed:
            inlet.drain = lambda: [  # type: ignore[method-assign]
                (self._swarm[0].now, key, data) for _, key, data in drain()
            ]
        return inlet


def test_one_that_was_stopped_takes_no_dead_peer_for_heard() -> None:
    """SIGSTOP for ten seconds, in which a peer dies: its last news waits in the queue, and is as
    old as it is."""
    swarms: list[VirtualSwarm] = []
    swarm = VirtualSwarm(
        mission("continue", rate_hz=10), clocks=CLOCKS, mesh=lambda inner, _: Polled(inner, swarms)
    )
    swarms.append(swarm)
    swarm.wait(lambda s: s.in_step(FORM), 60)
    swarm.run(1.0)
    swarm.members[1].frozen = True
    swarm.run(2.0)
    swarm.kill(3)
    swarm.run(8.0)
    swarm.members[1].frozen = False
    swarm.tick()
    now = swarm.members[1].clock(swarm.now)
    assert peer(swarm, 1, 3).received_s == pytest.approx(now)
    assert peer(swarm, 1, 3).age(now) == pytest.approx(8.0, abs=0.2)
    assert peer(swarm, 1, 2).age(now) < 0.15
    assert [state.agent for state in swarm.members[1].agent._peers.snapshot(now).fresh()] == [2, 4]
