"""Consensus with a leader: it stands where it is, the others take their places around it."""

from swarm_ctl.law import Annotated, Between, LawTerms, Me, Memory, NamedTuple, Others


class Parameters(NamedTuple):
    rate: Annotated[float, Between(0.05, 4, "[1/s] of the error that is left")] = 2.0
    leader: Annotated[float, Between(1, 65535, "the id of the agent that stands")] = 1.0


def terms(me: Me, others: Others, p: Parameters, memory: Memory) -> LawTerms:
    error, total, count = me.at - me.slot, 0j, 0.0
    for other in others:
        if other.neighbour:
            weight = 3.0 if other.id == p.leader else 1.0
            total += weight * (other.at - other.slot - error)
            count += weight
    if me.id == p.leader or count == 0.0:
        return LawTerms(0j, 0j)
    return LawTerms(p.rate * total / count, 0j)
