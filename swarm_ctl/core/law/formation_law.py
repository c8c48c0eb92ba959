"""What a formation law is to agents, forecasts and studies: one form for the paper's and for those
of users.

A law is called for one receiver (`core/kernel/receiver.py`), with its own numbers and its own
memory. `swarm_ctl/law_loader.py` makes one of a user's module.
"""

from __future__ import annotations

import math
from collections.abc import Callable, MutableSequence, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from swarm_ctl.core.kernel import law
from swarm_ctl.core.kernel.receiver import Known, Me

Form: TypeAlias = Callable[
    [Me, Sequence[Known], Any, MutableSequence[float], list[law.Pair]], tuple[complex, complex, int]
]
"""From the receiver, the others, the law's numbers and its memory to consensus, avoidance, and how
many of the pairs the law has filled anew: those that it tells of on the dashboard."""


def everywhere(_numbers: Any) -> float:
    """The reach of a law that is told of all others."""
    return math.inf


@dataclass(frozen=True, slots=True)
class FormationLaw:
    """A law that can be flown."""

    name: str
    form: Form
    numbers: Callable[..., Any]
    """The type of its numbers, a NamedTuple, in the order of the plan's parameters."""
    memory: int = 0
    """So many numbers it remembers from tick to tick, of each agent; 0.0 at first."""
    reach: Callable[[Any], float] = everywhere
    """By its numbers [units]: it is not told of others that are farther away and no neighbours."""
    iterates: bool = False
    """Its terms are displacements an iteration, as in the paper; else velocities [units/s]."""
    source: Any = None
    """A user's function as it was written, for studies to compile."""

    def rate(self, kappa: float) -> float:
        """What its terms are multiplied by to be velocities [units/s]."""
        return kappa if self.iterates else 1.0


def _r_out(numbers: law.Law) -> float:
    return numbers.r_out


PAPER: Final = FormationLaw("paper", law.terms, law.Law, reach=_r_out, iterates=True)
