"""What a formation law is given: the agent that it steers, and a row for each other aircraft.

Every law has this one form, the paper's (`core/kernel/law.py`) and those of users, in flight, in
studies and in forecasts. Vectors are north + 1j * east [units]; velocities are units a second.
"""

from __future__ import annotations

from typing import Final, NamedTuple

_FARTHEST: Final = 1e6
"""[units]: of a law that reaches everywhere."""


class Me(NamedTuple):
    """The receiver: the agent whose terms are asked for."""

    id: int
    at: complex
    """Its stop point; with `compensation: none` its position."""
    slot: complex
    """Where it belongs in the shape. Only differences of slots count."""
    flies: complex
    """The velocity that it was told to fly last."""
    speed: float
    """The speed limit."""
    tick_s: float
    """Between two calls."""
    gain: float
    """kappa * h of the mission [1/s], less where the vehicle is too slow for it."""
    r: float
    """Interaction range."""
    r_out: float
    r_in: float


class Known(NamedTuple):
    """One other aircraft, as the receiver knows of it."""

    id: int
    """0: traffic, which is no agent."""
    at: complex
    """Its stop point, carried on to now; of old news, as it was told."""
    slot: complex
    """Read it only where `neighbour`."""
    flies: complex
    """The velocity that it was told to fly."""
    age_s: float
    """Of that news."""
    neighbour: bool
    """It is in N_i, is heard, and flies the same formation."""
    lower: bool
    """The receiver has the lower id of the two: decides which way two on one spot part."""


def out_of_reach(away: complex, reach: float) -> complex:
    """How far the point and the slot of a neighbour are moved that is apart by height, for the law
    to see it beyond its reach: their difference, and so the shape, stays.

    `away` points to it from the receiver.
    """
    far = min(reach, _FARTHEST)
    return far * (away / abs(away)) if away != 0j else complex(far, 0.0)


class LawTerms(NamedTuple):
    """What a law answers, each a velocity; their sum is the wish that the filter gets. What a
    vehicle must do to keep apart belongs into `avoidance`: in a return or a landing that term is
    flown alone."""

    consensus: complex
    """Towards the shape."""
    avoidance: complex
    """Away from others."""


NO_ONE: Final = Known(id=0, at=0j, slot=0j, flies=0j, age_s=0.0, neighbour=False, lower=False)
SOMEONE: Final = Me(
    id=1, at=0j, slot=0j, flies=0j, speed=1.0, tick_s=0.05, gain=4.0, r=4.5, r_out=1.5, r_in=0.5
)
"""A receiver of a usual mission, five metres a unit."""
