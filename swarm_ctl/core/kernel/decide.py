"""From a wish to the velocity that is flown: what asks for something, and one program over all of
it.

A *source* of constraints is a function that puts rows (`program.Row`) into the list; each row says
which source it is from, what it is about, and at which level it gives way. `decided` collects them.
A new source is one function, one number, and one line there.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from swarm_ctl.core.kernel.constraints import Margins, Other, cap, guard, keep_out, unsure
from swarm_ctl.core.kernel.law import put
from swarm_ctl.core.kernel.program import LEAVE, LINK, PAIR, WALL, Row, relaxed
from swarm_ctl.core.kernel.walls import (
    NO_WALL,
    NO_WALL_MARGINS,
    Wall,
    WallMargins,
    keep_off,
    wall_cap,
)
from swarm_ctl.core.kernel.wish import PASSES, limited

WALLS: Final = 0
"""Rows that keep out of zones, and inside the fence."""
PAIRS: Final = 1
"""Rows that keep apart from another aircraft."""
LINKS: Final = 2
"""Rows that keep a link of the formation."""
UNTOUCHED: Final = 1e-6
"""A velocity this close to the wish counts as unchanged."""


class Own(NamedTuple):
    """What an agent knows of itself."""

    doubt_s: float
    """Of its vehicle's response."""
    response_s: float
    moving: complex
    """The velocity that its whole formation shares: peers of it move with it, so between those only
    the difference counts."""


class Link(NamedTuple):
    """A guarded link."""

    about: int
    """The other end."""
    apart: complex
    """Own stop point minus its, now."""
    setpoint: complex
    """Of the other end."""
    turning: complex
    """How fast the middle of the link moves as the shape turns and grows: both ends fly along with
    it, and only what they fly besides stretches the link."""
    along: bool
    """The other end flies the same formation."""


NO_LINK: Final = Link(0, 0j, 0j, 0j, False)


class Decision(NamedTuple):
    """What is flown, and what was asked for."""

    velocity: complex
    wish: complex
    """Less the velocity that the formation shares: rows are about this."""
    used: int
    """Rows that were asked for."""
    touched: bool
    """The wish was changed."""
    yielded: bool
    """Hard rows excluded each other, and gave way."""


class NearWall(NamedTuple):
    """A wall that is near, and the lengths of its clearance."""

    wall: Wall
    margins: WallMargins


NO_NEAR_WALL: Final = NearWall(NO_WALL, NO_WALL_MARGINS)


def keep_off_walls(
    rows: list[Row], used: int, walls: list[NearWall], near: int, own: Own, margins: Margins
) -> tuple[int, float, bool]:
    """Rows of the first `near` walls: to come no nearer than D. Then the speed that is allowed near
    them, and whether one is so close that the velocity which the formation shares has to give way.
    """
    moving, speed = own.moving, margins.speed
    most, close = speed, False
    for k in range(near):
        wall, lengths = walls[k]
        normal = wall.normal
        bound = min(keep_off(wall.gap, lengths), 0.0) - (normal.conjugate() * moving).real
        most = min(most, wall_cap(wall.gap, own.doubt_s, lengths))
        close = close or (moving != 0j and most < speed)
        if wall.gap >= 0.0 and (bound > -speed or moving != 0j):
            used = put(rows, used, Row(normal.real, normal.imag, bound, WALL, WALLS, wall.about))
    return used, most, close


def leave_walls(
    rows: list[Row], used: int, walls: list[NearWall], near: int, moving: complex
) -> int:
    """Rows of those of the first `near` walls that do not hold: to leave. Pairs come first: two
    that left a new zone side by side by rows of the walls' own level had no velocity left to part
    with, and came within 0.93 `r_in`."""
    for k in range(near):
        wall, lengths = walls[k]
        normal, leave = wall.normal, keep_off(wall.gap, lengths)
        if leave > 0.0:
            bound = leave - (normal.conjugate() * moving).real
            used = put(rows, used, Row(normal.real, normal.imag, bound, LEAVE, WALLS, wall.about))
    return used


def keep_apart(
    rows: list[Row], used: int, others: list[Other], near: int, own: Own, margins: Margins
) -> tuple[int, float, bool]:
    """Rows of the first `near` aircraft of `others`; then the speed that is allowed near them, and
    whether one that does not fly along is so close that the shared velocity has to give way. A row
    that forbids nothing which the speed limit allows is left out.

    Caution allows what a keep-out asks for: two that gusts had pushed under D left each other at
    `slow` alone, and came within 0.50 m (`r_in` 1.44 m)."""
    moving, speed = own.moving, margins.speed
    most, asked, close, stands = speed, 0.0, False, moving == 0j
    for k in range(near):
        other = others[k]
        normal, bound, room = keep_out(other, margins)
        if not stands and not other.along:
            bound -= (normal.conjugate() * moving).real
            close = close or room < margins.zone
        most = min(most, cap(room, unsure(own.doubt_s, own.response_s, other), margins))
        asked = max(asked, bound)
        if bound > -speed or not stands:
            used = put(rows, used, Row(normal.real, normal.imag, bound, PAIR, PAIRS, other.about))
    return used, max(most, min(asked, speed)), close


def keep_links(
    rows: list[Row], used: int, links: list[Link], guarded: int, moving: complex, margins: Margins
) -> int:
    """Rows of the first `guarded` links; while the formation moves, of those alone whose other end
    flies along."""
    for k in range(guarded):
        link = links[k]
        if moving != 0j and not link.along:
            continue
        others = link.setpoint - moving - link.turning
        normal, bound = guard(link.apart, others, margins)
        bound += (normal.conjugate() * link.turning).real
        if bound > -margins.speed:
            used = put(rows, used, Row(normal.real, normal.imag, bound, LINK, LINKS, link.about))
    return used


def freer_side(away: complex, walls: list[NearWall], near: int) -> complex:
    """On which side an aircraft that stays is passed (`wish.bent`): where the first `near` walls
    leave more room, and else where all pass. `away` points from it to us."""
    size = abs(away)
    if size < 1e-9:
        return PASSES
    way = away / size * PASSES
    there, back = 1.0, 1.0
    for k in range(near):
        along = (walls[k].wall.normal.conjugate() * way).real
        there, back = min(there, along), min(back, -along)
    return -PASSES if there < min(back, 0.0) else PASSES


def decided(
    wish: complex,
    others: list[Other],
    near: int,
    links: list[Link],
    guarded: int,
    walls: list[NearWall],
    walled: int,
    own: Own,
    margins: Margins,
    rows: list[Row],
) -> Decision:
    """The velocity nearest to the wish, within the speed limit, that keeps off the first `walled`
    of `walls`, apart from the first `near` aircraft of `others` and, for the first `guarded` of
    `links`, together. `rows` is filled anew."""
    used, off, close = keep_off_walls(rows, 0, walls, walled, own, margins)
    used, most, closer = keep_apart(rows, used, others, near, own, margins)
    moving = own.moving
    if close or closer:
        moving = 0j
        still = Own(own.doubt_s, own.response_s, moving)
        used, off, _ = keep_off_walls(rows, 0, walls, walled, still, margins)
        used, most, _ = keep_apart(rows, used, others, near, still, margins)
    used = leave_walls(rows, used, walls, walled, moving)
    used = keep_links(rows, used, links, guarded, moving, margins)
    if used == 0 and near == 0 and walled == 0:
        return Decision(wish, wish, 0, False, False)
    asked = wish - moving
    found, slacks = relaxed(asked, rows, used, min(off, most))
    touched = abs(found - asked) > UNTOUCHED
    flown = found + moving
    if moving != 0j:
        flown = limited(flown, margins.speed)
    yielded = touched and (slacks[WALL] > 0.0 or slacks[PAIR] > 0.0)
    return Decision(flown, asked, used, touched, yielded)
