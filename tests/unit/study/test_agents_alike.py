"""A study flies what agents fly: the same setpoints and the same slot exchanges, tick by tick."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.kernel.exchange import Said
from swarm_ctl.core.model.messages import AgentState, ExchangeState, Phase
from swarm_ctl.core.model.plan import Plan, Point, Safety
from swarm_ctl.core.model.timeouts import FAR_LATE_S, FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.swarm.hearing import Hearing
from swarm_ctl.core.swarm.slot_exchange import SlotExchange
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.batch import flight
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.parameter_space import Range, Study, value
from tests.on_demand import on_demand
from tests.unit.study.flown import Flown

HEXAGON: Plan = load(Path(__file__).parents[3] / "missions" / "hexagon.yaml").plan
N, MISSIONS = len(HEXAGON.agents), 3
IDS = range(1, 21)
LATE: dict[str, Any] = {
    "missions": MISSIONS,
    "unit_m": 1.0,
    "speed_mps": 1.0,
    "acceleration_mps2": 0.6,
    "h": value(0.2),
    "delay_s": (Range(low=0.05, high=0.3),),
    "loss": (Range(low=0.0, high=0.4),),
    "silent": value(0.5),
}
"""A metre a unit: tolerances of the quadratic program are absolute."""


def missions(**settings_: Any) -> Batch:
    """A small study; agents die soon."""
    ((cell, first, count),) = blocks(Study.model_validate(LATE | settings_))
    batch = draw(cell, first, count)
    return replace(batch, silent_s=batch.silent_s / 4)


def peer(
    flown: Flown, k: int, i: int, j: int, exchange: ExchangeState | None = None
) -> OtherAircraft:
    """What agent i of mission k knows of agent j."""
    q, setup = flown.pair[k, i, j], flown.setup
    at, setpoint = complex(q.told), complex(q.flies)
    age_s = float((flown.tick - q.sent_at) * setup.tick_s)
    far = setup.far and q.heard_from > flight.since(setup, flown.tick)
    late_s = FAR_LATE_S if far else 0.0
    fresh, followed = age_s <= FRESH_S + late_s, age_s <= NEIGHBOUR_S + late_s
    state = state_of(j, (at.real, at.imag), (setpoint.real, setpoint.imag), exchange)
    response_s = setup.model.dead_time_s + setup.model.lag_s + float(flown.agent[k, j].late_s)
    return OtherAircraft(
        *(IDS[j], state, at, at, setpoint, age_s, age_s),
        *(fresh, followed, age_s <= FRESH_S, ("all", 1, 0) if fresh else None),
        response_s=response_s,
        far=late_s > 0.0,
        true_s=-age_s,
    )


def state_of(i: int, at: Any, setpoint: Any, exchange: ExchangeState | None = None) -> AgentState:
    place, told = (float(at[0]), float(at[1])), (float(setpoint[0]), float(setpoint[1]))
    return AgentState(
        *(IDS[i], 0, 0.0, 0, Phase.FLY, 1, False, True, (*place, -8.0), (0.0, 0.0, 0.0)),
        *(place, told),
        exchange=exchange or ExchangeState(role=i),
    )


def formation(flown: Flown, k: int, i: int) -> Formation:
    """As agent i of mission k hears of it; the same object for as long as the slots last."""
    slots = {IDS[j]: plane(q.slot) for j, q in enumerate(flown.pair[k, i])}
    slots[IDS[i]] = plane(flown.agent[k, i].slot)
    near = frozenset(IDS[j] for j in np.flatnonzero(flown.pair["link"][k, i]))
    return Formation(slots, near, 0j, ("all", 1, 0))


def plane(vector: complex) -> Point:
    return (float(vector.real), float(vector.imag))


@pytest.mark.parametrize(
    ("start", "slots", "safety", "vehicle", "seed", "n"),
    [
        # the average of all is in the row of PX4, lag in that of release
        on_demand("crossing", "given", "align", "lag", 1, N),
        ("antipodal", "given", "release", "lag", 3, N),
        # exchange and lag are in the last row
        on_demand("random", "random", "exchange", "lag", 2, N),
        ("crossing", "given", "align", "px4", 4, N),
        ("random", "random", "exchange", "lag", 6, 20),
    ],
)
def test_a_study_commands_what_agents_command(
    start: str, slots: str, safety: str, vehicle: str, seed: int, n: int
) -> None:
    """Law, average, swirl, release, filter: to 1e-9, with late and lost news and silent agents; the
    law's rate is bounded where the vehicle is slow. Agents of a large swarm find the same peers
    near, and say their far words at the same ticks."""
    asked = {"start": start, "slots": slots, "safety": safety, "vehicle": vehicle, "seed": seed}
    batch = missions(n=(n,), **asked)
    cell, flown = batch.cell, Flown(batch)
    agents = tuple(replace(HEXAGON.agents[0], id=IDS[i]) for i in range(n))
    plan = replace(
        HEXAGON,
        unit_m=1.0,
        law=replace(cell.law, h=0.2),
        kappa=20.0,
        safety=Safety(align=cell.has("align")),
        groups=(replace(HEXAGON.groups[0], agents=agents),),
        limits=replace(HEXAGON.limits, speed_mps=cell.speed_mps),
    )
    # of a large swarm, some of the agents
    some = range(0, n, max(1, n // N))
    agents = {(k, i): Controller(plan, IDS[i], cell.model) for i in some for k in range(MISSIONS)}
    reach_m = agents[0, 0].safety_filter.reach_m
    hearings = {(k, i): Hearing(plan, IDS[i], reach_m) for k, i in agents if n > N}
    formations: dict[tuple[int, int], Formation] = {}
    slots, came, went = np.zeros(0), 0, 0
    for tick in range(160):
        flown.decide()
        now_flown = np.concatenate([flown.pair["slot"], flown.agent["slot"][:, None]], axis=1)
        if not np.array_equal(slots, now_flown):
            slots = now_flown
            formations = {(k, i): formation(flown, k, i) for k, i in agents}
        wishes: dict[tuple[int, int], Point] = {}
        for (k, i), agent in agents.items():
            a = flown.agent[k, i]
            if tick >= a.silent_from:
                continue
            agent.stop_point_m = agent.point_m = plane(a.point)
            agent.estimate.estimate = agent.estimate.estimate._replace(
                doubt_s=float(a.doubt_s), late_s=float(a.late_s)
            )
            others = tuple(peer(flown, k, i, j) for j in range(n) if j != i)
            wishes[k, i] = agent.form(PeerSnapshot(0.0, others), formations[k, i])
        flown.stage(flight.ACT)
        for place, wish in wishes.items():
            assert wish == pytest.approx(plane(flown.agent[place].wish), abs=1e-9)
        known = {(k, i): [peer(flown, k, i, j) for j in range(n) if j != i] for k, i in hearings}
        before, now = flown.pair["near"].copy(), flown.tick
        flown.end()
        for place, others_ in known.items():
            if place in wishes:
                hold_hearing(flown, hearings[place], now, place, others_)
        came += int(np.count_nonzero(flown.pair["near"] & ~before))
        went += int(np.count_nonzero(before & ~flown.pair["near"]))
    assert flown.many.whole["touched"].sum() > 100
    assert n == N or (came > 10 and went > 10 and not flown.pair["near"].all())


def hold_hearing(
    flown: Flown, hearing: Hearing, tick: int, agent: tuple[int, int], others: list[OtherAircraft]
) -> None:
    """The agent's near peers, and its far words, are the study's."""
    (k, i), now = agent, tick * flown.setup.tick_s
    heard = [SimpleNamespace(id=o.id, state=o.state, earliest_s=now - o.age_s) for o in others]
    always = {IDS[j] for j in np.flatnonzero(flown.pair["always"][k, i])}
    near = hearing.look(now, plane(flown.agent[k, i].point), heard, always)
    if near is not None:
        assert near == {IDS[j] for j in np.flatnonzero(flown.pair["near"][k, i])} - {IDS[i]}
    # all agents speak when they begin to hear
    assert hearing.says(now) == ((tick + i) % flown.setup.word == 0) or tick == 0


class _Told:
    """What one agent has heard; stands in for `Peers`, with clocks that are known exactly."""

    def __init__(self, own: int) -> None:
        self.own, self.known = own, dict[int, tuple[AgentState, float]]()

    def __iter__(self) -> Any:
        others = (i for i in IDS[:N] if i != self.own)
        return iter([SimpleNamespace(id=i, state=self.state(i)) for i in others])

    def state(self, agent: int) -> AgentState | None:
        return self.known[agent][0] if agent in self.known else None

    def age(self, agent: int, now: float) -> float:
        del now
        return self.known[agent][1]

    def late_s(self, agent: int, now: float) -> float:
        del agent, now
        return 0.0


@settings(max_examples=4, deadline=None)  # each of them is many missions: half a second
@given(st.integers(0, 1000))
def test_a_study_exchanges_what_agents_exchange(seed: int) -> None:
    """Offers, locks, answers and roles are the same after every look, whatever is late, lost or
    silent."""
    tick_s = 0.0625  # four ticks are a look, exactly
    batch = missions(
        n=(N,), slots=("random",), seed=seed, tick_s=tick_s, kappa=value(16.0), safety="exchange"
    )
    flown = Flown(batch)
    plan = replace(HEXAGON, unit_m=1.0, law=batch.cell.law)
    told = {(k, i): _Told(IDS[i]) for i in range(N) for k in range(MISSIONS)}
    agents = {(k, i): SlotExchange(plan, plan.groups[0], IDS[i], told[k, i]) for k, i in told}  # type: ignore[arg-type]
    links = [
        {IDS[i]: tuple(IDS[j] for j in np.flatnonzero(batch.links[i, :, k])) for i in range(N)}
        for k in range(MISSIONS)
    ]
    for (k, _), agent in agents.items():
        agent.begin([(float(z[0]), float(z[1])) for z in batch.slots[:, :, k].T])
    said = [{place: agent.exchange for place, agent in agents.items()}]
    for tick in range(160):
        flown.decide()
        for (k, i), agent in agents.items():
            for j in range(N):
                q = flown.pair[k, i, j]
                known = peer(flown, k, i, j, said[max(0, q.sent_at)][k, j])
                assert known.state is not None
                told[k, i].known[IDS[j]] = (known.state, known.age_s)
            a = flown.agent[k, i]
            if tick < a.silent_from:
                agent.hear()
                agent.look(tick * tick_s, plane(a.point), ("all", 1, 0), links[k], new=True)
            theirs = Said(*flown.many.said[k, i].tolist())
            assert agent.exchange == ExchangeState(**theirs._asdict()), (tick, i, k)
        said.append({place: agent.exchange for place, agent in agents.items()})
        flown.stage(flight.ACT)
        flown.end()
    assert sum(len(agent.taken) for agent in agents.values()) == flown.many.whole["exchanged"].sum()
