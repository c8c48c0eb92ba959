"""N_i of one agent: chosen by steps, bridged where an agent is lost, reported when it changes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.messages import Severity
from swarm_ctl.core.model.plan import AgentPlan, Plan
from swarm_ctl.core.swarm.neighbourhood import Neighbourhood
from tests.unit.core.builders import NOW, peer, plan, snapshot
from tests.unit.plans import with_group

FIVE = (1, 2, 3, 4, 5)
CHAIN = {1: (2,), 2: (1, 3), 3: (2, 4), 4: (3, 5), 5: (4,)}


def chain() -> Plan:
    """Five agents in a row, each with the one before and the one after it."""
    agents = tuple(AgentPlan(i, (0.0, 5.0 * i), CHAIN[i]) for i in FIVE)
    return with_group(plan(), agents=agents)


def of(agent: int) -> Neighbourhood:
    return Neighbourhood(chain().groups[0], agent)


@given(st.sets(st.sampled_from((1, 2, 4, 5))))
def test_the_survivors_stay_connected(lost: set[int]) -> None:
    middle = of(3)
    middle.lose(lost)
    assert set(middle.links) == set(FIVE) - lost
    assert len(graph.components(middle.links)) == 1


@given(st.sets(st.sampled_from(FIVE), max_size=4))
def test_all_survivors_have_the_same_graph(lost: set[int]) -> None:
    """Each works it out by itself, from the same lost agents."""
    alive = [of(agent) for agent in FIVE if agent not in lost]
    for each in alive:
        each.lose(lost)
    assert all(each.links == alive[0].links for each in alive)


@pytest.mark.parametrize(
    ("agent", "silent", "said"),
    [
        (3, {4}, "neighbour 4 is not heard; the graph falls apart: (1, 2, 3) | (5,)"),
        (1, {2}, "neighbour 2 is not heard; the graph falls apart: (1,) | (3, 4, 5)"),
        (3, {2, 4}, "neighbours 2, 4 are not heard; the graph falls apart: (1,) | (3,) | (5,)"),
        (3, {1}, ""),
        (3, set(), ""),
    ],
    ids=["in the middle", "at the end", "both", "no neighbour", "all are heard"],
)
def test_a_silent_neighbour_is_reported(agent: int, silent: set[int], said: str) -> None:
    """Once, with what it does to the graph; and when it is heard again."""
    own = of(agent)
    others = [i for i in FIVE if i != agent]
    all_heard = snapshot(*(peer(i) for i in others), now=NOW + 2.0)
    some = snapshot(*(peer(i, 2.0 if i in silent else 0.1) for i in others), now=NOW + 2.0)
    assert own.watch(snapshot(*(peer(i) for i in others))) == []
    assert own.watch(some) == ([(Severity.WARNING, said)] if said else [])
    assert own.watch(some) == []
    back = [(Severity.INFO, f"neighbour {i} is heard again") for i in sorted(silent)]
    assert own.watch(all_heard) == (back if said else [])
