"""Free ports on the loopback interface, for what `run` starts itself."""

from __future__ import annotations

import os
import socket
from collections.abc import Collection
from contextlib import ExitStack

from swarm_ctl.errors import StartError

_FIRST, _LAST = 20000, 32000
"""Below the ephemeral ports (32768 and up on Linux), which any client may get at any time."""
_next: dict[tuple[int, socket.SocketKind], int] = {}
"""By process: where it goes on to search. A port that it gave out before may look free, and still
be another's, or be tried by what has used it."""


def free_ports(count: int, kind: socket.SocketKind, promised: Collection[int] = ()) -> list[int]:
    """`count` ports that are free now, and not `promised`; StartError where there are fewer.

    Processes begin their search in different places, so two runs that start together rarely
    collide. No process gets a port twice before it has had all.
    """
    span, searches = _LAST - _FIRST, (os.getpid(), kind)
    start = _next.get(searches, os.getpid() * 97 + (span // 2 if kind is socket.SOCK_DGRAM else 0))
    found: list[int] = []
    with ExitStack() as held:
        for k in range(span):
            if len(found) == count:
                return found
            port = _FIRST + (start + k) % span
            if port in promised:
                continue
            probe = held.enter_context(socket.socket(socket.AF_INET, kind))
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            found.append(port)
            _next[searches] = start + k + 1
    if len(found) == count:
        return found
    raise StartError(f"only {len(found)} of {count} ports are free on 127.0.0.1:{_FIRST}-{_LAST}")
