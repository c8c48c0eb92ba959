"""A plain potential field (Khatib 1986): pulled to the shape, pushed by all that is near."""

from swarm_ctl.law import Annotated, Between, LawTerms, Me, Memory, NamedTuple, Others


class Parameters(NamedTuple):
    rate: Annotated[float, Between(0.05, 4, "[1/s] of the error that is left")] = 1.0
    push: Annotated[float, Between(0, 10, "of the field [units^4/s]")] = 0.5
    width: Annotated[float, Between(0.1, 50, "it is felt so near [units]")] = 1.5


def reach(p: Parameters) -> float:
    return p.width


def terms(me: Me, others: Others, p: Parameters, memory: Memory) -> LawTerms:
    error, total, count, push = me.at - me.slot, 0j, 0, 0j
    for other in others:
        if other.neighbour:
            total += other.at - other.slot - error
            count += 1
        apart = me.at - other.at
        x = max(abs(apart), 1e-2)
        if abs(apart) < 1e-9:
            apart = 1e-2 + 0j if other.lower else -1e-2 + 0j
        if x < p.width:
            push += p.push * (1 / x - 1 / p.width) / (x * x) * apart / x
    most = me.speed / max(abs(push), me.speed)
    return LawTerms(p.rate * total / max(count, 1), push * most)
