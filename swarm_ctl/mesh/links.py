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
from collections.abc import Set as AbstractSet
from typing import Any, Final

from swarm_ctl.core.model.messages import Refusal, RefusalReason
from swarm_ctl.mesh.gate import Refusals

OF_A_NAME: Final = 8
"""An agent and a router need one, and one more for each that was cut and has not timed out; an
operator one for each station, `run` and `send`; a viewer one for each screen."""
_PAUSE_WALL_S: Final = 0.05
"""Between two looks at all sockets: in a flood of links, one look is for many."""
_RECEIVED_AT: Final = 128
"""Of linux/tcp.h's tcp_info: the bytes that have come, 64 bits."""
_BRINGS: Final = 3
"""Links that are named at most."""


class Links:
    """`heard` is called on zenoh's thread, and never waits: a look at all sockets takes
    milliseconds, and while it went on there, links came faster than they were ended. `refused` and
    `busiest` are called on the owner's thread, by whose clock (`now`) links bring so much a second.
    `tend` gets the socket of each new link."""

    def __init__(
        self,
        now: Callable[[], float] = lambda: 0.0,
        tend: Callable[[socket.socket], None] = lambda _: None,
    ) -> None:
        self._now, self._tend = now, tend
        self._links: dict[str, set[tuple[str, str]]] = {}
        """(zenoh's id, address) of the other ends, by name."""
        self._came: dict[tuple[str, int], tuple[str, float, int]] = {}
        """(name or '', since when [s], bytes until then) by the other end's address."""
        self._new: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._refusals = Refusals()
        self._excess: set[tuple[str, int]] = set()
        """The other ends of links that are to be ended."""
        self._wake, self._over = threading.Event(), threading.Event()
        # zenoh calls nothing on it, so it may be cut off where the process ends without `close`
        self._worker = threading.Thread(target=self._look_after, name="links", daemon=True)
        self._worker.start()

    def close(self) -> None:
        """Look after them no more."""
        self._over.set()
        self._wake.set()
        self._worker.join()

    def heard(self, link: Any, *, ended: bool) -> None:
        """A link came, or went. One of an open mesh has no name, and is not counted: there each may
        speak as any other."""
        name, key = link.auth_identifier, (str(link.zid), str(link.dst))
        address = _address(key[1])
        with self._lock:
            if ended:
                self._came.pop(address, None)
                self._excess.discard(address)
            else:
                self._came[address] = (name or "", self._now(), 0)
            if name is not None and self._too_many(name, key, ended=ended):
                self._excess.add(address)
                self._new[name] += 1
        if not ended:
            self._wake.set()

    def _too_many(self, name: str, key: tuple[str, str], *, ended: bool) -> bool:
        found = self._links.setdefault(name, set())
        if ended:
            found.discard(key)
            if not found:
                del self._links[name]
            return False
        found.add(key)
        return len(found) > OF_A_NAME

    def _look_after(self) -> None:
        sockets = Sockets()
        while not self._over.is_set():
            self._wake.wait()
            self._wake.clear()
            with self._lock:
                excess, self._excess = self._excess, set()
            sockets.look(self._tend)
            sockets.shut(excess)
            self._over.wait(_PAUSE_WALL_S)

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
    for one in _stream_sockets():
        with contextlib.suppress(OSError, ValueError, struct.error):  # closed; an old kernel
            there = one.getpeername()
            told = one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _RECEIVED_AT + 8)
            yield (_plain(there[0]), there[1]), struct.unpack_from("=Q", told, _RECEIVED_AT)[0]


def _stream_sockets() -> Iterator[socket.socket]:
    """This process's TCP sockets, zenoh's among them; each is closed again, which ends no link."""
    for descriptor in _descriptors():
        with contextlib.suppress(OSError):  # closed meanwhile
            if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                with socket.socket(fileno=os.dup(descriptor)) as one:
                    if _is_stream(one):
                        yield one


class Sockets:
    """This process's TCP sockets, each looked at once: a look at 400 took 11 ms.

    A QUIC link has no socket of its own, and is not found."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[int, tuple[str, int] | None]] = {}
        """By inode, which no later socket has again: the descriptor, and the other end; None: it
        has none, and never will."""

    def look(self, new: Callable[[socket.socket], None]) -> None:
        """Call `new` with each socket that came since the last call; it is closed again, which ends
        no link."""
        before, self._known = self._known, {}
        for descriptor in _descriptors():
            with contextlib.suppress(OSError, ValueError):  # closed meanwhile; not connected yet
                told = os.fstat(descriptor)
                if not stat.S_ISSOCK(told.st_mode):
                    continue
                known = before.get(told.st_ino)
                there = known[1] if known is not None else self._look_at(descriptor, new)
                self._known[told.st_ino] = descriptor, there

    def _look_at(
        self, descriptor: int, new: Callable[[socket.socket], None]
    ) -> tuple[str, int] | None:
        with socket.socket(fileno=os.dup(descriptor)) as one:
            if not _is_stream(one):
                return None
            new(one)
            there = one.getpeername()
            return _plain(there[0]), there[1]

    def shut(self, addresses: AbstractSet[tuple[str, int]]) -> None:
        """End the connections with these other ends, as of the last look."""
        if not addresses:
            return
        for inode, (descriptor, there) in self._known.items():
            if there in addresses:
                with contextlib.suppress(OSError):  # closed meanwhile
                    if os.fstat(descriptor).st_ino == inode:
                        with socket.socket(fileno=os.dup(descriptor)) as one:
                            one.shutdown(socket.SHUT_RDWR)


def _descriptors() -> list[int]:
    """Of all that this process has open."""
    return [int(entry.name) for entry in os.scandir("/dev/fd")]


def _is_stream(one: socket.socket) -> bool:
    return one.family in (socket.AF_INET, socket.AF_INET6) and one.type == socket.SOCK_STREAM


def _address(locator: str) -> tuple[str, int]:
    """Host and port of `tls/127.0.0.1:32872`; a port of 0: it is none of these."""
    host, _, port = locator.partition("/")[2].partition("?")[0].rpartition(":")
    with contextlib.suppress(ValueError):
        return _plain(host.strip("[]")), int(port)
    return locator, 0


def _plain(host: str) -> str:
    """One spelling of an address. ValueError: it is none."""
    return str(ipaddress.ip_address(host))
