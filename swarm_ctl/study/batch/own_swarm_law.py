"""An own law for many whole swarms at once, beside `swarm_law.SwarmLaw`, the paper's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from swarm_ctl.core.law.swarm_law import NearPairs, SwarmLaw, SwarmTerms
from swarm_ctl.core.model.arrays import Bools, Floats
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.own_laws import law_of


def swarm_law(slots: Floats, links: Bools, h: Floats, law: LawParameters) -> SwarmLaw:
    """The law of m missions that `law` names; arguments as `SwarmLaw`."""
    return (OwnSwarmLaw if law.own else SwarmLaw)(slots, links, h, law)


class OwnSwarmLaw(SwarmLaw):
    """Calls the own law once an iteration, with the leading axes (missions, agents). It reports no
    pairs."""

    def __init__(self, slots: Floats, links: Bools, h: Floats, law: LawParameters) -> None:
        super().__init__(slots, links, h, law)
        self._function = law_of(law)
        each: Any = h[:, None]
        self._parameters = replace(law, h=each)
        self._others = ~np.eye(len(links), dtype=np.bool_)
        self._lower = np.triu(self._others)

    def only(self, missions: Bools) -> OwnSwarmLaw:
        """The same for some of the missions."""
        kept = self.slots[..., missions], self.links[..., missions], self.h[missions]
        return OwnSwarmLaw(*kept, self.law)

    def step(self, points: Floats) -> tuple[Floats, NearPairs | None]:
        """See `SwarmLaw.step`."""
        slots = self.slots
        terms = self.step_heard(points, points[:, None], slots, slots[:, None])
        return terms.consensus + terms.avoidance, None

    def step_heard(
        self, points: Floats, heard: Floats, slots: Floats, told_slots: Floats
    ) -> SwarmTerms:
        """See `SwarmLaw.step_heard`."""
        every = (2, *self.links.shape)
        others, other_slots = (
            np.broadcast_to(told, every).transpose(3, 1, 2, 0) for told in (heard, told_slots)
        )
        linked = self.links.transpose(2, 0, 1)
        result = self._function(
            points.transpose(2, 1, 0),
            slots.transpose(2, 1, 0),
            others,
            other_slots,
            linked,
            np.broadcast_to(self._others, linked.shape),
            np.broadcast_to(self._lower, linked.shape),
            self._parameters,
        )
        return SwarmTerms(
            result.consensus.transpose(2, 1, 0),
            result.avoidance.transpose(2, 1, 0),
            None,
            np.broadcast_to(heard - told_slots, every),
        )
