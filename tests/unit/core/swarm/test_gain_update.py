"""Changes of the law between agents that lose words: never a law that was not decided, never two
for long."""

from __future__ import annotations

import functools
import random
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import Ack, AgentState, Command, Gains, Phase, Tuning
from swarm_ctl.core.model.plan import Compensation, Plan
from swarm_ctl.core.swarm.gain_update import (
    GainUpdate,
    GainUpdateRound,
    limits,
    out_of_range,
    planned,
    values_of,
)
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.mission.compile.loader import load, loads

HEXAGON = Path(__file__).parents[4] / "missions" / "hexagon.yaml"
AGENTS = (1, 2, 3, 4, 5, 6)
TICK_S, AT_S, END_S = 0.1, 2.0, 3.0


@functools.cache
def plan() -> Plan:
    return load(HEXAGON).plan


class Swarm:
    """Tuners and a sender that exchange words."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.tuners = {i: GainUpdate(plan(), i, 7) for i in AGENTS}
        self.peers = {i: Peers(plan(), i) for i in AGENTS}
        gains = replace(planned(plan()), h=0.03)
        self.round = GainUpdateRound(Command("t", "tune", AGENTS, 0.0, tuning=Tuning(gains, AT_S)))
        self.known: dict[tuple[int, str], Ack] = {}
        self.now = 0.0

    def tick(self, loss: float) -> None:
        """All agents speak; this share of their words is lost."""

        def gets() -> bool:
            return self.random.random() >= loss

        self.now = round(self.now + TICK_S, 6)
        self.round.decide(self.now)
        if self.now < END_S and not self.round.failed:
            command = self.round.applied or self.round.ask
            for agent in AGENTS:
                if gets():
                    ack = self._answer(agent, command)
                    if gets():
                        self.round.hear(ack)
        states = {i: self._state(i) for i in AGENTS}
        for agent, tuner in self.tuners.items():
            tuner.update(self.now, [(states[i], self.now) for i in AGENTS if i != agent and gets()])

    def _answer(self, agent: int, command: Command) -> Ack:
        if (agent, command.id) not in self.known:
            reason = self.tuners[agent].refusal(command, self.peers[agent].snapshot(self.now))
            if not reason:
                self.tuners[agent].obey(command)
            self.known[agent, command.id] = Ack(agent, command.id, not reason, reason)
        return self.known[agent, command.id]

    def _state(self, agent: int) -> AgentState:
        tuner, zero = self.tuners[agent], (0.0, 0.0, 0.0)
        made = AgentState(
            agent, 1, self.now, 7, Phase.FLY, 1, False, True, zero, zero, zero[:2], zero[:2]
        )
        return replace(made, gains_tag=tuner.tag, next_gains_tag=tuner.decided)

    @property
    def laws(self) -> set[float]:
        return {tuner.gains.h for tuner in self.tuners.values()}


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.floats(0, 0.99), st.floats(0, 1))
def test_whatever_is_lost_all_fly_one_law_once_they_hear_each_other(
    seed: int, early: float, late: float
) -> None:
    """No agent changes without a decision or before its time; after it, one tick of whole links
    makes one law of it."""
    swarm = Swarm(seed)
    while swarm.now < END_S:
        swarm.tick(early if swarm.round.applied is None else late)
        if swarm.now < AT_S or swarm.round.applied is None:
            assert swarm.laws == {planned(plan()).h}
    begun = 0.03 in swarm.laws
    for _ in range(2):  # what is said in one tick is heard in the next
        swarm.tick(0.0)
    assert swarm.laws == ({0.03} if begun else {planned(plan()).h})


@settings(max_examples=50)
@given(
    st.builds(
        Gains,
        delta_a=st.floats(allow_nan=True),
        delta_l=st.floats(1, 5),
        h=st.floats(-1, 1),
        kappa=st.floats(-1, 30),
    )
    | st.builds(
        Gains,
        delta_a=st.floats(0.01, 0.5),
        delta_l=st.floats(2, 2.5),
        h=st.floats(0.001, 0.08),
        kappa=st.floats(1, 25),
    ),
    st.sampled_from(Compensation),
)
def test_what_can_be_flown_is_what_a_mission_may_say(
    gains: Gains, compensation: Compensation
) -> None:
    """Everything accepted in flight passes `validate` without a warning about the gains."""
    h = 0.0025 if compensation is Compensation.NONE else 0.05
    if out_of_range(
        gains, replace(plan(), compensation=compensation, law=replace(plan().law, h=h))
    ):
        return
    mission = yaml.safe_load(HEXAGON.read_text())
    mission["law"] |= values_of(gains) | {"compensation": compensation.value}
    warned = [str(warning) for warning in loads(yaml.safe_dump(mission)).warnings]
    assert not [warning for warning in warned if "kappa" in warning]


@pytest.mark.parametrize("name", ["delta_a", "delta_l", "h", "kappa"])
def test_the_limits_themselves_can_be_flown(name: str) -> None:
    """And nothing beyond."""
    most = limits(plan())[name][1]
    assert out_of_range(replace(planned(plan()), **{name: most}), plan()) == ""
    why = out_of_range(replace(planned(plan()), **{name: most * 1.01}), plan())
    assert f"{most:g}" in why
    assert name in why


def test_a_mission_s_own_values_can_always_be_flown_again() -> None:
    """Even where they are beyond what else is allowed in flight."""
    bold = replace(plan(), kappa=5.0, law=replace(plan().law, h=0.2, delta_a=0.5, delta_l=3.0))
    assert out_of_range(planned(bold), bold) == ""
    assert out_of_range(replace(planned(bold), h=0.21), bold)
