"""Slot exchange (`core.swarm.exchange_protocol`) in a batch: which agent has which slot, and
what is heard of it."""

from __future__ import annotations

from dataclasses import fields
from typing import Final

import numpy as np

from swarm_ctl.core.model.arrays import Bools, Floats, Ints, keep_missions
from swarm_ctl.core.model.timeouts import PREDICT_S
from swarm_ctl.core.swarm.exchange_protocol import EVERY_S, ExchangeProtocol, ExchangeStates
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.lossy_channel import HeardStates

_KEPT: Final = 64
"""Looks that are remembered: no news is older, but that of silent agents, which have changed
nothing since."""
_FIELDS: Final = tuple(f.name for f in fields(ExchangeStates))


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
        """Each agent's slot as it is (2, n, m), and as it is heard (2, receivers, n, m)."""

    @property
    def count(self) -> Ints:
        """Exchanges so far, (m,)."""
        total: Ints = self._exchange.count.sum(axis=0) // 2
        return total

    @property
    def partners(self) -> Bools:
        """Which agents an agent's offer, answer or lock is about (n, n, m)."""
        said, n = self._exchange.states, len(self._exchange.states.role)
        places = np.arange(n)[:, None]
        found: Bools = np.zeros((n, n, said.role.shape[1]), dtype=np.bool_)
        for about in (said.offer_to, said.answer_to, said.lock):
            found |= about[:, None] == places
        itself = np.arange(n)
        found[itself, itself] = False
        return found

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        self._exchange.only(missions)
        keep_missions(self, missions, "_history", "slots", "told_slots")

    def look(self, tick: int, points: Floats, heard: HeardStates, live: Bools) -> bool:
        """Take part, if it is time: then `slots` and `told_slots` are new, and it is True."""
        look, between = divmod(tick, self._every)
        if between:
            return False
        states = self._exchange.states
        told = self._told(look, tick, heard)
        n, m = states.role.shape
        wide = (n, n, m)
        age_s = np.broadcast_to(heard.age_s, wide)
        fresh = heard.fresh & ~np.eye(n, dtype=np.bool_)[..., None]
        before = self._said()
        at = np.broadcast_to(heard.carried(PREDICT_S), (2, *wide))
        self._exchange.step(tick * self._tick_s, points, at, told, age_s, fresh)
        # a silent agent decides nothing
        for old, name in zip(before, _FIELDS, strict=True):
            setattr(states, name, np.where(live, getattr(states, name), old))
        self._history[look % _KEPT] = self._said()
        self.slots = self._exchange.slots_of(states.role)
        self.told_slots = self._exchange.slots_of(told.role)
        return True

    def _said(self) -> Ints:
        return np.stack([getattr(self._exchange.states, name) for name in _FIELDS])

    def _told(self, look: int, tick: int, heard: HeardStates) -> ExchangeStates:
        """What each receiver knows of each sender's exchanges, by the age of the news; (n, n, m)
        each."""
        n, m = self._exchange.states.role.shape
        sent = tick - np.rint(heard.age_s / self._tick_s).astype(np.intp)
        # what is sent in a tick was decided at a look before it
        at = np.clip((sent - 1) // self._every, look - _KEPT + 1, None) % _KEPT
        told = self._history[at, :, np.arange(n)[:, None], np.arange(m)]
        return ExchangeStates(*np.broadcast_to(np.moveaxis(told, -1, 0), (len(_FIELDS), n, n, m)))
