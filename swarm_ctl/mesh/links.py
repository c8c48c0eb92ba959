"""The links of one zenoh session, by the name in the certificate at their other end.

zenoh bounds the links of a session in all, and none by name: one member, a screen even, could take
all of them, and no operator would be heard. So each link is counted as it comes, and of a name that
has too many the new one is ended, by its socket: zenoh itself ends none.
"""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import stat
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.messages import Refusal, RefusalReason
from swarm_ctl.mesh.refusals import Refusals

OF_A_NAME: Final = 8
"""An agent and a router need one, and one more for each that was cut and has not timed out; an
operator one for each station, `run` and `send`; a viewer one for each screen."""


class Links:
    """`heard` is called on zenoh's thread, `refused` on the owner's."""

    def __init__(self) -> None:
        self._links: dict[str, set[tuple[str, str]]] = {}
        """(zenoh's id, address) of the other ends, by name."""
        self._new: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._refusals = Refusals()

    def heard(self, link: Any, *, ended: bool) -> None:
        """A link came, or went. One of an open mesh has no name, and is not counted: there each may
        speak as any other."""
        name, key = link.auth_identifier, (str(link.zid), str(link.dst))
        if name is None:
            return
        found = self._links.setdefault(name, set())
        if ended:
            found.discard(key)
            if not found:
                del self._links[name]
            return
        found.add(key)
        if len(found) > OF_A_NAME:
            _end(key[1])
            with self._lock:
                self._new[name] += 1

    def refused(self, now: float) -> tuple[Refusal, ...]:
        """The names with too many in the last seconds; new ones count from `now` [s]."""
        with self._lock:
            new, self._new = self._new, Counter()
        for name, count in new.items():
            words = f"a link: {name} has {OF_A_NAME} already, which is all that a member may have"
            self._refusals.add(name, RefusalReason.LINK, words, now, count)
        return self._refusals.recent(now)


def stream_sockets() -> Iterator[socket.socket]:
    """This process's TCP sockets, zenoh's among them; each is closed again, which ends no link."""
    for entry in list(Path("/dev/fd").iterdir()):
        with contextlib.suppress(OSError):  # closed meanwhile
            if stat.S_ISSOCK(os.fstat(int(entry.name)).st_mode):
                with socket.socket(fileno=os.dup(int(entry.name))) as one:
                    inet = one.family in (socket.AF_INET, socket.AF_INET6)
                    if inet and one.type == socket.SOCK_STREAM:
                        yield one


def _end(locator: str) -> None:
    """Shut the connection with the other end at `tls/127.0.0.1:32872`. A QUIC link has no socket of
    its own, and stays: it is told all the same."""
    host, _, port = locator.partition("/")[2].partition("?")[0].rpartition(":")
    for one in stream_sockets():
        with contextlib.suppress(OSError, ValueError):
            there = one.getpeername()
            if there[1] == int(port) and _same(there[0], host):
                one.shutdown(socket.SHUT_RDWR)


def _same(one: str, other: str) -> bool:
    return ipaddress.ip_address(one) == ipaddress.ip_address(other.strip("[]"))
