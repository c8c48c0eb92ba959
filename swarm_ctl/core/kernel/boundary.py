"""Where near peers end and far ones begin; `core/swarm/hearing.py` has the reasons."""

from __future__ import annotations

from typing import Final, NamedTuple

from swarm_ctl.core.model.timeouts import FAR_EVERY_S

FOLLOW_TICKS: Final = 5
"""From the decision to follow a peer to the first tick whose state of that peer is heard. In
lockstep always; in real time the mesh's word arrives within, even on a busy machine."""
LOOK_S: Final = 0.25
"""Between two looks at which peers are near."""
_ARRIVES_TICKS: Final = 2
"""From a state to the tick that goes by it."""
KEPT_S: Final = 3.0
"""A peer that is near no more is heard for so long: a subscription that ends and begins again costs
more than twenty states."""


class Boundary(NamedTuple):
    """Between near and far."""

    within_m: float
    speed_mps: float
    silent_s: float
    """So long a silence the mission bears."""


def boundary_of(
    reach_m: float, jump_m: float, speed_mps: float, tick_s: float, silent_s: float
) -> Boundary:
    """The boundary of agents that mind others within `reach_m`.

    Args:
        reach_m: an aircraft whose stop point is farther away constrains nothing.
        jump_m: a stop point may be corrected by so much.
        speed_mps: top speed.
        tick_s: of the agents.
        silent_s: so long a silence the mission bears.
    """
    acts_s = LOOK_S + (FOLLOW_TICKS + _ARRIVES_TICKS) * tick_s
    return Boundary(reach_m + jump_m + 2.0 * speed_mps * acts_s, speed_mps, silent_s)


def near_m(age_s: float, boundary: Boundary) -> float:
    """A peer whose newest word was true `age_s` ago is near if the stop point that it told is no
    farther away.

    A far word is as old as its period just before the next one, so younger ones count as that old.
    A peer that is silent for longer than the mission bears has been given up by then.
    """
    flown_s = min(max(age_s, FAR_EVERY_S), boundary.silent_s)
    return boundary.within_m + boundary.speed_mps * flown_s
