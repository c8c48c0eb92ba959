"""Which exchange of slots is legal, for any swarm."""

from __future__ import annotations

from itertools import combinations, pairwise

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.exchange import (
    EVERY_S,
    NO_PART,
    Shape,
    gain,
    legal,
    nothing_said,
    ranks,
    took_part,
)

AGENTS = 5
GRID = [complex(x, y) for x in range(4) for y in range(3)]
REACH = 1.5
"""Of a link: a slot is linked to eight around it."""
PAIRS = list(combinations(range(AGENTS), 2))


def connected(links: set[frozenset[int]]) -> bool:
    found, new = {0}, {0}
    while new:
        new = {j for i in new for j in range(AGENTS) if frozenset((i, j)) in links} - found
        found |= new
    return len(found) == AGENTS


@given(
    st.lists(st.sampled_from(GRID), min_size=AGENTS, max_size=AGENTS, unique=True),
    st.permutations(range(AGENTS)),
    st.sets(st.sampled_from(PAIRS), min_size=4),
    st.sampled_from(PAIRS),
    st.booleans(),
)
def test_an_exchange_is_legal_that_keeps_each_link_or_bridges_it(
    slots: list[complex],
    roles: list[int],
    linked: set[tuple[int, int]],
    pair: tuple[int, int],
    upwards: bool,
) -> None:
    """By the links of the two alone: each that fits in r still does, or a path of two is left. So a
    swarm that was connected stays so."""
    me, partner = pair if upwards else pair[::-1]
    links = [[tuple(sorted((i, j))) in linked for j in range(AGENTS)] for i in range(AGENTS)]
    told = [nothing_said(role) for role in roles]
    told[me] = nothing_said(roles[partner])  # what it told once counts for nothing
    shape = Shape(slots, links, ranks(AGENTS), REACH / 0.98)

    def fitting(of: list[int]) -> set[frozenset[int]]:
        near = (abs(slots[of[i]] - slots[of[j]]) <= REACH for i, j in PAIRS)
        return {frozenset(p) for p, fits in zip(PAIRS, near, strict=True) if fits and p in linked}

    swapped = list(roles)
    swapped[me], swapped[partner] = roles[partner], roles[me]
    before, then = fitting(list(roles)), fitting(swapped)
    kept = all(
        link in then or any({frozenset((i, k)), frozenset((k, j))} <= then for k in range(AGENTS))
        for link in before
        if link & {me, partner}
        for i, j in [sorted(link)]
    )
    assert legal(me, roles[me], partner, told, shape) == kept
    if kept and connected(before):
        assert connected(then)


def test_what_an_exchange_brings() -> None:
    """Less than nothing where both come nearer to their slots by it."""
    shape = Shape([0j, 3 + 4j], [], [], 9.0)
    assert gain(nothing_said(1), 1 + 2j, shape, 0) == -11.0
    assert gain(nothing_said(0), 1 + 2j, shape, 1) == 11.0


ROLES = st.integers(0, AGENTS - 1)


@given(
    st.lists(ROLES, min_size=AGENTS, max_size=AGENTS),
    st.lists(st.booleans(), min_size=AGENTS, max_size=AGENTS),
    ROLES,
    st.integers(0, 12),
    st.integers(0, 12),
)
def test_the_higher_of_two_with_one_role_takes_a_free_one(
    roles: list[int], fresh: list[bool], me: int, silent: int, busy: int
) -> None:
    """After two seconds in which it heard the other one in each round (not in round `silent`) and
    had nothing else to end (from round `busy` on); then the lowest that nobody is known to have."""
    told, shape = [nothing_said(role) for role in roles], Shape([], [], ranks(AGENTS), 1.0)
    said, part = told[me], NO_PART._replace(quiet_s=busy * EVERY_S)
    nobody = [False] * AGENTS
    heard = [here and j != me for j, here in enumerate(fresh)]
    twin = any(heard[j] and roles[j] == roles[me] for j in range(me))
    first = busy if silent > busy + 8 else max(busy, silent + 1)
    free = min(set(range(AGENTS)) - set(roles), default=-1)
    for k in range(24):
        said, part = took_part(
            *(k * EVERY_S, me, said, part, shape, [0j] * AGENTS, told),
            *([0.0] * AGENTS, nobody if k == silent else heard, False),
        )
        took = twin and k >= first + 8
        assert (said.role, said.version) == ((free, 1) if took else (roles[me], 0))


def test_ranks_of_locks_are_a_permutation_that_follows_no_ids() -> None:
    for n in (1, 2, 50, 250):
        assert sorted(ranks(n)) == list(range(n))
    neighbours = ranks(250)
    assert sum(a < b for a, b in pairwise(neighbours)) < 200
