"""Who hears one link of a vehicle. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from swarm_sim.network.sockets import Address

MAX_CLIENTS = 16
SILENT_S = 5.0
"""A client that was not heard for so long (mission time) gives its place to a new one."""
FORGET_S = 60.0
"""One that was not heard for so long gets nothing more."""


@dataclass(slots=True)
class _Client:
    heard_s: float
    proven: bool
    stays: bool
    """It is there by configuration: not forgotten."""


class Clients:
    """At most `MAX_CLIENTS`. One that has signed (`proven`) takes the place of one that has not,
    and gives its own to none of those. On a signed link of which others are not `local`, they get
    nothing at all.

    `one_partner`: as a PX4 on UDP, which answers the first address alone, until it reboots.
    `connected`: clients of a TCP port, which are there as long as their connection.
    """

    def __init__(self, *, one_partner: bool = False, connected: bool = False) -> None:
        self.one_partner = one_partner
        self.connected = connected
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

    def hear(
        self,
        sender: Address,
        now_s: float,
        *,
        proven: bool,
        signed: bool = False,
        stays: bool = False,
    ) -> Address:
        """A datagram of `sender`; the address that it is answered to, if that is a client.

        `signed`: the vehicle obeys only who has its key. Of others, it serves those of its own
        computer, where a ground station's relay listens without a key.
        """
        known = self._clients.get(sender)
        if known is not None:
            known.heard_s, known.proven = now_s, known.proven or proven
        elif (proven or stays or not signed or _local(sender)) and self._has_room(
            now_s, proven=proven
        ):
            self._clients[sender] = _Client(now_s, proven, stays)
        return next(iter(self._clients), sender) if self.one_partner else sender

    def keep(self, peers: Collection[Address]) -> None:
        """Of connections, those that are still there."""
        if self.connected:
            for address in self._clients.keys() - set(peers):
                del self._clients[address]

    def forget(self, now_s: float, *, signed: bool) -> None:
        """Those that have fallen silent and, on a link that is signed by now, strangers. One
        partner and connections may be silent."""
        for address, client in tuple(self._clients.items()):
            may_be_silent = self.one_partner or self.connected
            silent = now_s - client.heard_s > FORGET_S and not may_be_silent
            strange = signed and not client.proven and not _local(address)
            if (silent or strange) and not client.stays:
                del self._clients[address]

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


def _local(address: Address) -> bool:
    """A program of this computer."""
    return address[0].startswith("127.")
