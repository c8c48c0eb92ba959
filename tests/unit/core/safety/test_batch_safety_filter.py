"""What one agent flies and what a study flies is the same: the filter for one and for many."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.arrays import Bools, Complex, Floats
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import Plan, Response, Safety
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.safety.batch_safety_filter import (
    BatchHeard,
    BatchLinks,
    BatchPeers,
    BatchSafetyFilter,
)
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot
from swarm_ctl.mission.compile.loader import load

HEXAGON: Plan = load(Path(__file__).parents[4] / "missions" / "hexagon.yaml").plan
SPEED = 1.0
PLAN = replace(HEXAGON, unit_m=1.0, limits=replace(HEXAGON.limits, speed_mps=SPEED))
"""A metre a unit: tolerances of the quadratic program are absolute, so both count in one unit."""
N, M, SCENE, SCENES = 4, 2, 25, 6
ANY_STATE = AgentState(
    0, 0, 0.0, 0, Phase.FLY, 1, False, True, (0.0,) * 3, (0.0,) * 3, (0.0,) * 2, (0.0,) * 2
)
"""A peer was heard; the filter reads the snapshot's own fields."""
MODEL = Response(dead_time_s=0.4, lag_s=0.5)
AGES_S = (0.0, 0.0, 0.05, 0.2, 0.45, 0.5, 0.6, 0.95, 1.0, 1.2, 3.5)


@dataclass
class State:
    """One tick of M swarms of N agents, in units; told: (N receivers, N senders, M)."""

    own: Complex
    told: Complex
    setpoint: Complex
    age_s: Floats
    yields: Bools
    consensus: Complex
    avoidance: Complex
    slots: Complex
    told_slots: Complex
    linked: Bools
    doubt_s: Floats
    """Each agent's of its own response."""
    response_s: Floats
    """Each agent's own, which the others are told."""

    @property
    def fresh(self) -> Bools:
        return np.asarray(self.age_s <= FRESH_S)


def vectors(random: np.random.Generator, size: float, *shape: int) -> Complex:
    """In a square of this size around zero."""
    return np.asarray(random.uniform(-size, size, shape) + 1j * random.uniform(-size, size, shape))


def row(random: np.random.Generator) -> Complex:
    """Agents one behind the other, many of them nearly r (4.5) apart."""
    apart = random.choice([2.5, 4.2, 4.3, 4.6, 5.5], (N, M))
    return np.asarray(np.cumsum(apart, axis=0) + vectors(random, 0.1, N, M))


def states(seed: int) -> list[State]:
    """Scenes of some seconds: each has its places and wishes, so that agents get stuck; ages, and
    what was told, change every tick."""
    random, responses = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    found = []
    for _ in range(SCENES):
        crowd = vectors(random, random.choice([0.6, 1.2, 2.5]), N, M)
        own, to = random.choice([crowd, row(random)]), vectors(random, SPEED, N, M)
        linked = np.triu(random.random((M, N, N)) < 0.7, 1)
        linked = np.moveaxis(linked | linked.transpose(0, 2, 1), 0, -1)
        slots = row(random)
        told_slots = np.repeat(slots[None], N, axis=0)
        stale = random.random((N, N, M)) < 0.2
        told_slots = np.where(stale, row(random)[None], told_slots)
        yields = random.random((N, M)) < 0.8
        for _ in range(SCENE):
            age_s = random.choice(AGES_S, (N, N, M))
            told = own[None] + 0.3 * age_s * vectors(random, 1.0, N, N, M)
            setpoint = vectors(random, 0.7 * SPEED, N, N, M) * (random.random((N, N, M)) < 0.8)
            avoidance = vectors(random, SPEED, N, M) * (random.random((N, M)) < 0.5)
            willing = (age_s <= FRESH_S) & yields[None]
            own_response = (
                responses.uniform(0.05, 0.5, (N, M)),
                responses.uniform(0.3, 1.5, (N, M)),
            )
            found.append(
                State(
                    *(own, told, setpoint, age_s, willing, to, avoidance, slots, told_slots),
                    *(linked, *own_response),
                )
            )
    return found


def together(state: State, filter_: BatchSafetyFilter, links: BatchLinks) -> Complex:
    """What the study's filter flies, (N, M)."""
    told_s = np.broadcast_to(state.response_s, state.age_s.shape)
    heard = BatchHeard(state.setpoint, state.age_s, state.fresh, state.yields, told_s)
    own, told = _planes(state.own), _planes(state.told)
    peers = BatchPeers(own, told, heard, state.doubt_s, state.response_s)
    return filter_.velocity(state.consensus, state.avoidance, peers, links)


def _planes(vectors: Complex) -> Floats:
    return np.stack((vectors.real, vectors.imag))


def alone(state: State, filter_: SafetyFilter, i: int, k: int, formation: Formation) -> complex:
    """What agent i of swarm k flies by its own filter."""
    peers = tuple(aircraft(state, i, j, k) for j in range(N) if j != i)
    late_s = float(state.response_s[i, k]) - MODEL.dead_time_s - MODEL.lag_s
    filter_.estimate.estimate = filter_.estimate.estimate._replace(
        doubt_s=float(state.doubt_s[i, k]), late_s=late_s
    )
    return filter_.velocity(
        PeerSnapshot(0.0, peers),
        complex(state.own[i, k]),
        complex(state.consensus[i, k]),
        complex(state.avoidance[i, k]),
        formation,
    )


def aircraft(state: State, i: int, j: int, k: int) -> OtherAircraft:
    age_s = float(state.age_s[i, j, k])
    return OtherAircraft(
        id=j + 1,
        state=ANY_STATE,
        stop_point=complex(state.told[i, j, k]),
        setpoint=complex(state.setpoint[i, j, k]),
        age_s=age_s,
        age_at_most_s=age_s,
        fresh=age_s <= FRESH_S,
        followed=age_s <= NEIGHBOUR_S,
        yields=bool(state.yields[i, j, k]),
        formation=("all", 1, 0),
        response_s=float(state.response_s[j, k]),
    )


def formation_of(state: State, i: int, k: int) -> Formation:
    slots = {j + 1: state.told_slots[i, j, k] for j in range(N)} | {i + 1: state.slots[i, k]}
    neighbours = frozenset((np.flatnonzero(state.linked[i, :, k]) + 1).tolist())
    return Formation({j: (z.real, z.imag) for j, z in slots.items()}, neighbours, 0j, ("all", 1, 0))


def fly_both(seed: int, safety: Safety) -> tuple[BatchSafetyFilter, int]:
    """Fly a sequence both ways and compare each tick; the study's filter, and its agent-ticks of
    excluding keep-outs."""
    plan = replace(PLAN, safety=safety)
    ids = np.repeat(1 + np.arange(N)[:, None], M, axis=1)
    margins = Margins.of(PLAN.law, MODEL, SPEED, PLAN.unit_m)
    many = BatchSafetyFilter(safety, PLAN.law, margins, PLAN.tick_s, ids)
    places = list(itertools.product(range(N), range(M)))
    ones = {
        place: SafetyFilter(plan, place[0] + 1, MODEL, OwnResponse(MODEL, plan.tick_s))
        for place in places
    }
    yielded, before = 0, None
    for state in states(seed):
        if before is None or state.slots is not before.slots:
            links = BatchLinks(state.linked, state.slots, state.told_slots)
            formations = {(i, k): formation_of(state, i, k) for i, k in places}
        before = state
        flown = together(state, many, links)
        for i, k in places:
            one = alone(state, ones[i, k], i, k, formations[i, k])
            assert abs(one - flown[i, k]) < 1e-9
        yielded += np.count_nonzero(many.yielded)
    for (i, k), one in ones.items():
        assert one.release.fails == many.release.fails[i, k]
    return many, yielded


@settings(max_examples=6, deadline=None)  # half a second each
@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
def test_one_agent_and_many_fly_alike(seed: int, guard: bool, release: bool) -> None:
    """Velocities of whole sequences agree to 1e-9 of a unit/s: several swarms, silent peers, peers
    that do not yield, late news, tight and over-long links, releases that begin and run."""
    fly_both(seed, Safety(True, guard, release, False))


def test_the_states_are_hard_enough() -> None:
    """Agents are released, and keep-outs exclude each other, in the sequences that are compared."""
    many, yielded = fly_both(1, Safety())
    assert many.release.fails.sum() > 5
    assert yielded > 20
