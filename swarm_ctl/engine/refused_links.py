"""Links to the mesh that zenoh refused: it tells no program of them, but writes them into its log.

zenoh logs to the process's standard output. `reading_log` puts a pipe there, reads zenoh's lines on
them, and copies all else on to where it went before.
"""

from __future__ import annotations

import os
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

from swarm_ctl.core.model.messages import Refusal, RefusalReason
from swarm_ctl.mesh.gate import Refusals
from swarm_ctl.mesh.zenoh_config import log_refused_links
from swarm_ctl.trust.identity import Identity

_STDOUT: Final = 1
_LINE: Final = re.compile(rb"zenoh_link_tls|zenoh_link_commons::quic|interceptor::access_control")
_CHUNK: Final = 1 << 16
_NO_TLS: Final = "the other end speaks no TLS: it flies without trust, or is no agent"
_WHY: Final = (
    (b"peer sent no certificates", "the other end has no certificate"),
    (b"InvalidContentType", _NO_TLS),
    (b"corrupt message", _NO_TLS),  # bytes that look like another part of a TLS record
    (b"certificate expired", "the other end's certificate has expired, by this host's clock"),
    (b"not valid yet", "the other end's certificate is not valid yet, by this host's clock"),
    (b"alert: CertificateExpired", "the other end finds our certificate expired, by its clock"),
    (b"fatal alert", "the other end does not trust our CA: it is of another swarm, or of old keys"),
    (b"invalid peer certificate", "another CA issued the other end's certificate"),
    (b"did not match any configured ACL", "the roster of this epoch does not name the other end"),
    (b"handshake eof", "the other end broke off the handshake"),
)
"""Parts of a line of zenoh 1.10 (rustls), the first that fits, and what they mean."""
_OTHER: Final = "the TLS handshake failed"


class RefusedLinks:
    """What was read, by reason. `read` and `refused` may run on different threads."""

    def __init__(self) -> None:
        self._new: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._refusals = Refusals()
        self._rest = b""

    def read(self, data: bytes) -> bytes:
        """Take a part of the log; the lines in it that say something else."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        others, found = [], Counter[str]()
        for line in lines:
            if _LINE.search(line):
                found[next((why for part, why in _WHY if part in line), _OTHER)] += 1
            else:
                others.append(line + b"\n")
        if len(self._rest) > _CHUNK:
            others.append(self._rest)
            self._rest = b""
        if found:
            with self._lock:
                self._new.update(found)
        return b"".join(others)

    def refused(self, now: float) -> tuple[Refusal, ...]:
        """The links that were refused in the last seconds; those read since the last call count
        from `now` [s]."""
        if self._new:
            with self._lock:
                new, self._new = self._new, Counter()
            for why, count in new.items():
                words = f"a link: {why}"
                self._refusals.add(why, RefusalReason.LINK, words, now, count)
        return self._refusals.recent(now)


@contextmanager
def reading_log(links: RefusedLinks) -> Iterator[None]:
    """Within, `links` reads what zenoh logs. Before the first session is opened, once a process."""
    log_refused_links()
    before = os.dup(_STDOUT)
    ours, theirs = os.pipe()
    os.dup2(theirs, _STDOUT)
    os.close(theirs)
    reader = threading.Thread(target=_read, args=(links, ours, before), daemon=True)
    reader.start()
    try:
        yield
    finally:
        os.dup2(before, _STDOUT)  # the pipe's other end, which ends the reader
        reader.join(timeout=1.0)


@contextmanager
def refused_links(identity: Identity | None) -> Iterator[Callable[[float], tuple[Refusal, ...]]]:
    """What tells of refused links [s], as `RefusedLinks.refused`; on an open mesh none is."""
    if identity is None:
        yield lambda _: ()
        return
    links = RefusedLinks()
    with reading_log(links):
        yield links.refused


class News:
    """What of refusals is to be said: a reason once, and again when it comes after a pause."""

    def __init__(self) -> None:
        self._standing: frozenset[str] = frozenset()

    def of(self, refused: Iterable[Refusal]) -> list[str]:
        """The words of those that did not stand at the last call."""
        found = {refusal.owner: refusal.words for refusal in refused}
        new = [f"refused on the mesh: {found[why]}" for why in found.keys() - self._standing]
        self._standing = frozenset(found)
        return new


def _read(links: RefusedLinks, ours: int, before: int) -> None:
    """Always take what comes: zenoh would wait for a full pipe, with all its links."""
    while data := os.read(ours, _CHUNK):
        others = links.read(data)
        if others:
            _write(before, others)
    os.close(ours)
    os.close(before)


def _write(descriptor: int, data: bytes) -> None:
    """A full disk or a closed terminal must not stop the reader."""
    with suppress(OSError):
        os.write(descriptor, data)
