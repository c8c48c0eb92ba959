"""Two agents that are in each other's way exchange their slots: only the shape counts, not which
agent stands where.

An exchange of i and j lowers the sum of all squared distances to the slots iff `(s_i - s_j) . (z_i
- z_j) < 0`, wherever the shape as a whole stands. Each agent plays a *role*: the place in the
plan's list of agents whose slots it takes. An exchange swaps two roles, for this step and all that
follow. It takes one offer and one answer:

1. The lower i offers to j. The offer names j's version (its number of exchanges so far), so it
   cannot be taken twice.
2. j waits until all agents that may be concerned have heard of it, looks again, takes i's role and
   answers. The answer names i's version, and j repeats it until i has moved on.
3. i takes j's old role as soon as it hears the answer, even if it has withdrawn the offer: its
   version still fits.

A lost or repeated message delays, and changes nothing. Between 2 and 3 two agents have one role for
a moment, which costs nothing: they are kept apart as always.

An agent in an exchange shows a lock, the id of the agent that offers. An agent withdraws from its
exchange if a link neighbour shows a lock of lower rank: no two exchanges loosen the same links at
once. A link whose slots fit in r must fit after an exchange as well, or its two ends must have a
common neighbour whose links to both fit: the swarm stays connected. Should two agents be left with
one role (the news of one was lost for seconds), the higher id takes a role that is free.

Agents are named by their place 0..n-1 in the plan; -1 is none. Lengths in units.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

EVERY_S: Final = 0.25
"""Between two rounds of the protocol."""
WORTH: Final = -0.05
"""[units^2]: what an exchange must bring."""
_WAIT_S: Final = 1.0
"""From an offer to its answer: news is at most half a second old each way, or it does not count."""
_OFFER_S: Final = 4.0
"""An offer that is not answered is withdrawn ..."""
_QUIET_S: Final = 1.5
"""... and nothing new is begun before its answer must have been heard."""
_HEARD_S: Final = 0.5
"""Agents whose news is older take no part (`fresh`)."""
GONE_S: Final = 3.0
"""An answer is repeated no longer for an agent that is not heard."""
_TWINS_S: Final = 2.0
"""Two agents that have one role for so long do not come out of it by themselves."""
_WITHIN: Final = 0.98
"""In r: slots so close are a link that fits."""
_NONE: Final = -1
_TRIES: Final = 3
"""Partners looked at, best first."""


class Said(NamedTuple):
    """What an agent says of its exchanges."""

    role: int
    version: int
    lock: int
    offer_to: int
    offer_version: int
    answer_to: int
    answer_version: int
    answer_role: int


class Part(NamedTuple):
    """What it keeps to itself."""

    since_s: float
    """Its own offer stands, or that of `partner` is considered, since then."""
    quiet_s: float
    """It begins nothing new before."""
    partner: int
    """The agent whose offer is considered."""
    twins_s: float
    """Another agent has the own role since then."""


NO_PART: Final = Part(0.0, -math.inf, _NONE, math.inf)


class Shape(NamedTuple):
    """What is exchanged: slots by role [units], who is linked to whom, and r."""

    slots: Any
    """Complex numbers, in a list or an array; so the next two."""
    links: Any
    rank: Any
    """Of locks."""
    r: float


def nothing_said(role: int) -> Said:
    """No exchange yet."""
    return Said(
        role=role,
        version=0,
        lock=_NONE,
        offer_to=_NONE,
        offer_version=_NONE,
        answer_to=_NONE,
        answer_version=_NONE,
        answer_role=_NONE,
    )


def ranks(n: int) -> list[int]:
    """Of the locks of n agents. Any order will do that does not follow the ids: else whole rows
    would wait for one another."""
    order = sorted(range(n), key=lambda k: (k * 7919 + 3001) % 10007)
    found = [0] * n
    for place, k in enumerate(order):
        found[k] = place
    return found


def took_part(
    now: float,
    me: int,
    said: Said,
    part: Part,
    shape: Shape,
    apart: Sequence[complex],
    told: Sequence[Said],
    age_s: Sequence[float],
    fresh: Sequence[bool],
    new: bool,
) -> tuple[Said, Part]:
    """One round: take part in what goes on.

    Args:
        now: mission time [s].
        me: who decides.
        said: what it says.
        part: what it keeps to itself.
        shape: what is exchanged.
        apart: own stop point minus those of all n agents, as heard.
        told: what they said.
        age_s: of it.
        fresh: heard within `_HEARD_S`, and flying the same shape; false for oneself.
        new: it offers and takes offers; otherwise it ends what it has begun.
    """
    n = len(told)
    # 3: another agent has taken the own role
    for j in range(n):
        if told[j].answer_to == me and told[j].answer_version == said.version:
            said, part = _ended(_taken(said, told[j].answer_role), part)
            part = Part(part.since_s, now, part.partner, part.twins_s)
            break
    # no agent needs the own last answer any more
    to = said.answer_to
    settled = to < 0 or told[to].version != said.answer_version or age_s[to] > GONE_S
    settled = settled and now >= part.quiet_s
    said, part = _repaired(now, me, said, part, told, fresh, settled)
    lowest = _lowest_lock(me, said, part, shape, told, fresh)
    if said.offer_to >= 0 and not _stands(
        now, me, said, part, shape, apart, told, fresh, new, lowest
    ):
        # an answer takes `_WAIT_S` and an offer heard in the last half second: a young offer
        # cannot have been taken
        taken = now - part.since_s > _WAIT_S - _HEARD_S
        said, part = _ended(said, part)
        if taken:
            part = Part(part.since_s, now + _QUIET_S, part.partner, part.twins_s)
    free = settled and said.offer_to < 0 and now >= part.quiet_s
    role = said.role
    said, part = _considered(now, me, said, part, shape, apart, told, fresh, new and free, lowest)
    if new and free and part.partner < 0 and lowest >= shape.rank[me]:
        said, part = _proposed(now, me, role, said, part, shape, apart, told, fresh)
    return said, part


def gain(other: Said, apart: complex, shape: Shape, role: int) -> float:
    """(s_i - s_j) . (z_i - z_j), for the own `role`."""
    z: complex = shape.slots[role] - shape.slots[other.role]
    return apart.real * z.real + apart.imag * z.imag


def _taken(said: Said, role: int) -> Said:
    _, version, lock, offer_to, offer_version, answer_to, answer_version, answer_role = said
    version += 1
    return Said(
        role=role,
        version=version,
        lock=lock,
        offer_to=offer_to,
        offer_version=offer_version,
        answer_to=answer_to,
        answer_version=answer_version,
        answer_role=answer_role,
    )


def _ended(said: Said, part: Part) -> tuple[Said, Part]:
    """No offer, no consideration, no lock."""
    role, version, _, _, _, answer_to, answer_version, answer_role = said
    said = Said(
        role=role,
        version=version,
        lock=_NONE,
        offer_to=_NONE,
        offer_version=_NONE,
        answer_to=answer_to,
        answer_version=answer_version,
        answer_role=answer_role,
    )
    return said, Part(part.since_s, part.quiet_s, _NONE, part.twins_s)


def _repaired(
    now: float,
    me: int,
    said: Said,
    part: Part,
    told: Sequence[Said],
    fresh: Sequence[bool],
    settled: bool,
) -> tuple[Said, Part]:
    """The higher id of two with one role takes a role that is free."""
    twin = False
    for j in range(me):
        twin = twin or (fresh[j] and told[j].role == said.role)
    twins_s = min(part.twins_s, now) if twin and settled else math.inf
    part = Part(part.since_s, part.quiet_s, part.partner, twins_s)
    if now - twins_s < _TWINS_S:
        return said, part
    for role in range(len(told)):
        held = False  # the own one is the twin's
        for j in range(len(told)):
            held = held or (j != me and told[j].role == role)
        if not held:
            return _ended(_taken(said, role), part)
    return said, part


def _lowest_lock(
    me: int, said: Said, part: Part, shape: Shape, told: Sequence[Said], fresh: Sequence[bool]
) -> int:
    """The lowest rank of a lock that a link neighbour shows, the own partner left out; n for
    none."""
    lowest = len(told)
    partner = said.offer_to if said.offer_to >= 0 else part.partner
    for j in range(len(told)):
        if fresh[j] and j != partner and told[j].lock >= 0 and shape.links[me][j]:
            lowest = min(lowest, shape.rank[told[j].lock])
    return lowest


def _stands(
    now: float,
    me: int,
    said: Said,
    part: Part,
    shape: Shape,
    apart: Sequence[complex],
    told: Sequence[Said],
    fresh: Sequence[bool],
    new: bool,
    lowest: int,
) -> bool:
    """The own offer still holds."""
    to = said.offer_to
    return (
        new
        and fresh[to]
        and gain(told[to], apart[to], shape, said.role) < 0.5 * WORTH
        and now - part.since_s <= _OFFER_S
        and told[to].version == said.offer_version
        and lowest >= shape.rank[me]
        and legal(me, said.role, to, told, shape)
    )


def _considered(
    now: float,
    me: int,
    said: Said,
    part: Part,
    shape: Shape,
    apart: Sequence[complex],
    told: Sequence[Said],
    fresh: Sequence[bool],
    free: bool,
    lowest: int,
) -> tuple[Said, Part]:
    """2: look at the best offer to the own agent, and take it when its time has come."""
    partner = _NONE
    for j in range(len(told)):
        if (
            free
            and fresh[j]
            and told[j].offer_to == me
            and told[j].offer_version == said.version
            and gain(told[j], apart[j], shape, said.role) < WORTH
        ):
            partner = j
            break
    if partner >= 0 and not (
        lowest >= shape.rank[partner] and legal(me, said.role, partner, told, shape)
    ):
        partner = _NONE
    since_s = now if partner >= 0 and partner != part.partner else part.since_s
    part = Part(since_s, part.quiet_s, partner, part.twins_s)
    role, version, _, offer_to, offer_version, answer_to, answer_version, answer_role = said
    lock = me if offer_to >= 0 else partner
    if partner >= 0 and now - since_s >= _WAIT_S:
        answer_to, answer_version, answer_role = partner, told[partner].version, role
        said = Said(
            role=role,
            version=version,
            lock=lock,
            offer_to=offer_to,
            offer_version=offer_version,
            answer_to=answer_to,
            answer_version=answer_version,
            answer_role=answer_role,
        )
        return _ended(_taken(said, told[partner].role), part)
    said = Said(
        role=role,
        version=version,
        lock=lock,
        offer_to=offer_to,
        offer_version=offer_version,
        answer_to=answer_to,
        answer_version=answer_version,
        answer_role=answer_role,
    )
    return said, part


def _proposed(
    now: float,
    me: int,
    role: int,
    said: Said,
    part: Part,
    shape: Shape,
    apart: Sequence[complex],
    told: Sequence[Said],
    fresh: Sequence[bool],
) -> tuple[Said, Part]:
    """1: offer to the agent with which an exchange brings most, if it is legal; `role` is the own
    one at the beginning of the round."""
    before, tried = -math.inf, _NONE
    for _ in range(_TRIES):
        best, least = _NONE, math.inf
        for j in range(me + 1, len(told)):
            if not fresh[j] or told[j].lock >= 0:
                continue
            q = apart[j]
            brings = gain(told[j], q, shape, role)
            later = brings > before or (brings == before and j > tried)
            if (
                later
                and brings < WORTH
                and brings < least
                and q.real * q.real + q.imag * q.imag <= shape.r * shape.r
            ):
                best, least = j, brings
        if best < 0:
            break
        if legal(me, said.role, best, told, shape):
            own, version, _, _, _, answer_to, answer_version, answer_role = said
            offered = told[best].version
            said = Said(
                role=own,
                version=version,
                lock=me,
                offer_to=best,
                offer_version=offered,
                answer_to=answer_to,
                answer_version=answer_version,
                answer_role=answer_role,
            )
            return said, Part(now, part.quiet_s, part.partner, part.twins_s)
        before, tried = least, best
    return said, part


def legal(me: int, role: int, partner: int, told: Sequence[Said], shape: Shape) -> bool:
    """The swarm stays connected if the agents `me`, in this role, and `partner` exchange: each of
    their links that fits in r still does, or is bridged by another agent with fitting links to both
    ends: a path of two."""
    other = told[partner].role
    for end in (me, partner):
        was, to = (role, other) if end == me else (other, role)
        for j in range(len(told)):
            if not shape.links[end][j]:
                continue
            theirs = _role(j, me, role, told)
            if not _fits(was, theirs, shape):
                continue
            then = _swapped(theirs, j, me, partner, role, other)
            if not _fits(to, then, shape) and not _bridged(
                end, to, j, then, me, partner, role, told, shape
            ):
                return False
    return True


def _bridged(
    end: int,
    to: int,
    j: int,
    then: int,
    me: int,
    partner: int,
    role: int,
    told: Sequence[Said],
    shape: Shape,
) -> bool:
    """Another agent has fitting links to both ends after the exchange."""
    other = told[partner].role
    for k in range(len(told)):
        if shape.links[end][k] and shape.links[k][j]:
            between = _swapped(told[k].role, k, me, partner, role, other)
            if _fits(to, between, shape) and _fits(between, then, shape):
                return True
    return False


def _role(j: int, me: int, role: int, told: Sequence[Said]) -> int:
    return role if j == me else told[j].role


def _swapped(theirs: int, j: int, me: int, partner: int, role: int, other: int) -> int:
    if j == me:
        return other
    return role if j == partner else theirs


def _fits(one: int, other: int, shape: Shape) -> bool:
    """Slots of two roles are a link that fits."""
    q: complex = shape.slots[one] - shape.slots[other]
    most: float = _WITHIN * shape.r
    return q.real * q.real + q.imag * q.imag <= most * most
