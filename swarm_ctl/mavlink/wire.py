"""What carries the bytes of a vehicle's link: the contract, whom a wire with several senders
answers, and a wire in memory."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from typing import Any, Final, Protocol

SILENT_S: Final = 0.5
"""A place from which a vehicle was not heard for so long may lose it to another one: on an open
link a stranger that speaks as the vehicle must not take it from one that speaks 10 times a
second."""


class Wire(Protocol):
    """Non-blocking bytes both ways. `now` is the caller's clock [s]; errors are OSError.

    A wire that breaks opens again by itself. `system` is a vehicle's system id where several
    vehicles are behind the wire; 0 is the vehicle of a wire that has one.
    """

    warning: str = ""
    """What the operator should know of this wire, or ''."""
    trouble: str = ""
    """Why it carries nothing now, or ''; for wires that know."""
    port: int = 0
    """The own UDP port, where the wire has one from the start."""
    sources: int = 1
    """Senders whose chunks must not be mixed, at most."""
    source: int = 0
    """Which of them sent the last chunk."""

    def read(self, now: float) -> bytes | None:
        """The next pending chunk (a datagram, or a part of a stream), None when none is pending."""

    def write(self, data: bytes, now: float, system: int = 0) -> None:
        """Send a frame to a vehicle now, or drop it: no frame is kept to be sent later."""

    def confirm(self, system: int = 0, *, proven: bool = False) -> None:  # noqa: ARG002
        """The last chunk came from this vehicle: what is for the vehicle goes to its sender. For
        wires with a choice. `proven`: by a signature; else a vehicle stays where it is while it is
        heard from there."""
        return

    def close(self) -> None:
        """Idempotent."""
        return


class Partners:
    """Where each vehicle behind a wire was heard, by system id: an address, or a connection."""

    def __init__(self) -> None:
        self._addresses: dict[int, tuple[Any, float]] = {}

    def of(self, system: int) -> Any:
        """The place to send to; None before the vehicle was heard."""
        return self._addresses.get(system, (None, 0.0))[0]

    def silent_s(self, address: Any, now: float) -> float:
        """For how long no vehicle was heard at this place; infinite where none was."""
        heard = (last_s for each, last_s in self._addresses.values() if each == address)
        return now - max(heard, default=-math.inf)

    def hear(self, system: int, address: Any, now: float, *, proven: bool) -> Any:
        """A frame of the vehicle came from `address`; the place that it has left, or None."""
        known, last_s = self._addresses.get(system, (None, -math.inf))
        if known is not None and known != address and not proven and now - last_s < SILENT_S:
            return None
        self._addresses[system] = address, now
        return known if known is not None and self.silent_s(known, now) == math.inf else None

    def forget(self, gone: Collection[Any]) -> None:
        """These places exist no more."""
        for system in [s for s, (address, _) in self._addresses.items() if address in gone]:
            del self._addresses[system]


class MemoryWire(Wire):
    """One end of an in-memory wire, for tests on a virtual clock; keeps the newest chunks."""

    def __init__(self, inbox: deque[bytes], outbox: deque[bytes]) -> None:
        self._inbox = inbox
        self._outbox = outbox

    def read(self, now: float = 0.0) -> bytes | None:  # noqa: ARG002
        return self._inbox.popleft() if self._inbox else None

    def write(self, data: bytes, now: float = 0.0, system: int = 0) -> None:  # noqa: ARG002
        self._outbox.append(data)


def memory_wires(limit: int = 4096) -> tuple[MemoryWire, MemoryWire]:
    """Both ends of a wire in memory; each direction keeps the newest `limit` chunks."""
    one, two = deque[bytes](maxlen=limit), deque[bytes](maxlen=limit)
    return MemoryWire(one, two), MemoryWire(two, one)
