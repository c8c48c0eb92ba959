"""Slot exchange (`core.swarm.exchange_protocol`) in a batch: who has which slots, and what is heard
of it."""

from __future__ import annotations

from dataclasses import fields
from typing import Final

import numpy as np

from swarm_ctl.core.model.timeouts import FRESH_S
from swarm_ctl.core.swarm.exchange_protocol import EVERY_S, ExchangeProtocol, ExchangeStates, Ints
from swarm_ctl.study.batch.batch import Batch, Bools, Floats
from swarm_ctl.study.batch.lossy_channel import Told

_KEPT: Final = 64
"""Looks that are remembered: no news is older, but that of the silent, who have changed nothing
since."""


class BatchSlotExchange:
    """All exchanges of a batch."""

    def __init__(self, batch: Batch) -> None:
        n = batch.starts.shape[1]
        self._every = max(1, round(EVERY_S / batch.cell.tick_s))
        self._tick_s = batch.cell.tick_s
        self._exchange = ExchangeProtocol(np.arange(n), batch.slots, batch.links, batch.cell.law.r)
        self._history = np.stack([self._said()] * _KEPT)
        """(looks, fields, n, m), a ring."""
        self.slots, self.told_slots = batch.slots, batch.slots[:, None]
        """Of everybody as it is, (2, n, m), and as it is heard, (2, receivers, n, m)."""

    @property
    def count(self) -> Ints:
        """Exchanges so far, (m,)."""
        total: Ints = self._exchange.count.sum(axis=0) // 2
        return total

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        self._exchange.only(missions)
        for name in ("_history", "slots", "told_slots"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[..., missions]))

    def look(self, tick: int, points: Floats, told: Told, talks: Bools) -> None:
        """Take part, if it is time; afterwards `slots` and `told_slots` hold."""
        look, between = divmod(tick, self._every)
        if between:
            return
        deals = self._exchange.deals
        heard = self._heard(look, tick, told)
        n, m = deals.role.shape
        wide = (n, n, m)
        age_s = np.broadcast_to(told.age_s, wide)
        fresh = (age_s <= FRESH_S) & ~np.eye(n, dtype=np.bool_)[..., None]
        before = self._said()
        at = np.broadcast_to(told.carried(), (2, *wide))
        self._exchange.step(tick * self._tick_s, points, at, heard, age_s, fresh)
        self._silence(before, talks)
        self._history[look % _KEPT] = self._said()
        self.slots = self._slots_of(deals.role)
        self.told_slots = self._slots_of(heard.role)

    def _said(self) -> Ints:
        return np.stack([getattr(self._exchange.deals, f.name) for f in fields(ExchangeStates)])

    def _silence(self, before: Ints, talks: Bools) -> None:
        """Who is silent decides nothing."""
        for old, f in zip(before, fields(ExchangeStates), strict=True):
            setattr(
                self._exchange.deals,
                f.name,
                np.where(talks, getattr(self._exchange.deals, f.name), old),
            )

    def _heard(self, look: int, tick: int, told: Told) -> ExchangeStates:
        """What each receiver knows of each sender's deals, by the age of the news; (n, n, m)
        each."""
        n, m = self._exchange.deals.role.shape
        sent = tick - np.rint(told.age_s / self._tick_s).astype(np.intp)
        at = np.clip((sent - 1) // self._every, max(0, look - _KEPT + 1), None) % _KEPT
        heard = self._history[at, :, np.arange(n)[:, None], np.arange(m)]
        return ExchangeStates(
            *np.broadcast_to(np.moveaxis(heard, -1, 0), (len(fields(ExchangeStates)), n, n, m))
        )

    def _slots_of(self, roles: Ints) -> Floats:
        z, mission = self._exchange.slots, np.arange(roles.shape[-1])
        return np.stack((z[0, roles, mission], z[1, roles, mission]))
