"""Who hears one link of a vehicle. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from swarm_sim.network.sockets import Address

MAX_CLIENTS = 16
SILENT_S = 5.0
"""A client that was not heard for so long (mission time) gives its place to a new one."""


@dataclass(slots=True)
class _Client:
    heard_s: float
    proven: bool


class Clients:
    """At most `MAX_CLIENTS`. One that has signed (`proven`) takes the place of one that has not,
    and gives its own to none of those.

    `one_partner`: as a PX4 on UDP, which answers the first address alone, until it reboots.
    """

    def __init__(self, *, one_partner: bool = False) -> None:
        self.one_partner = one_partner
        self._clients: dict[Address, _Client] = {}

    def __iter__(self) -> Iterator[Address]:
        return iter(tuple(self._clients))

    def __contains__(self, address: Address) -> bool:
        return address in self._clients

    def __len__(self) -> int:
        return len(self._clients)

    def clear(self) -> None:
        """Forget all."""
        self._clients.clear()

    def hear(self, sender: Address, now_s: float, *, proven: bool) -> Address:
        """A datagram of `sender`; the address that it is answered to, if that is a client."""
        known = self._clients.get(sender)
        if known is not None:
            known.heard_s, known.proven = now_s, known.proven or proven
        elif self._has_room(now_s, proven=proven):
            self._clients[sender] = _Client(now_s, proven)
        return next(iter(self._clients)) if self.one_partner else sender

    def _has_room(self, now_s: float, *, proven: bool) -> bool:
        """There is a place, or one that is given up now."""
        if len(self._clients) < (1 if self.one_partner else MAX_CLIENTS):
            return True
        longest = sorted(self._clients, key=lambda each: self._clients[each].heard_s)
        for address in longest:
            old = self._clients[address]
            silent = not self.one_partner and now_s - old.heard_s > SILENT_S
            if proven > old.proven or (silent and proven >= old.proven):
                del self._clients[address]
                return True
        return False
