"""For tests: at each call another velocity that looks random; it never forms a shape."""

import cmath

from swarm_ctl.law import Annotated, Between, LawTerms, Me, Memory, NamedTuple, Others

FOR_TESTS = True
MEMORY = 1


class Parameters(NamedTuple):
    share: Annotated[float, Between(0, 1, "of the top speed")] = 1.0


def terms(me: Me, others: Others, p: Parameters, memory: Memory) -> LawTerms:
    memory[0] = (memory[0] * 5171.0 + me.id * 7919.0 + 12345.0) % 65536.0
    return LawTerms(p.share * me.speed * cmath.exp(1j * memory[0]), 0j)
