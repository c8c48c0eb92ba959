"""The links of one zenoh session, by the name in the certificate at their other end.

zenoh bounds the links of a session in all, and none by name: one member, a screen even, could take
all of them, and no operator would be heard. So each link is counted as it comes, and of a name that
has too many the new one is ended, by its socket: zenoh itself ends none.

zenoh does not say either which link a message came by. The kernel counts the bytes of each, so of a
flood it is known which links bring it.
"""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import stat
import struct
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.messages import Refusal, RefusalReason
from swarm_ctl.mesh.refusals import Refusals

OF_A_NAME: Final = 8
"""An agent and a router need one, and one more for each that was cut and has not timed out; an
operator one for each station, `run` and `send`; a viewer one for each screen."""


_RECEIVED_AT: Final = 128
"""Of linux/tcp.h's tcp_info: the bytes that have come, 64 bits."""
_BRINGS: Final = 3
"""Links that are named at most."""


class Links:
    """`heard` is called on zenoh's thread, `refused` and `busiest` on the owner's, by whose clock
    (`now`) links bring so much a second."""

    def __init__(self, now: Callable[[], float] = lambda: 0.0) -> None:
        self._now = now
        self._links: dict[str, set[tuple[str, str]]] = {}
        """(zenoh's id, address) of the other ends, by name."""
        self._came: dict[tuple[str, int], tuple[str, float, int]] = {}
        """(name or '', since when [s], bytes until then) by the other end's address."""
        self._new: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._refusals = Refusals()

    def heard(self, link: Any, *, ended: bool) -> None:
        """A link came, or went. One of an open mesh has no name, and is not counted: there each may
        speak as any other."""
        name, key = link.auth_identifier, (str(link.zid), str(link.dst))
        address = _address(key[1])
        with self._lock:
            if ended:
                self._came.pop(address, None)
            else:
                self._came[address] = (name or "", self._now(), 0)
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

    def busiest(self) -> str:
        """`the link of 127.0.0.1:43210`: those that brought most bytes a second since the last
        call, or since they came. '': the kernel does not count them."""
        if not sys.platform.startswith("linux"):
            return ""
        now, received = self._now(), dict(_received())
        found: list[tuple[float, str]] = []
        with self._lock:
            for at, (name, since_s, before) in self._came.items():
                if at in received:
                    words = f"{name} at {at[0]}:{at[1]}" if name else f"{at[0]}:{at[1]}"
                    found.append(((received[at] - before) / max(now - since_s, 0.1), words))
                    self._came[at] = (name, now, received[at])
        most = max((rate for rate, _ in found), default=0.0)
        bring = [words for rate, words in sorted(found, reverse=True) if rate > 0.5 * most]
        if not bring:
            return ""
        more = f" and {len(bring) - _BRINGS} more" if len(bring) > _BRINGS else ""
        return f"the link{'s' * (len(bring) > 1)} of {', '.join(bring[:_BRINGS])}{more}"


def _received() -> Iterator[tuple[tuple[str, int], int]]:
    """The bytes that have come from each address by this process's TCP sockets."""
    for one in stream_sockets():
        with contextlib.suppress(OSError, ValueError, struct.error):  # closed; an old kernel
            there = one.getpeername()
            told = one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _RECEIVED_AT + 8)
            yield (_plain(there[0]), there[1]), struct.unpack_from("=Q", told, _RECEIVED_AT)[0]


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
    address = _address(locator)
    for one in stream_sockets():
        with contextlib.suppress(OSError, ValueError):
            there = one.getpeername()
            if (_plain(there[0]), there[1]) == address:
                one.shutdown(socket.SHUT_RDWR)


def _address(locator: str) -> tuple[str, int]:
    """Host and port of `tls/127.0.0.1:32872`; a port of 0: it is none of these."""
    host, _, port = locator.partition("/")[2].partition("?")[0].rpartition(":")
    with contextlib.suppress(ValueError):
        return _plain(host.strip("[]")), int(port)
    return locator, 0


def _plain(host: str) -> str:
    """One spelling of an address. ValueError: it is none."""
    return str(ipaddress.ip_address(host))
