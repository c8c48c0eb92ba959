"""A shape that closes its gaps: who of those that are left flies to which place of the smaller one.

Each agent works it out for itself, from the plan and from who is left, so that all find the same.
"""

from __future__ import annotations

from collections.abc import Sequence

from swarm_ctl.core.model.geometry import Point, centred


def dealt(slots: Sequence[Point], places: Sequence[Point]) -> list[int]:
    """For each slot, the index of the place that its agent takes: near ones first, then exchanged
    in pairs while the sum of the squared ways falls.

    Args:
        slots: of the agents that are left, in the whole shape [units].
        places: of the smaller shape, as many.
    """
    ways = [complex(*slot) for slot in centred(slots)]
    ends = [complex(*place) for place in centred(places)]
    cost = [[round(abs(end - at) ** 2, 9) for end in ends] for at in ways]
    count = range(len(ways))
    found, taken = [-1] * len(ways), set[int]()
    for _, k, place in sorted((cost[k][place], k, place) for k in count for place in count):
        if found[k] < 0 and place not in taken:
            found[k] = place
            taken.add(place)
    better = True
    while better:
        better = False
        for a in count:
            for b in range(a + 1, len(ways)):
                now = cost[a][found[a]] + cost[b][found[b]]
                if cost[a][found[b]] + cost[b][found[a]] < now - 1e-6:
                    found[a], found[b] = found[b], found[a]
                    better = True
    return found
