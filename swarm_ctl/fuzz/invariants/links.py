"""What an agent says of its links is so."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from swarm_ctl.fuzz.invariants.seen import Seen

_AGE_S: Final = 1.0
"""The age of a link is off by a status, and by what the mesh delays."""
_COUNTED: Final = 200
"""States are enough to know the share that is lost, within ..."""
_LOSS: Final = 0.05
_DUE: Final = 20
_LEAST_LOST: Final = 0.25
"""Where so many states are lost in the mean, fewer than this share never are."""


def links_are_told(seen: Seen) -> Iterator[str]:
    """The age of the link to an agent that is dead or stopped is as long as it has been so; and
    what the mesh loses is counted."""
    mesh = seen.flown.scenario.mesh
    if not seen.good_mesh or not seen.one_clock or seen.of("clock", "says", "part"):
        return
    for each in seen.of("kill", "stop"):
        gone = each.kill or each.stop or ()
        back_s = [b.at_s for b in seen.of("restart") if set(gone) & set(b.restart or ())]
        back_s = [at for at in back_s if at > each.at_s] + ([each.until_s] if each.for_s else [])
        until_s = min(back_s, default=math.inf)
        for agent in set(seen.ids).difference(*(b.kill or b.stop or () for b in seen.of(*_DEAD))):
            for status in seen.statuses[agent]:
                silent_s = status.time_s - each.at_s
                if not silent_s > _AGE_S or status.time_s >= until_s:
                    continue
                for lost in gone:
                    link = status.links.get(lost)
                    if link is None or link.age_s is None or link.age_s > silent_s - _AGE_S:
                        continue
                    yield (
                        f"agent {agent} says at {status.time_s:.1f} s that it heard agent {lost}"
                        f" {link.age_s:.1f} s ago, which was silent since {each.at_s:g} s"
                    )
                    return
    for agent, said in seen.statuses.items() if mesh.loss else ():
        for other, link in (said[-1].links if said else {}).items():
            due = link.received * mesh.loss / (1.0 - mesh.loss)
            if due >= _DUE and link.lost < _LEAST_LOST * due:
                yield (
                    f"agent {agent} says that {link.lost} of agent {other}'s states were lost, and"
                    f" about {due:.0f} were"
                )
    overtakes = mesh.jitter_s >= seen.plan.tick_s  # a state that is overtaken is lost, too
    if mesh.loss and not overtakes and not seen.of("kill", "stop", "restart", "vehicle"):
        for agent, said in seen.statuses.items():
            for other, link in (said[-1].links if said else {}).items():
                share = link.lost / max(1, link.lost + link.received)
                if link.received >= _COUNTED and abs(share - mesh.loss) > _LOSS + 0.5 * mesh.loss:
                    yield f"agent {agent} says that {share:.0%} of agent {other}'s states were lost"


_DEAD: Final = ("kill", "stop", "restart")
