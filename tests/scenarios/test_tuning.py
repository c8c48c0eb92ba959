"""The law changed in flight, on the virtual clock: by all agents at one time or by none, whatever
is lost."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.commands.send import CommandSender
from swarm_ctl.core.model.messages import Command, Gains, Tuning
from swarm_ctl.core.swarm.gain_update import LEAD_S, planned
from swarm_ctl.mesh import keys
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, at_step, deaf, flown_once
from tests.scenarios.test_steps import FORM, quartet

ALL = (1, 2, 3, 4)


class Desk:
    """A ground station's sending side on a swarm; remembers when each agent's law changed, and to
    which."""

    def __init__(self, swarm: VirtualSwarm) -> None:
        self.swarm = swarm
        self.sender = CommandSender(swarm.send, ALL)
        self.failures: list[str] = []
        self.changes: dict[int, list[tuple[float, Gains]]] = {agent: [] for agent in ALL}
        self.alive = True

    def tune(
        self,
        agents: tuple[int, ...] = ALL,
        name: str = "t",
        ahead_s: tuple[tuple[int, float], ...] = (),
        **values: float,
    ) -> Command:
        """Order a change for two seconds from now."""
        now, plan = self.swarm.now, self.swarm.plan
        tuning = Tuning(replace(planned(plan), **values), now + LEAD_S, ahead_s)
        command = Command(name, "tune", agents, now, plan_hash=plan.hash(), tuning=tuning)
        command = replace(command, ahead_s=ahead_s)
        self.sender.send(command, now)
        return command

    def run(self, seconds: float) -> None:
        """Tick, pass answers on, note changes."""
        until = self.swarm.now + seconds
        while self.swarm.now < until:
            if self.alive:
                for ack in self.swarm.acks:
                    self.sender.hear(ack)
                self.failures += [
                    sent.failed for sent in self.sender.turn(self.swarm.now) if sent.failed
                ]
            self.swarm.acks.clear()
            self.swarm.tick()
            for agent, member in self.swarm.members.items():
                seen = self.changes[agent]
                if (
                    seen[-1][1] if seen else planned(self.swarm.plan)
                ) != member.agent._controller.gains:
                    seen.append((self.swarm.now, member.agent._controller.gains))

    @property
    def moments(self) -> list[tuple[float, ...]]:
        """When the agents' laws changed, by agent."""
        return [tuple(round(when, 3) for when, _ in self.changes[agent]) for agent in ALL]


@pytest.fixture
def desk() -> Desk:
    """Four agents on the ground that hear each other."""
    return Desk(heard())


@flown_once
def heard() -> VirtualSwarm:
    swarm = VirtualSwarm(quartet("land"))
    swarm.run(4)
    return swarm


def test_all_change_in_the_tick_of_the_order_s_time() -> None:
    """In flight, while they form; the mission goes on to its landing, and statuses tell the law in
    force."""
    swarm = at_step(quartet("land"), FORM)
    desk = Desk(swarm)
    order = desk.tune(h=0.04, kappa=8.0)
    desk.run(4)
    assert order.tuning is not None
    assert len(set(desk.moments)) == 1
    ((when,),) = set(desk.moments)
    assert -1e-3 < when - order.tuning.at_s < swarm.plan.tick_s + 1e-3
    statuses = [member.status for member in swarm.members.values()]
    assert {status.gains for status in statuses if status} == {Gains(0.1, 2.0, 0.04, 8.0)}
    assert {member.agent._controller.gain for member in swarm.members.values()} == {0.04 * 8.0}
    assert_arrives(swarm)


def test_an_expelled_agent_changes_with_the_others() -> None:
    """It holds, and the others do not listen to it: that keeps no law and no zone from them."""
    swarm = at_step(quartet("land"), FORM)
    swarm.command("expel", about=(2,))
    swarm.run(1.0)
    desk = Desk(swarm)
    desk.tune(h=0.04)
    desk.run(4)
    assert desk.failures == []
    assert len(set(desk.moments)) == len(desk.moments[0]) == 1


def test_agents_with_other_clocks_change_together() -> None:
    """The order's time is the sender's; it says how far each clock is ahead, to some tenths of a
    second: the others follow an early agent as soon as they hear it.
    """
    clocks = {1: 3600.0, 2: -3600.0, 3: 0.3}
    swarm = VirtualSwarm(
        quartet("land"), clocks={i: lambda now, s=s: now + s for i, s in clocks.items()}
    )  # type: ignore[misc]
    swarm.run(4)
    desk = Desk(swarm)
    order = desk.tune(ahead_s=((1, 3600.1), (2, -3600.05)), h=0.04)
    desk.run(4)
    assert order.tuning is not None
    assert [len(moments) for moments in desk.moments] == [1, 1, 1, 1]
    moments = [moment for (moment,) in desk.moments]
    assert max(moments) - min(moments) < swarm.plan.tick_s + 0.01
    assert abs(moments[0] - order.tuning.at_s) < 0.36


def test_one_refusal_stops_all(desk: Desk) -> None:
    """Agent 3 has heard of another change, which the others have not."""
    ends = [deaf(desk.swarm, agent, keys.COMMAND) for agent in (1, 2, 4)]
    other = Desk(desk.swarm)
    other.tune(h=0.03, name="other")
    other.run(0.2)
    for end in ends:
        end()
    desk.tune(h=0.04)
    desk.run(6)
    assert desk.failures[0].startswith("refused by agent 3: another change is under way")
    assert desk.moments == [(), (), (), ()]


def test_a_lost_word_is_repaired_by_the_peers(desk: Desk) -> None:
    """Agent 4 never hears `apply`; it changes in the same tick as the others."""
    deaf(desk.swarm, 4, keys.COMMAND, kind="apply")
    desk.tune(h=0.04)
    desk.run(4)
    assert len(set(desk.moments)) == 1
    assert len(desk.moments[0]) == 1


def test_one_agent_that_heard_is_enough_when_the_station_dies(desk: Desk) -> None:
    """The station says `apply` once, one agent hears it, and all change at the time."""
    for agent in (1, 3, 4):
        deaf(desk.swarm, agent, keys.COMMAND, kind="apply")
    desk.tune(h=0.04)
    desk.run(0.3)
    desk.alive = False
    desk.run(4)
    assert len(set(desk.moments)) == 1
    assert len(desk.moments[0]) == 1


def test_a_station_that_dies_between_the_phases_changes_nothing(desk: Desk) -> None:
    """All have prepared; without another word the old law stays."""
    desk.tune(h=0.04)
    desk.run(0.05)
    desk.alive = False
    desk.run(6)
    assert desk.moments == [(), (), (), ()]
    assert all(
        member.agent._command_handler.gain_update._prepared
        for member in desk.swarm.members.values()
    )


def test_a_late_agent_follows_as_soon_as_it_hears(desk: Desk) -> None:
    """Cut off from all before `apply` came; it keeps the old law until a peer is heard, then
    changes at once."""
    desk.tune(h=0.04)
    desk.run(0.05)
    end = deaf(desk.swarm, 2, keys.COMMAND, keys.STATE)
    desk.run(4)
    assert desk.moments[1] == ()
    assert all(len(desk.moments[k]) == 1 for k in (0, 2, 3))
    end()
    heard = desk.swarm.now
    desk.run(1)
    assert len(desk.moments[1]) == 1
    assert desk.moments[1][0] - heard < 0.11


def test_a_decision_after_the_time_is_refused_by_all(desk: Desk) -> None:
    """`apply` was under way for too long: no agent begins."""
    order = desk.tune(h=0.04)
    desk.run(0.05)
    desk.alive = False
    desk.run(3)
    desk.swarm.send(Command("late", "apply", ALL, desk.swarm.now, commits=order.tag))
    desk.swarm.run(0.1)
    late = [ack for ack in desk.swarm.acks if ack.command == "late"]
    assert len(late) == 4
    assert all("too late" in ack.reason for ack in late)
    desk.run(1)
    assert desk.moments == [(), (), (), ()]


def test_no_answer_of_one_stops_all(desk: Desk) -> None:
    """It is told before the time is over."""
    deaf(desk.swarm, 2, keys.COMMAND)
    order = desk.tune(h=0.04)
    desk.run(1.6)
    assert desk.failures == ["no answer from agent 2"]
    assert order.tuning is not None
    assert desk.swarm.now < order.tuning.at_s
    desk.run(5)
    assert desk.moments == [(), (), (), ()]


def test_no_agent_that_flies_is_left_out(desk: Desk) -> None:
    """Agents refuse a change that a peer they hear was not asked about."""
    desk.tune((1, 2, 3), h=0.04)
    desk.run(4)
    assert desk.failures[0].endswith("agent 4 flies too, and was not asked")
    assert desk.moments == [(), (), (), ()]


def test_an_agent_that_was_gone_takes_up_the_law_of_the_others(desk: Desk) -> None:
    """It was lost, so it was not asked. It says that there are two laws, and flies that of its
    peers once they have told it."""
    desk.swarm.members[4].frozen = True
    desk.run(8)
    desk.tune((1, 2, 3), h=0.04)
    desk.run(4)
    desk.swarm.members[4].frozen = False
    desk.run(1)
    said = [event.text for event in desk.swarm.events if event.agent == 4]
    assert any("flies a law that agent 4 was not asked about" in text for text in said)
    assert "takes up what agent 1 flies" in said
    assert {m.agent._controller.gains.h for m in desk.swarm.members.values()} == {0.04}


def test_a_law_that_few_fly_is_not_taken_up(desk: Desk) -> None:
    """Agents 1 to 3 lose sight of agent 4, which alone takes an update that it alone is asked
    about: when they meet again, each keeps its own, and says so."""
    ends = [deaf(desk.swarm, agent, keys.STATE, keys.COMMAND) for agent in (1, 2, 3)]
    end = deaf(desk.swarm, 4, keys.STATE)
    desk.run(6)
    desk.tune((4,), h=0.03)
    desk.run(3)
    for again in (*ends, end):
        again()
    desk.run(3)
    flown = [m.agent._controller.gains.h for m in desk.swarm.members.values()]
    assert flown == [planned(desk.swarm.plan).h] * 3 + [0.03]
    assert any("flies a law that agent 1 was not asked" in e.text for e in desk.swarm.events)


def test_an_older_law_never_comes_back(desk: Desk) -> None:
    """Two changes, one after the other; a late agent goes to the newest at once."""
    desk.tune(h=0.04, name="first")
    desk.run(0.05)
    end = deaf(desk.swarm, 3, keys.STATE)
    desk.run(3)
    desk.tune(h=0.03, name="second")
    desk.run(3)
    end()
    desk.run(1)
    assert {m.agent._controller.gains.h for m in desk.swarm.members.values()} == {0.03}
    assert [gains.h for _, gains in desk.changes[3]][-1] == 0.03
