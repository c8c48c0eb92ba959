"""From a wish to the velocity that is flown: what asks for something, and one program over all of
it.

A *source* of constraints is a function that puts rows (`program.Row`) into the list; each row says
which source it is from, which aircraft it is about, and whether it is soft. `decided` collects
them. A new source is one function, one number, and one line there.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from swarm_ctl.core.kernel.constraints import Margins, Other, cap, guard, keep_out, unsure
from swarm_ctl.core.kernel.program import Row, relaxed
from swarm_ctl.core.kernel.sequences import put
from swarm_ctl.core.kernel.wish import limited

PAIRS: Final = 0
"""Rows that keep apart from another aircraft."""
LINKS: Final = 1
"""Soft rows that keep a link of the formation."""
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


def keep_apart(
    rows: list[Row], used: int, others: list[Other], near: int, own: Own, margins: Margins
) -> tuple[int, float, bool]:
    """Rows of the first `near` aircraft of `others`; then the speed that is allowed near them, and
    whether one that does not fly along is so close that the shared velocity has to give way. A row
    that forbids nothing which the speed limit allows is left out."""
    moving, speed = own.moving, margins.speed
    most, close, stands = speed, False, moving == 0j
    for k in range(near):
        other = others[k]
        normal, bound, room = keep_out(other, margins)
        if not stands and not other.along:
            bound -= (normal.conjugate() * moving).real
            close = close or room < margins.zone
        most = min(most, cap(room, unsure(own.doubt_s, own.response_s, other), margins))
        if bound > -speed or not stands:
            used = put(rows, used, Row(normal.real, normal.imag, bound, False, PAIRS, other.about))
    return used, most, close


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
            used = put(rows, used, Row(normal.real, normal.imag, bound, True, LINKS, link.about))
    return used


def decided(
    wish: complex,
    others: list[Other],
    near: int,
    links: list[Link],
    guarded: int,
    own: Own,
    margins: Margins,
    rows: list[Row],
) -> Decision:
    """The velocity nearest to the wish, within the speed limit, that keeps apart from the first
    `near` aircraft of `others` and, for the first `guarded` of `links`, together. `rows` is filled
    anew."""
    used, most, close = keep_apart(rows, 0, others, near, own, margins)
    moving = own.moving
    if close:
        moving = 0j
        still = Own(own.doubt_s, own.response_s, moving)
        used, most, _ = keep_apart(rows, 0, others, near, still, margins)
    used = keep_links(rows, used, links, guarded, moving, margins)
    if used == 0 and near == 0:
        return Decision(wish, wish, 0, False, False)
    asked = wish - moving
    found, slack = relaxed(asked, rows, used, most)
    touched = abs(found - asked) > UNTOUCHED
    flown = found + moving
    if moving != 0j:
        flown = limited(flown, margins.speed)
    return Decision(flown, asked, used, touched, touched and slack > 0.0)
