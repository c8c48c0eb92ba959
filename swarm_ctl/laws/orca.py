"""Optimal reciprocal collision avoidance (van den Berg 2011), on stop points.

The velocity nearest to the pull of the shape that meets nobody within `horizon`; each of two does
half of it."""

import math

from swarm_ctl.law import (
    NO_ROW,
    Annotated,
    Between,
    LawTerms,
    Me,
    Memory,
    NamedTuple,
    Others,
    Row,
    relaxed,
)


class Parameters(NamedTuple):
    rate: Annotated[float, Between(0.05, 4, "[1/s] of the error that is left")] = 2.0
    apart: Annotated[float, Between(0.1, 10, "least distance [units]")] = 0.85
    horizon: Annotated[float, Between(0.2, 20, "[s]")] = 4.0


def terms(me: Me, others: Others, p: Parameters, memory: Memory) -> LawTerms:
    error, total, count, rows = me.at - me.slot, 0j, 0, [NO_ROW]
    rows.pop()
    for other in others:
        if other.neighbour:
            total += other.at - other.slot - error
            count += 1
        gap, x = other.at - me.at, abs(other.at - me.at)
        if x < 1e-6:
            gap, x = (-1e-6 + 0j if other.lower else 1e-6 + 0j), 1e-6
        change, normal = obstacle(gap, me.flies - other.flies, p.apart, p.horizon, me.tick_s)
        bound = (normal.conjugate() * (me.flies + 0.5 * change)).real
        rows.append(Row(normal.real, normal.imag, bound, 0, 0, other.id))
    wish = p.rate * total / max(count, 1)
    wish *= me.speed / max(abs(wish), me.speed)
    flown, _ = relaxed(wish, rows, len(rows), me.speed)
    return LawTerms(wish, flown - wish)


def obstacle(
    gap: complex, relative: complex, apart: float, horizon: float, tick_s: float
) -> tuple[complex, complex]:
    """The least change of the relative velocity that leaves the velocity obstacle, and the normal
    that it goes along."""
    x = abs(gap)
    overlap = x <= apart
    within_s = tick_s if overlap else horizon
    w = relative - gap / within_s
    size, along = max(abs(w), 1e-9), (w * gap.conjugate()).real
    if overlap or (along < 0.0 and along * along > apart * apart * size * size):
        front = w / size if abs(w) > 1e-9 else -gap / x
        return (apart / within_s - size) * front, front
    leg = math.sqrt(max(x * x - apart * apart, 1e-9))
    left = gap.real * w.imag - gap.imag * w.real > 0.0
    side = gap * complex(leg, apart) / (x * x) if left else -gap * complex(leg, -apart) / (x * x)
    return (relative * side.conjugate()).real * side - relative, complex(-side.imag, side.real)
