"""How old a state may be, and for how long an agent predicts from it. Seconds of mission time.

docs/look-up/timeouts.md has the table of all ages and time-outs, of other modules too: what happens
at each, and why the number is that number. A test holds its numbers to the code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

FRESH_S: Final = 0.5
"""A peer's state up to this age is used as it is."""
FAR_EVERY_S: Final = 0.5
"""Between two far words: the states of an agent as those peers hear them that are not near."""
FAR_LATE_S: Final = 1.0
"""By so much later a far peer counts as not fresh, not followed and lost: two periods, so that one
lost word changes nothing."""
PREDICT_S: Final = 0.3
"""A peer's stop point is carried on with its setpoint for at most so long."""
CALM: Final = 0.3
"""A consensus of `rate` [1/s] carries a peer's stop point on for at most CALM / rate seconds.

Each agent then adds rate * lead of its peers' setpoints to its own; a product near 1 oscillates. At
4 / s with states 0.15 s late, swarms of 30 never settled. 0.3 leaves room for vehicles that differ
from their models.
"""
NEIGHBOUR_S: Final = 1.0
"""The law follows a peer up to this age."""
LANDING_AT_MOST_S: Final = 180.0
"""An agent gives a vehicle up that is not on the ground, disarmed, after so long of landing. From
120 m at 1 m/s it takes 120 s."""
SILENT_FLIES_S: Final = 1.0
"""For so long the peers of a silent agent expect its vehicle to fly on: the longest
`setpoint_timeout_s` of all autopilots, because they do not know which it is."""
ESTIMATE_DOUBT_S: Final = 2.0
"""What a vehicle says against its own estimate counts after this time, and for so long after it was
last said: four reports at 2 Hz."""
OWN_FIX_S: Final = 0.5
"""With an own position older than this, the setpoint is zero."""
OWN_LOST_S: Final = 5.0
"""With an own position older than this, the agent lands."""
PARAMETER_READ_S: Final = 2.0
"""In flight an agent reads one of its vehicle's failsafe parameters again so often, one after the
other: a change that was not heard is found within six of these."""
KEYS_VALID_S: Final = 24 * 3600.0
"""No vehicle takes off with a certificate that ends sooner: a swarm has to be able to restart."""


def lead_s(rate: Any, least: Callable[[Any, Any], Any] = min) -> Any:
    """For how long [s] the law carries a peer's stop point on, at a consensus of `rate` [1/s].

    `least` is `np.minimum` for arrays.
    """
    return least(PREDICT_S, CALM / rate)
