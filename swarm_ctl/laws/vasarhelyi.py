"""Vasarhelyi's flocking (Science Robotics 2018), with a pull to the shape beside it.

Repulsion, friction of velocities that differ by more than a braking curve allows, a flock's own
speed. The published lengths are metres: here they are units."""

import math

from swarm_ctl.law import Annotated, Between, LawTerms, Me, Memory, NamedTuple, Others


class Parameters(NamedTuple):
    cruise: Annotated[float, Between(0, 4, "v_flock [units/s]; 0: it gathers and stays")] = 0.0
    gather: Annotated[float, Between(0, 4, "[1/s] pull to the shape; 0: a flock without one")] = 1.0
    r0_rep: Annotated[float, Between(0.1, 50, "repulsion begins here [units]")] = 1.5
    p_rep: Annotated[float, Between(0, 4, "its slope [1/s]")] = 1.0
    r0_frict: Annotated[float, Between(0, 90, "friction: two stop this far apart [units]")] = 0.8
    c_frict: Annotated[float, Between(0, 1, "share of the excess velocity")] = 0.3
    v_frict: Annotated[float, Between(0, 4, "slack of velocities [units/s]")] = 0.1
    p_frict: Annotated[float, Between(0.05, 20, "gain of the braking curve [1/s]")] = 2.0
    a_frict: Annotated[float, Between(0.05, 10, "its acceleration [units/s2]")] = 0.5


def braking(room: float, a: float, p: float) -> float:
    """The fastest from which a vehicle stops within `room`: linear, then with acceleration a."""
    if room <= 0.0:
        return 0.0
    return room * p if room * p < a / p else math.sqrt(2.0 * a * room - a * a / (p * p))


def terms(me: Me, others: Others, p: Parameters, memory: Memory) -> LawTerms:
    error, total, count, push, slow = me.at - me.slot, 0j, 0, 0j, 0j
    for other in others:
        if other.neighbour:
            total += other.at - other.slot - error
            count += 1
        apart = me.at - other.at
        x = abs(apart)
        away = apart / x if x > 1e-9 else (1 + 0j if other.lower else -1 + 0j)
        if x < p.r0_rep:
            push += p.p_rep * (p.r0_rep - x) * away
        differs = other.flies - me.flies
        free = max(p.v_frict, braking(x - p.r0_frict, p.a_frict, p.p_frict))
        if abs(differs) > free:
            slow += p.c_frict * (abs(differs) - free) * differs / abs(differs)
    pull = p.gather * total / max(count, 1)
    pull *= me.speed / max(abs(pull), me.speed)
    if p.cruise > 0.0 and abs(me.flies) > 1e-9:
        pull += p.cruise * me.flies / abs(me.flies)
    return LawTerms(pull, push + slow)
