"""Which failsafe parameters a firmware needs in which state before a flight. Pure."""

from __future__ import annotations

from dataclasses import dataclass

OPTIONAL_RETRY_S = 0.15
"""Vehicles do not answer for a parameter that they do not have. A short interval: all that is to be
asked before the flight waits for the last of these."""
OPTIONAL_ASKS = 8
"""Lost in a row only once in 200 times even where every third frame is lost."""
OPTIONAL_ANSWER_S = 0.5
"""For the answer to the last one."""


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """What one parameter has to be while we fly the vehicle."""

    name: str
    value: float
    at_most: bool = False
    """The vehicle's own value stays where it is smaller."""
    as_delivered: bool = False
    """A new vehicle has this value, too: to find it tells nothing of an earlier flight."""
    optional: bool = False
    """Not every version of the firmware has it."""
    group: str = ""
    """Of the optional parameters of one group, each version has one."""

    @property
    def telling(self) -> bool:
        """A vehicle that has this value has had an agent."""
        return not (self.at_most or self.as_delivered)

    def wanted(self, own: float) -> float:
        """What it shall be, where the vehicle has `own`."""
        return min(own, self.value) if self.at_most else self.value
