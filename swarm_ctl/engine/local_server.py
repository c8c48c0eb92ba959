"""A TCP port of the loopback interface that serves HTTP clients of this machine. A page of another
site, which a browser here has open, is no such client: its requests say so."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import threading
from collections.abc import Callable
from typing import Final

from swarm_ctl.engine import clock as wall
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.rim import Rim

HOST: Final = "127.0.0.1"
_HEAD_BYTES: Final = 8192
_HEAD_WALL_S: Final = 5.0
"""For a client to say what it wants."""
SEND_WALL_S: Final = 30.0
"""A client that takes nothing for so long is given up."""
_CLIENTS: Final = 16
"""At once; another one is turned away."""
_POLL_WALL_S: Final = 0.2
_LOOPBACK: Final = r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?"
_HOSTS: Final = re.compile(_LOOPBACK, re.IGNORECASE)
_ORIGINS: Final = re.compile(rf"https?://{_LOOPBACK}", re.IGNORECASE)


class LocalServer:
    """Serves on `HOST:port` from now on, a thread for each client; StartError, which names `what`,
    where the port is taken.

    Args:
        what: it is, for errors.
        serve: gets a client and the head of its request; the client is closed behind it.
        origins: of pages that may ask beside those of this machine.
    """

    def __init__(
        self,
        what: str,
        port: int,
        serve: Callable[[socket.socket, bytes], None],
        origins: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._serve, self._origins = serve, origins
        self._rim = Rim(what)
        self._admitted = threading.BoundedSemaphore(_CLIENTS)
        self._over = threading.Event()
        self._clients: set[socket.socket] = set()
        try:
            self._listener = socket.create_server((HOST, port), backlog=_CLIENTS)
        except OSError as error:
            why = os.strerror(error.errno or 0)
            raise StartError(f"{what}: {HOST}:{port}: {why}; name another port") from None
        self._listener.settimeout(_POLL_WALL_S)
        self._thread = threading.Thread(target=self._accept, name=what, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Turn all clients away. May be called again."""
        self._over.set()
        self._thread.join()
        self._listener.close()
        for client in list(self._clients):
            _end(client)

    def _accept(self) -> None:
        while not self._over.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                self._over.wait(_POLL_WALL_S)  # no descriptor is left: perhaps later
                continue
            if not self._admitted.acquire(blocking=False):
                _end(client)
                continue
            self._clients.add(client)
            try:
                threading.Thread(target=self._work, args=(client,), daemon=True).start()
            except RuntimeError:  # no more threads
                self._leave(client)

    def _work(self, client: socket.socket) -> None:
        try:
            self._rim.run(self._answer, client)
        finally:
            self._leave(client)

    def _leave(self, client: socket.socket) -> None:
        _end(client)
        self._clients.discard(client)
        self._admitted.release()

    def _answer(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            head = _head(client)
            client.settimeout(SEND_WALL_S)
            why = refusal(head, self._origins)
            if why:
                answer(client, "403 Forbidden", f"{why}\n".encode())
            else:
                self._serve(client, head)


def port_of(what: str, argument: str) -> int:
    """The port that an argument is; InputError, which names `what`, where it is none."""
    if not (argument.isascii() and argument.isdigit() and 1 <= int(argument[:6]) <= 65535):
        raise InputError(f"{what}: {argument or 'no port'}; allowed: a port, 1 to 65535")
    return int(argument)


def refuse_taken(port: int, what: str) -> None:
    """StartError where a server can't have this port."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise StartError(
                f"{what}: {HOST}:{port}: {error.strerror}; name another port"
            ) from None


def answer(
    client: socket.socket, status: str, body: bytes, kind: str = "text/plain; charset=utf-8"
) -> None:
    """Send a whole answer; OSError where the client does not take it."""
    lines = (f"Content-Type: {kind}", f"Content-Length: {len(body)}", "Connection: close")
    head = "\r\n".join((f"HTTP/1.1 {status}", *lines, "X-Content-Type-Options: nosniff", "", ""))
    client.sendall(head.encode() + body)


def refusal(head: bytes, origins: Callable[[str], bool] = lambda _: False) -> str:
    """Why this request is none of a client of this machine; '' where it is.

    A page of another site names itself as `Origin`; one whose name was made to mean this machine
    (DNS rebinding) is found by its `Host`.
    """
    fields: dict[str, list[str]] = {}
    for line in head.decode("latin-1").split("\r\n")[1:]:
        name, _, value = line.partition(":")
        fields.setdefault(name.lower(), []).append(value.strip())
    hosts, from_pages = fields.get("host", []), fields.get("origin", [])
    if len(hosts) > 1 or not all(map(_HOSTS.fullmatch, hosts)):
        return "this host name is not known here; allowed: 127.0.0.1, localhost"
    if len(from_pages) > 1 or not all(_ORIGINS.fullmatch(o) or origins(o) for o in from_pages):
        return "pages of this origin may not ask here"
    return ""


def _head(client: socket.socket) -> bytes:
    """All up to the empty line; OSError where it is too long, or does not come."""
    until, head = wall.wall_s() + _HEAD_WALL_S, b""
    while b"\r\n\r\n" not in head:
        left_s = until - wall.wall_s()
        if left_s <= 0 or len(head) >= _HEAD_BYTES:
            raise TimeoutError
        client.settimeout(left_s)
        data = client.recv(_HEAD_BYTES - len(head))
        if not data:
            raise ConnectionError
        head += data
    return head


def _end(client: socket.socket) -> None:
    with contextlib.suppress(OSError):
        client.shutdown(socket.SHUT_RDWR)
    client.close()
