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
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.messages import AgentState, ExchangeState, Phase
from swarm_ctl.core.model.plan import Plan, Point, Safety
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.swarm.exchange_protocol import ExchangeStates
from swarm_ctl.core.swarm.hearing import Hearing
from swarm_ctl.core.swarm.slot_exchange import SlotExchange
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import _BatchFlight
from swarm_ctl.study.batch.batch_slot_exchange import BatchSlotExchange
from swarm_ctl.study.batch.lossy_channel import HeardStates, LossyChannel
from swarm_ctl.study.parameter_space import Range, Study, value
from tests.on_demand import on_demand

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
    i: int, heard: HeardStates, receiver: int, k: int, response_s: float = 0.0
) -> OtherAircraft:
    """What agent `receiver` of mission k knows of agent i."""
    row = receiver if heard.points.shape[1] > 1 else 0
    at, setpoint = heard.points[:, row, i, k], heard.velocity[:, row, i, k]
    age_s = float(heard.age_s[row, i, k])
    late_s = heard.late_s if isinstance(heard.late_s, float) else float(heard.late_s[row, i, k])
    state = state_of(i, at, setpoint)
    fresh, followed = age_s <= FRESH_S + late_s, age_s <= NEIGHBOUR_S + late_s
    return OtherAircraft(
        *(IDS[i], state, complex(*at), complex(*at), complex(*setpoint), age_s, age_s),
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


def formation(flight: _BatchFlight, i: int, k: int) -> Formation:
    """As agent i hears of it; the same object for as long as the slots last."""
    told = flight._told_slots[:, min(i, flight._told_slots.shape[1] - 1), :, k]
    slots: dict[int, Point] = {IDS[j]: (told[0, j], told[1, j]) for j in range(told.shape[1])}
    slots[IDS[i]] = (flight._slots[0, i, k], flight._slots[1, i, k])
    near = frozenset(IDS[j] for j in np.flatnonzero(flight._neighbours[i, :, k]))
    return Formation(slots, near, 0j, ("all", 1, 0))


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
    start: str,
    slots: str,
    safety: str,
    vehicle: str,
    seed: int,
    n: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Law, average, swirl, release, filter: to 1e-9, with late and lost news and silent agents; the
    law's rate is bounded where the vehicle is slow. Agents of a large swarm find the same peers
    near, and say their far words at the same ticks."""
    asked = {"start": start, "slots": slots, "safety": safety, "vehicle": vehicle, "seed": seed}
    batch = missions(n=(n,), **asked)
    cell, flight, heard = batch.cell, _BatchFlight(batch), list[HeardStates]()
    assert flight._channel is not None
    inner = flight._channel.exchange

    def overheard(*sent: Any) -> HeardStates:
        heard.append(inner(*sent))
        return heard[-1]

    monkeypatch.setattr(flight._channel, "exchange", overheard)
    plan = replace(
        HEXAGON,
        unit_m=1.0,
        law=replace(cell.law, h=0.2),
        kappa=20.0,
        safety=Safety(align=cell.has("align")),
        agents=tuple(replace(HEXAGON.agents[0], id=IDS[i]) for i in range(n)),
        limits=replace(HEXAGON.limits, speed_mps=cell.speed_mps),
    )
    # of a large swarm, some of the agents
    some = range(0, n, max(1, n // N))
    agents = {(i, k): Controller(plan, IDS[i], cell.model) for i in some for k in range(MISSIONS)}
    reach_m = agents[0, 0].safety_filter.reach_m
    hearings = {(i, k): Hearing(plan, IDS[i], reach_m) for i, k in agents if n > N}
    formations: dict[tuple[int, int], Formation] = {}
    near, came, went = np.zeros(0, dtype=np.bool_), 0, 0
    for tick in range(160):
        points, live, told = flight._motion.points(), tick < flight._silent_from, flight._told_slots
        wish, _ = flight._wish(tick, points, live)
        response_s = flight._motion.response_s
        if not formations or told is not flight._told_slots:
            formations = {(i, k): formation(flight, i, k) for i, k in agents}
        for (i, k), agent in agents.items():
            if not live[i, k]:
                continue
            agent.stop_point_m = agent.point_m = (float(points[0, i, k]), float(points[1, i, k]))
            late_s = response_s[i, k] - cell.model.dead_time_s - cell.model.lag_s
            agent.estimate.estimate = agent.estimate.estimate._replace(
                doubt_s=float(flight._motion.doubt_s[i, k]), late_s=float(late_s)
            )
            others = tuple(peer(j, heard[-1], i, k, response_s[j, k]) for j in range(n) if j != i)
            if hearings:
                hold_hearing(flight, hearings[i, k], tick, (i, k), points, others)
            flown = agent.form(PeerSnapshot(0.0, others), formations[i, k])
            assert flown == pytest.approx(tuple(wish[:, i, k]), abs=1e-9)
        flight._motion.move(flight._without_the_silent(tick, wish, live))
        if flight._hearing is not None:
            before, near = near if tick else flight._hearing.near, flight._hearing.near.copy()
            came += int(np.count_nonzero(near & ~before))
            went += int(np.count_nonzero(before & ~near))
    assert flight._touched.sum() > 100
    assert n == N or (came > 10 and went > 10 and not near.all())


def hold_hearing(
    flight: _BatchFlight,
    hearing: Hearing,
    tick: int,
    agent: tuple[int, int],
    points: Floats,
    others: tuple[OtherAircraft, ...],
) -> None:
    """The agent's near peers, and its far words, are the study's."""
    assert flight._hearing is not None
    (i, k), now, n = agent, tick * flight._cell.tick_s, points.shape[1]
    heard = [SimpleNamespace(id=o.id, state=o.state, earliest_s=now - o.age_s) for o in others]
    always = {IDS[j] for j in np.flatnonzero(flight._hearing._always[i, :, k])}
    own = (float(points[0, i, k]), float(points[1, i, k]))
    near = hearing.look(now, own, heard, always)
    if near is not None:
        assert near == {IDS[j] for j in np.flatnonzero(flight._hearing.near[i, :, k])} - {IDS[i]}
    strangers = ~flight._hearing.near[:, i, k]
    strangers &= flight._hearing.hears(np.full((1, n, 1), tick))[:, i, k]
    # all agents speak when they begin to hear
    assert hearing.says(now) == strangers.any() or tick == 0


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
    tick_s, random = 0.0625, np.random.default_rng(seed)  # four ticks are a look, exactly
    batch = missions(n=(N,), slots=("random",), seed=seed, tick_s=tick_s, kappa=value(16.0))
    study, channel = BatchSlotExchange(batch), LossyChannel(batch, tick_s)
    plan = replace(HEXAGON, unit_m=1.0, law=batch.cell.law)
    told = {(i, k): _Told(IDS[i]) for i in range(N) for k in range(MISSIONS)}
    agents = {(i, k): SlotExchange(plan, plan.group, IDS[i], told[i, k]) for i, k in told}  # type: ignore[arg-type]
    links = [
        {IDS[i]: tuple(IDS[j] for j in np.flatnonzero(batch.links[i, :, k])) for i in range(N)}
        for k in range(MISSIONS)
    ]
    for (_, k), agent in agents.items():
        agent.begin([(float(z[0]), float(z[1])) for z in batch.slots[:, :, k].T])
    said = [{place: agent.exchange for place, agent in agents.items()}]
    points, live_until = batch.starts.copy(), batch.silent_from(tick_s)
    for tick in range(160):
        live = tick < live_until
        velocity = random.uniform(-0.5, 0.5, points.shape)
        heard = channel.exchange(tick, points, velocity)
        assert study.look(tick, points, heard, live) == (tick % 4 == 0)
        for (i, k), agent in agents.items():
            for j in range(N):
                view = peer(j, heard, i, k)
                sent = max(0, tick - round(view.age_s / tick_s))
                assert view.state is not None
                state = state_of(
                    j, view.state.stop_point_m, view.state.setpoint_mps, said[sent][j, k]
                )
                told[i, k].known[IDS[j]] = (state, view.age_s)
            if live[i, k]:
                agent.hear()
                own = (float(points[0, i, k]), float(points[1, i, k]))
                agent.look(tick * tick_s, own, ("all", 1, 0), links[k], new=True)
            for name in ExchangeStates.__dataclass_fields__:
                theirs = getattr(study._exchange.states, name)[i, k]
                assert getattr(agent.exchange, name) == theirs, (tick, i, k, name)
        said.append({place: agent.exchange for place, agent in agents.items()})
        error = points - study.slots
        pull = error.mean(axis=1, keepdims=True) - error
        points = points + 0.1 * tick_s * pull + tick_s * velocity
    assert study.count.sum() > 0
