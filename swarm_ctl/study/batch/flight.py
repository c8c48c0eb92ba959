"""One mission of a study, tick by tick: plain functions that numba compiles (`compiled.py`), and
that fly the same without it. What agents decide is `core/kernel`.

`s` is what the missions share, `w` the mission as a whole; `missions.py` has the arrays.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Any, Final

import numpy as np

from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS, near_m
from swarm_ctl.core.kernel.constraints import (
    NO_OTHER,
    Other,
    carried,
    constrains,
    fits,
    flown_s,
    kept,
    minded,
    nearest,
    passed_at,
    tight,
)
from swarm_ctl.core.kernel.decide import (
    NO_LINK,
    NO_NEAR_WALL,
    Link,
    NearWall,
    Own,
    decided,
    freer_side,
)
from swarm_ctl.core.kernel.exchange import Part, Said, Shape, nothing_said, took_part
from swarm_ctl.core.kernel.law import NO_PAIR, Law, Pair, put, terms
from swarm_ctl.core.kernel.program import NO_ROW, Row
from swarm_ctl.core.kernel.queue import OUT, STAYS, along_way, next_on, point_on
from swarm_ctl.core.kernel.receiver import NO_ONE, Known, Me
from swarm_ctl.core.kernel.response import Estimate, compared, steered, stop_point
from swarm_ctl.core.kernel.walls import Edge, Wall, WallMargins, faced
from swarm_ctl.core.kernel.wish import (
    Release,
    bent,
    limited,
    noted,
    pull,
    shortened,
    swirled,
    turned,
)
from swarm_ctl.core.model.arrays import Complex, Floats, Ints
from swarm_ctl.core.model.timeouts import FAR_LATE_S, FRESH_S, NEIGHBOUR_S, PREDICT_S
from swarm_ctl.study.batch.missions import BEFORE, DRAWN, LOOKS, NEVER, Missions, Setup

BEGIN: Final = 1
"""Stages of a tick, to be added up: what is known before the first one ..."""
DECIDE: Final = 2
"""... where vehicles are, what is heard, who flies where ..."""
ACT: Final = 4
"""... the law, and what is commanded ..."""
MOVE: Final = 8
"""... vehicles fly, but for those with a firmware ..."""
LOOK: Final = 16
"""... whether it is over, and who is near."""
TELL: Final = 32
"""Before `ACT`, for an own law that is not compiled: what it is told of others."""
TICK: Final = DECIDE | ACT | MOVE | LOOK

CHECK: Final = 5
"""Ticks between two looks at whether the formation stands."""
STUCK_MPS: Final = 0.05
_STUCK_S: Final = 20.0
"""All commands this close to their mean for so long, and not formed: a dead-lock. A swarm that is
blocked may drift as a whole."""
_KEPT: Final = 0.9
"""Links whose slots are this close [r] are expected to stay within r."""
_ROUNDING: Final = 1e-6


def fly(s: Setup, many: Missions, first: int, ticks: int, stages: int, own_law: Any = None) -> None:
    """These stages of the next ticks, for all missions that are not over; `own_law`: from the
    receiver, its rows, the law's numbers and its memory to its terms."""
    n = many.agent.shape[1]
    points, present = np.zeros(n, np.complex128), np.zeros(n, np.bool_)
    age_s = np.zeros(n, np.float64)
    others, guarded, rows, pairs = [NO_OTHER], [NO_LINK], [NO_ROW], [NO_PAIR]
    walls = [NO_NEAR_WALL]
    knows = [NO_ONE]
    told = [nothing_said(0)]
    for k in range(len(many.whole)):
        w = many.whole[k]
        if w.done:
            continue
        agent, pair, link, sent = many.agent[k], many.pair[k], many.link[k], many.sent[k]
        links, past, newest, commands = (
            many.links[k],
            many.past[k],
            many.newest[k],
            many.commands[k],
        )
        losses, jitter = many.losses[k], many.jitter[k]
        if stages & BEGIN:
            _begin(s, w, agent, pair, link)
        for tick in range(first, first + ticks):
            if stages & DECIDE:
                _locate(s, agent, sent)
                _measure(s, w, agent, link, tick)
                if s.wood:
                    _measure_trunks(w, agent, many.trunk[k], tick)
                listen(s, w, agent, pair, past, losses, jitter, newest, tick)
                if s.exchanges and tick % s.round == 0:
                    _hear_exchange(s, pair, many.history[k], many.roles[k], tick)
                    shape = Shape(many.roles[k], links, many.rank, s.r)
                    _exchange(
                        s,
                        w,
                        agent,
                        pair,
                        many.said[k],
                        many.part[k],
                        many.history[k],
                        shape,
                        points,
                        age_s,
                        present,
                        told,
                        tick,
                    )
                    _fitting(s, w, agent, link)
            if stages & TELL:
                _tell(s, w, agent, pair, many.known[k], many.told[k], knows, tick)
            if stages & ACT:
                if own_law is not None:
                    for i in range(n):
                        know(s, w, agent, pair, i, knows, tick)
                        numbers, memory = many.numbers[k], many.memory[k, i]
                        towards, apart = own_law(
                            receiver(s, w, agent[i], i), knows, numbers, memory
                        )
                        steer(w, agent[i], towards, apart)
                _act(
                    s,
                    w,
                    agent,
                    pair,
                    sent,
                    many.seen_pairs[k],
                    many.memory[k, 0],
                    knows,
                    others,
                    guarded,
                    walls,
                    rows,
                    pairs,
                    many.trunk[k],
                    many.way_m[k],
                    many.ends_m[k],
                    many.ranks[k],
                    many.along_m[k],
                    tick,
                )
            if stages & MOVE:
                _moved(s, agent, commands)
            if stages & LOOK:
                _look(s, w, agent, pair, link, tick)
                if s.far:
                    look_around(s, agent, pair, many.said[k], tick)
                if w.done:
                    break


def _begin(s: Setup, w: Any, agent: Any, pair: Any, link: Any) -> None:
    """What is known before the first tick: links that fit, and who is near. The swarms have flown
    before."""
    n = len(agent)
    _fitting(s, w, agent, link)
    for k in range(w.links):
        link[k].held = link[k].fits
    if s.far:
        for i in range(n):
            _choose(s, agent[i], pair, 0, i)
            for j in range(n):
                if pair[i, j].near:
                    pair[i, j].heard_from = BEFORE


# --- where they are ---


def _estimate(a: Any) -> Estimate:
    return Estimate(
        late_s=a.late_s,
        doubt_s=a.doubt_s,
        moved=a.moved,
        agreed=a.agreed,
        sent=a.sent,
        begun=a.begun,
        place=a.model_place,
        velocity=a.model_velocity,
        slow_velocity=a.slow_velocity,
        behind=a.behind,
        slow_behind=a.slow_behind,
    )


def _believe(a: Any, e: Estimate) -> None:
    a.late_s, a.doubt_s, a.moved, a.agreed = e.late_s, e.doubt_s, e.moved, e.agreed
    a.sent, a.begun, a.model_place, a.model_velocity = e.sent, e.begun, e.place, e.velocity
    a.slow_velocity, a.behind, a.slow_behind = e.slow_velocity, e.behind, e.slow_behind


def _locate(s: Setup, agent: Any, sent: Complex) -> None:
    """Positions and stop points."""
    for i in range(len(agent)):
        a = agent[i]
        a.seen = a.position
        a.position = a.place_m / s.unit_m
        if s.ideal or s.plain:
            a.point = a.position
        else:
            e = compared(_estimate(a), a.place_m, a.velocity_mps, s.model)
            _believe(a, e)
            a.point = stop_point(e, a.place_m, a.velocity_mps, sent[i], s.model) / s.unit_m


def _measure(s: Setup, w: Any, agent: Any, link: Any, tick: int) -> None:
    """Take the distances of all pairs into the smallest and the largest: each flies straight from
    one tick to the next."""
    n, longest = len(agent), 0.0
    nearest, nearest_silent = w.nearest, w.nearest_silent
    most = nearest
    for i in range(n):
        if tick >= agent[i].silent_from:
            most = max(most, nearest_silent)
        way = agent[i].position - agent[i].seen
        longest = max(longest, way.real * way.real + way.imag * way.imag)
    # between two ticks, two are nearer than now by no more than what both have flown
    flown = 2.0 * math.sqrt(longest) + _ROUNDING
    reach = math.sqrt(most) + flown
    for i in range(n):
        a = agent[i]
        live = tick < a.silent_from
        p, was = a.position, a.seen
        for j in range(i + 1, n):
            b = agent[j]
            now = p - b.position
            squared = now.real * now.real + now.imag * now.imag
            if squared > reach * reach:
                continue
            before = was - b.seen
            way = now - before
            along = before.real * way.real + before.imag * way.imag
            if along >= 0.0:
                squared = min(squared, before.real * before.real + before.imag * before.imag)
            elif now.real * way.real + now.imag * way.imag > 0.0:
                share = -along / max(way.real * way.real + way.imag * way.imag, 1e-300)
                north, east = before.real + share * way.real, before.imag + share * way.imag
                squared = min(squared, north * north + east * east)
            lives = tick < b.silent_from
            if live and lives:
                nearest = min(nearest, squared)
            elif live or lives:
                nearest_silent = min(nearest_silent, squared)
    w.nearest, w.nearest_silent = nearest, nearest_silent
    within = _KEPT * s.r * _KEPT * s.r
    for k in range(w.links):
        q = link[k]
        a, b = agent[q.first], agent[q.second]
        squared = 0.0
        if tick < a.silent_from and tick < b.silent_from:
            now = a.position - b.position
            squared = now.real * now.real + now.imag * now.imag
        q.farthest = max(q.farthest, squared)
        if s.filters:
            # a link that an exchange makes fit counts from when it is as short as its slots
            q.held = q.fits and (q.held or squared <= within)
            if q.held:
                q.farthest_kept = max(q.farthest_kept, squared)


def _measure_trunks(w: Any, agent: Any, trunk: Any, tick: int) -> None:
    """Take the distances of live agents to trunks into the smallest, between ticks too."""
    nearest = w.nearest_trunk
    for i in range(len(agent)):
        a = agent[i]
        if tick < a.silent_from:
            flown = Edge(a.seen, a.position, 0.0)
            for k in range(len(trunk)):
                _, gap = faced(flown, trunk[k].at)
                nearest = min(nearest, gap - trunk[k].radius)
    w.nearest_trunk = nearest


def _fitting(s: Setup, w: Any, agent: Any, link: Any) -> None:
    """Links that the shape keeps within r."""
    for k in range(w.links):
        z = agent[link[k].first].slot - agent[link[k].second].slot
        within = _KEPT * s.r
        link[k].fits = z.real * z.real + z.imag * z.imag <= within * within


# --- what they hear ---


def listen(
    s: Setup,
    w: Any,
    agent: Any,
    pair: Any,
    past: Complex,
    losses: Any,
    jitter: Any,
    newest: Ints,
    tick: int,
) -> None:
    """All say where they are, and hear what arrives. A state that arrives behind a newer one is
    dropped."""
    n, ring = len(agent), len(past)
    place, drawn = tick % ring, tick % DRAWN
    for j in range(n):
        past[place, 0, j] = agent[j].point
        past[place, 1, j] = agent[j].command / s.unit_m
    for i in range(n):
        for j in range(n):
            if i == j:
                continue
            q, b, lost = pair[i, j], agent[j], False
            if s.loses:
                chance = w.loss
                if w.heard:
                    chance = w.stays if q.lost else w.begins
                lost = losses[drawn, i, j] < chance
                q.lost = lost
            sent_at = tick - b.delay
            if s.jitters:
                says = not s.far or (tick + j) % s.word == 0 or tick >= q.heard_from
                if says and not lost and tick < b.silent_from:
                    late = b.exact_delay + w.jitter * jitter[drawn, i, j]
                    newest[(tick + round(late)) % ring, i, j] = tick
                sent_at = newest[place, i, j]
                newest[place, i, j] = -1
                if sent_at <= q.sent_at:
                    continue
            elif lost or sent_at >= b.silent_from:
                continue
            elif s.far and sent_at < q.heard_from and (sent_at + j) % s.word != 0:
                # heard are states of near peers, and far words
                continue
            told_at = sent_at % ring
            q.told, q.flies, q.sent_at = past[told_at, 0, j], past[told_at, 1, j], sent_at
            q.rare = s.far and sent_at < q.heard_from
    w.heard = True


def _late_s(heard_from: int, since: int, far: bool) -> float:
    """By how much words may be older than states are; see `Peer.late_s`."""
    return FAR_LATE_S if far and heard_from > since else 0.0


def since(s: Setup, tick: int) -> int:
    """From when on a peer must have been near for its words not to be late."""
    return tick - s.late + FOLLOW_TICKS - 1


def look_around(s: Setup, agent: Any, pair: Any, said: Ints, tick: int) -> None:
    """Those whose turn it is, and those that exchange slots with others than before, choose who is
    near."""
    n = len(agent)
    for i in range(n):
        changed = False
        if s.exchanges:
            lock, offer, answer = said[i, 2], said[i, 3], said[i, 5]
            for j in range(n):
                q = pair[i, j]
                always = q.link or (i != j and (offer == j or answer == j or lock == j))
                changed = changed or always != q.always
                q.always = always
        if changed or i % s.look == -tick % s.look:
            _choose(s, agent[i], pair, tick, i)


def _choose(s: Setup, a: Any, pair: Any, tick: int, i: int) -> None:
    """Choose the near peers of i anew, as in lockstep: a state is heard from `FOLLOW_TICKS` after
    its sender has come near."""
    for j in range(pair.shape[1]):
        q = pair[i, j]
        age_s = (tick - q.sent_at) * s.tick_s
        apart_m = abs(a.point - q.told) * s.unit_m
        if q.always or apart_m <= near_m(age_s, s.boundary):
            q.near_at = tick
        near = tick - q.near_at <= s.kept
        if not near:
            q.heard_from = NEVER
        elif not q.near:
            q.heard_from = tick + FOLLOW_TICKS
        q.near = near


# --- who flies where ---


def _told_at(sent_at: int, look: int, every: int) -> int:
    """The place in the history: what is sent in a tick was decided at a look before it."""
    return max((sent_at - 1) // every, look - LOOKS + 1) % LOOKS


def _hear_exchange(s: Setup, pair: Any, history: Ints, roles: Complex, tick: int) -> None:
    """All hear who flies where."""
    n, look = len(pair), tick // s.round
    for i in range(n):
        for j in range(n):
            q = pair[i, j]
            q.slot = roles[history[_told_at(q.sent_at, look, s.round), j, 0]]


def _exchange(
    s: Setup,
    w: Any,
    agent: Any,
    pair: Any,
    says: Ints,
    parts: Floats,
    history: Ints,
    shape: Shape,
    apart: Any,
    age_s: Any,
    fresh: Any,
    told: list[Said],
    tick: int,
) -> None:
    """All agents that live take part in a round, by what they have heard."""
    n, look, begun = len(agent), tick // s.round, since(s, tick)
    now_s = tick * s.tick_s
    for i in range(n):
        a = agent[i]
        if tick >= a.silent_from:
            continue
        used = 0
        for j in range(n):
            q, at = pair[i, j], _told_at(pair[i, j].sent_at, look, s.round)
            used = put(told, used, _said(history[at], j))
            age_s[j] = (tick - q.sent_at) * s.tick_s
            apart[j] = a.point - (q.told + q.flies * min(age_s[j], PREDICT_S))
            fresh[j] = i != j and age_s[j] <= FRESH_S + _late_s(q.heard_from, begun, s.far)
        said = _said(says, i)
        part = Part(parts[i, 0], parts[i, 1], round(parts[i, 2]), parts[i, 3])
        said, part = took_part(now_s, i, said, part, shape, apart, told, age_s, fresh, True)
        if said.role != says[i, 0]:
            w.exchanged += 1
        says[i, 0], says[i, 1], says[i, 2], says[i, 3] = (
            said.role,
            said.version,
            said.lock,
            said.offer_to,
        )
        says[i, 4], says[i, 5] = said.offer_version, said.answer_to
        says[i, 6], says[i, 7] = said.answer_version, said.answer_role
        parts[i, 0], parts[i, 1], parts[i, 2] = part.since_s, part.quiet_s, float(part.partner)
        parts[i, 3] = part.twins_s
        a.slot = shape.slots[said.role]
    for i in range(n):
        for c in range(says.shape[1]):
            history[look % LOOKS, i, c] = says[i, c]


def _said(w: Ints, j: int) -> Said:
    return Said(
        role=w[j, 0],
        version=w[j, 1],
        lock=w[j, 2],
        offer_to=w[j, 3],
        offer_version=w[j, 4],
        answer_to=w[j, 5],
        answer_version=w[j, 6],
        answer_role=w[j, 7],
    )


# --- what a law is told ---


def receiver(s: Setup, w: Any, a: Any, i: int) -> Me:
    """Agent i, as a law is told of it."""
    return Me(
        id=i + 1,
        at=a.point,
        slot=a.slot,
        flies=a.command / s.unit_m,
        speed=s.margins.speed,
        tick_s=s.tick_s,
        gain=w.kappa * w.h,
        r=s.r,
        r_out=s.r_out,
        r_in=s.r_in,
    )


def _row(agent: int, ahead: complex, q: Any, age_s: float, follows: bool, lower: bool) -> Known:
    return Known(
        id=agent, at=ahead, slot=q.slot, flies=q.flies, age_s=age_s, neighbour=follows, lower=lower
    )


def know(s: Setup, w: Any, agent: Any, pair: Any, i: int, knows: list[Known], tick: int) -> None:
    """What i tells an own law of the others, into `knows`."""
    begun, own = since(s, tick), agent[i].point
    most_s = 0.0 if s.plain else w.lead_s
    reach, used = s.own_reach * s.own_reach, 0
    for j in range(len(agent)):
        if j == i:
            continue
        q, age_s = pair[i, j], (tick - pair[i, j].sent_at) * s.tick_s
        ahead = q.told + q.flies * min(age_s, most_s)
        follows = q.link and age_s <= NEIGHBOUR_S + _late_s(q.heard_from, begun, s.far)
        gap = own - ahead
        if follows or gap.real * gap.real + gap.imag * gap.imag < reach:
            used = put(knows, used, _row(j + 1, ahead, q, age_s, follows, i < j))
    while len(knows) > used:
        knows.pop()


def _tell(
    s: Setup, w: Any, agent: Any, pair: Any, known: Any, told: Ints, knows: list[Known], tick: int
) -> None:
    """All that is told, into arrays."""
    for i in range(len(agent)):
        know(s, w, agent, pair, i, knows, tick)
        told[i] = len(knows)
        for k in range(len(knows)):
            row, each = known[i, k], knows[k]
            row.id, row.at, row.slot, row.flies = each.id, each.at, each.slot, each.flies
            row.age_s, row.neighbour, row.lower = each.age_s, each.neighbour, each.lower


def steer(w: Any, a: Any, consensus: complex, avoidance: complex) -> None:
    """An own law's terms [units/s]; what is no velocity ends the study."""
    both = consensus + avoidance
    if not (abs(both.real) < math.inf and abs(both.imag) < math.inf):
        w.broken, consensus, avoidance = True, 0j, 0j
    a.consensus, a.avoidance = consensus, avoidance


# --- what they fly ---


def _act(
    s: Setup,
    w: Any,
    agent: Any,
    pair: Any,
    sent: Complex,
    seen_pairs: Floats,
    memory: Any,
    knows: list[Known],
    others: list[Other],
    guarded: list[Link],
    walls: list[NearWall],
    rows: list[Row],
    pairs: list[Pair],
    trunk: Any,
    way_m: Complex,
    ends_m: Floats,
    ranks: Ints,
    along_m: Floats,
    tick: int,
) -> None:
    """From what is heard to the commands."""
    n, margins, begun = len(agent), s.margins, since(s, tick)
    law = Law(s.r, s.r_out, s.r_in, w.h, s.delta_l, s.delta_a)
    most_s = 0.0 if s.plain else w.lead_s
    r_out, off = s.r_out * s.r_out, s.swirl_off * s.swirl_off
    long = max(margins.guards_from - margins.speed * PREDICT_S - _ROUNDING, 0.0)
    wide = margins.keep_out + margins.reach + (margins.speed + margins.growth) * FRESH_S
    farthest = margins.farthest + (margins.speed * FAR_LATE_S if s.far else 0.0)
    wide = max(wide, farthest) + 2.0 * _ROUNDING
    wide, long = wide * wide, long * long
    expected_s = s.model.dead_time_s + s.model.lag_s
    for i in range(n):
        a = agent[i]
        own, live = a.point, tick < a.silent_from
        doubt_s, response_s = 0.0, 0.0
        if not s.ideal:
            doubt_s, response_s = a.doubt_s, expected_s + a.late_s
        unheard, near, links, total, count, minds, walled = False, 0, 0, 0j, 0, 0, 0
        for j in range(n):
            if j == i:
                continue
            q = pair[i, j]
            told, age_s = q.told, (tick - q.sent_at) * s.tick_s
            late_s = _late_s(q.heard_from, begun, s.far)
            ahead = told + q.flies * min(age_s, most_s)
            # in a wood, agents fly to places, and nobody is a neighbour
            follows = q.link and age_s <= NEIGHBOUR_S + late_s and not s.wood
            gap = own - ahead
            if not s.own_law and (follows or gap.real * gap.real + gap.imag * gap.imag < r_out):
                minds = put(knows, minds, _row(j, ahead, q, age_s, follows, i < j))
            if not (s.filters and live):
                continue
            apart = own - told
            squared = apart.real * apart.real + apart.imag * apart.imag
            fresh, yields = age_s <= FRESH_S + late_s, age_s <= FRESH_S
            if fresh:
                total += ahead - q.slot
                count += 1
            elif squared < off:
                unheard = True
            # most pairs are far apart: coarse looks at all, an exact one at those that are left
            if squared < wide:
                theirs_s, differs_s = 0.0, 0.0
                if not s.ideal:
                    theirs_s = expected_s + agent[j].late_s
                    differs_s = abs(theirs_s - response_s)
                reach = min(margins.reach, minded(doubt_s + differs_s, margins) + _ROUNDING)
                half = margins.keep_out + reach + (margins.speed + margins.growth) * age_s
                if not yields:
                    half = max(half, farthest)
                gone_s = flown_s(age_s, fresh, q.rare)
                if squared < half * half and constrains(
                    math.sqrt(squared), q.flies, age_s, gone_s, yields, reach, margins
                ):
                    other = Other(
                        about=j,
                        lower=i < j,
                        apart=apart,
                        setpoint=q.flies,
                        age_s=age_s,
                        flown_s=gone_s,
                        yields=yields,
                        response_s=theirs_s,
                        along=True,
                    )
                    near = put(others, near, other)
            if q.link and s.guards and not s.wood and squared > long and age_s <= NEIGHBOUR_S:
                between = abs(a.slot - q.slot)
                if fits(between, margins) and not (a.left_s > 0.0 and tight(between, margins)):
                    now = carried(apart, q.flies, age_s)
                    if kept(abs(now), margins):
                        links = put(guarded, links, Link(j, now, q.flies, 0j, True))
        if not s.own_law:
            while len(knows) > minds:
                knows.pop()
            consensus, avoidance, found = terms(receiver(s, w, a, i), knows, law, memory, pairs)
            a.consensus, a.avoidance = consensus * w.kappa, avoidance * w.kappa
            _note_pairs(w, pairs, found)
            if s.seen:
                _note_seen(seen_pairs, i, pairs, found, knows)
        if not live:
            # its vehicle goes on, until it stops by itself
            a.wish = 0j if tick >= a.silent_from + s.blind else a.command / s.unit_m
        elif not s.filters:
            a.wish = a.consensus + a.avoidance
        else:
            consensus, avoidance = a.consensus, a.avoidance
            stays = False
            if s.wood:
                walled = _walls(s, own, trunk, walls)
                consensus, stays = _in_file(
                    s, w, agent, pair, way_m, ends_m, ranks, along_m[i], i, walls, walled, tick
                )
            elif s.aligns:
                consensus += pull(own - a.slot, total, count)
            wish = consensus + avoidance
            release = Release(a.wanted, a.got, a.left_s, a.side, a.fails)
            if s.releases and not stays:
                if not unheard and avoidance != 0j and consensus != 0j:
                    wish = consensus + swirled(consensus, avoidance)
                wish, release = turned(release, wish, consensus, i + 1, margins.speed, s.tick_s)
            wish = limited(wish, margins.speed)
            mine = Own(doubt_s, response_s, 0j)
            choice = decided(wish, others, near, guarded, links, walls, walled, mine, margins, rows)
            a.wish = choice.velocity
            if s.releases and not stays:
                release = noted(release, consensus, choice.velocity, margins.speed, s.tick_s)
                a.wanted, a.got, a.left_s = release.wanted, release.got, release.left_s
                a.side, a.fails = release.side, release.fails
            w.flown += 1
            if choice.touched:
                w.touched += 1
            if choice.yielded:
                w.yielded += 1
        command(s, a, sent[i])


def _walls(s: Setup, own: complex, trunk: Any, walls: list[NearWall]) -> int:
    """The trunks that are near a stop point."""
    used, m = 0, s.walls
    # of compiled missions a record, which a list of walls does not take
    margins = WallMargins(
        keep=m.keep,
        slow=m.slow,
        zone=m.zone,
        spare=m.spare,
        reach=m.reach,
        speed=m.speed,
        braking=m.braking,
        leaves=m.leaves,
    )
    for k in range(len(trunk)):
        at, radius = trunk[k].at, trunk[k].radius
        normal, gap = faced(Edge(at, at, radius), own)
        if gap < margins.reach:
            used = put(walls, used, NearWall(Wall(normal, gap, k), margins))
    return used


def _in_file(
    s: Setup,
    w: Any,
    agent: Any,
    pair: Any,
    way_m: Any,
    ends_m: Any,
    ranks: Ints,
    along_m: Floats,
    i: int,
    walls: list[NearWall],
    walled: int,
    tick: int,
) -> tuple[complex, bool]:
    """The wish of i in a move in file, and whether it stays: `core.control.in_file` and
    `Controller.go_to`. The way of one that has left it
    is not looked for anew."""
    a, begun = agent[i], since(s, tick)
    most_s = 0.0 if s.plain else w.lead_s
    own = a.point
    home_m = (w.goal + a.slot) * s.unit_m
    along_m[i] = along_way(way_m, ends_m, along_m[i], own * s.unit_m, w.opens_m, home_m)
    ahead_m = OUT
    for k in range(len(ranks)):
        j = ranks[k]
        if j == i:
            break
        q, age_s = pair[i, j], (tick - pair[i, j].sent_at) * s.tick_s
        if age_s <= NEIGHBOUR_S + _late_s(q.heard_from, begun, s.far):
            at = (q.told + q.flies * min(age_s, most_s)) * s.unit_m
            home_m = (w.goal + q.slot) * s.unit_m
            along_m[j] = along_way(way_m, ends_m, along_m[j], at, w.opens_m, home_m)
            ahead_m = along_m[j]
    whole_m = ends_m[len(ends_m) - 1]
    most_m = next_on(along_m[i], ahead_m, whole_m, s.gap_m)
    if most_m == STAYS:
        return 0j, True
    place = w.goal + a.slot if most_m == OUT else point_on(way_m, ends_m, most_m) / s.unit_m
    wish = shortened((place - own) * (w.kappa * w.h), s.margins.speed)
    for j in range(len(agent)):
        if j == i:
            continue
        q, age_s = pair[i, j], (tick - pair[i, j].sent_at) * s.tick_s
        if age_s > NEIGHBOUR_S + _late_s(q.heard_from, begun, s.far):
            away = nearest(own - q.told, q.flies, flown_s(age_s, False, q.rare))
            room = abs(away) - passed_at(age_s, s.margins)
            if room < s.margins.zone:
                if q.passes == 0j:
                    q.passes = freer_side(away, walls, walled)
                elif q.passed != a.fails:
                    q.passes = -q.passes
                q.passed = a.fails
                wish = bent(wish, away, max(0.0, room), q.passes)
    return wish, False


def _note_pairs(w: Any, pairs: list[Pair], found: int) -> None:
    """Count what the law made of pairs."""
    for k in range(found):
        pair = pairs[k]
        if pair.status == 0:
            w.paper += 1
        elif pair.status == 1:
            w.narrow += 1
        elif pair.status == 2:
            w.inactive += 1
        else:
            w.overspeed += 1
        if pair.d_ub - pair.d_lb <= 2.0:
            w.small_gap += 1


def _note_seen(
    seen_pairs: Floats, i: int, pairs: list[Pair], found: int, knows: list[Known]
) -> None:
    """Tell what the law made of the pairs of i."""
    for j in range(seen_pairs.shape[0]):
        seen_pairs[i, j, 0] = 0.0
    for k in range(found):
        pair = pairs[k]
        j = knows[pair.place].id
        seen_pairs[i, j, 0], seen_pairs[i, j, 1] = pair.distance, pair.sigma
        seen_pairs[i, j, 2], seen_pairs[i, j, 3] = pair.sigma_lb, pair.d
        seen_pairs[i, j, 4], seen_pairs[i, j, 5] = pair.d_ub - pair.d_lb, float(pair.status)


def command(s: Setup, a: Any, sent: MutableSequence[complex]) -> None:
    """Tell the vehicle, and the model that flies beside it."""
    wanted = a.wish * s.unit_m
    if s.ideal:
        a.command = wanted
        return
    a.command = wanted * (s.speed_mps / max(abs(wanted), s.speed_mps))
    _believe(a, steered(_estimate(a), a.command, sent, s.model))


def _moved(s: Setup, agent: Any, commands: Complex) -> None:
    """Vehicles fly one tick: ideal ones, and those behind a dead time and a first-order lag with
    bounded acceleration."""
    ring = commands.shape[1]
    for i in range(len(agent)):
        a = agent[i]
        if s.ideal:
            a.place_m += a.command * s.tick_s
            continue
        # the estimate counts the commands
        newest = a.sent - 1
        commands[i, newest % ring] = a.command
        demand = (commands[i, (newest - a.late) % ring] - a.velocity_mps) * a.share
        demand *= a.bound_mps2 / max(abs(demand), a.bound_mps2)
        a.velocity_mps += demand * s.tick_s
        a.place_m += a.velocity_mps * s.tick_s


# --- how it goes ---


def _look(s: Setup, w: Any, agent: Any, pair: Any, link: Any, tick: int) -> None:
    """Every `CHECK` ticks: whether the formation stands, and the mission is over."""
    last = tick == s.last
    if tick % CHECK and not last:
        return
    n, now_s = len(agent), tick * s.tick_s
    if not w.parted:
        _note_parted(s, w, agent, pair, link, tick)
    error = _to_go(w, agent, tick) if s.wood else _error(agent, tick)
    mean, speed = 0j, 0.0
    for i in range(n):
        mean += agent[i].command / n
    for i in range(n):
        speed = max(speed, abs(agent[i].command - mean))
    w.since_s = min(w.since_s, now_s) if error < s.tolerance else math.inf
    if speed >= STUCK_MPS or error < s.tolerance:
        w.moved_s = now_s
    w.formed = now_s - w.since_s >= s.settle_s - 1e-9
    if w.formed or last:
        w.done = True
        w.stuck = now_s - w.moved_s >= _STUCK_S and not w.formed
        w.ended_s = w.since_s if w.formed else now_s
        w.error, w.steps = error, tick + 1


def _error(agent: Any, tick: int) -> float:
    """Largest |e_i - mean e| over the live agents."""
    n, live, mean, error = len(agent), 0, 0j, 0.0
    for i in range(n):
        if tick < agent[i].silent_from:
            mean += agent[i].position - agent[i].slot
            live += 1
    mean /= max(live, 1)
    for i in range(n):
        if tick < agent[i].silent_from:
            e = agent[i].position - agent[i].slot - mean
            error = max(error, e.real * e.real + e.imag * e.imag)
    return math.sqrt(error)


def _to_go(w: Any, agent: Any, tick: int) -> float:
    """How far the farthest live agent is from its place behind the wood."""
    error = 0.0
    for i in range(len(agent)):
        if tick < agent[i].silent_from:
            error = max(error, abs(agent[i].position - agent[i].slot - w.goal))
    return error


def _short(s: Setup, agent: Any, pair: Any, i: int, j: int, tick: int) -> bool:
    """i follows j, and the link of the start graph is within r."""
    q = pair[i, j]
    if not q.link:
        return False
    late_s = _late_s(q.heard_from, since(s, tick), s.far)
    if (tick - q.sent_at) * s.tick_s > NEIGHBOUR_S + late_s:
        return False
    apart: complex = agent[i].position - agent[j].position
    return apart.real * apart.real + apart.imag * apart.imag <= s.r * s.r


def _note_parted(s: Setup, w: Any, agent: Any, pair: Any, link: Any, tick: int) -> None:
    """Whether the links that are within r hang together, once one is longer."""
    n, stretched = len(agent), False
    for k in range(w.links):
        q = agent[link[k].first].position - agent[link[k].second].position
        stretched = stretched or q.real * q.real + q.imag * q.imag > s.r * s.r
    if not stretched:
        return
    for forward in (True, False):
        reached, border = np.zeros(n, np.bool_), np.zeros(n, np.int64)
        reached[0], found, looked = True, 1, 0
        while looked < found:
            i = border[looked]
            looked += 1
            for j in range(n):
                if not reached[j] and (
                    _short(s, agent, pair, i, j, tick)
                    if forward
                    else _short(s, agent, pair, j, i, tick)
                ):
                    reached[j] = True
                    border[found] = j
                    found += 1
        if found < n:
            w.parted = True
