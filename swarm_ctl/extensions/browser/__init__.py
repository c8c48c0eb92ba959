"""A live map of the swarm for web browsers, by a server of the loopback interface. Who has its link
may look; nothing that a visitor sends reaches the swarm.

The page is the report's player, which gets each view by server-sent events. It needs no other file,
and asks no other server.
"""

from __future__ import annotations

import json
import re
import secrets
import socket
import threading
from html import escape
from importlib import resources
from typing import Final

from swarm_ctl.core.model.text import printable
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.local_server import HOST, LocalServer, answer, port_of, refuse_taken
from swarm_ctl.errors import InputError
from swarm_ctl.extension import Extension, StationHandle
from swarm_ctl.extensions.browser.live_flight import LiveFlight, Version
from swarm_ctl.report.page.player_parts import markup, script, script_hash, style
from swarm_ctl.station.picture.view import SwarmView

_PORT: Final = "8700"
_QUIET_WALL_S: Final = 2.0
"""So long without news a stream waits before it looks whether its visitor is still there."""
_GOODBYE_WALL_S: Final = 1.0
_SEND_BYTES: Final = 65_536
"""That may wait on the way to a slow visitor: what it sees gets old there."""
_ABOUT: Final = (
    "Places as this station hears them. A full disc flies; a dashed one is not heard any more, and"
    " stands where it was last heard. Discs are as wide as the least distance."
)
_REQUEST: Final = re.compile(rb"(?P<method>[A-Z]+) (?P<path>[^ ]*) HTTP/1\.[01]\r\n")
_HEAD: Final = (
    b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n"
    b"X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\nretry: 1000\n\n"
)


class BrowserMap(Extension):
    """Serves on a port of 127.0.0.1, its argument, under a path that no one can guess."""

    def __init__(self, argument: str, station: StationHandle) -> None:
        port = _port(argument)
        self._flight = LiveFlight(station.plan)
        self._news = threading.Condition()
        self._over = False
        self._streams = 0
        self._path = f"/{secrets.token_urlsafe(16)}/"
        self._server = LocalServer("web", port, self._serve)
        self.link: Final = f"http://{HOST}:{port}{self._path}"
        """Whoever has it may look."""
        station.tell(f"the live map, for whoever may look: {self.link}")

    @classmethod
    def check(cls, argument: str) -> None:
        refuse_taken(_port(argument), "web")

    @classmethod
    def port(cls, argument: str) -> int:
        return _port(argument)

    def take(self, view: SwarmView) -> None:
        with self._news:
            self._flight.take(view)
            self._news.notify_all()

    def close(self) -> None:
        """Tell all pages that this was the last picture, and end."""
        with self._news:
            self._over = True
            self._news.notify_all()
            self._news.wait_for(lambda: self._streams == 0, _GOODBYE_WALL_S)
        self._server.close()

    def _serve(self, client: socket.socket, head: bytes) -> None:
        asked = _REQUEST.match(head)
        if asked is None or asked["method"] != b"GET":
            answer(client, "405 Method Not Allowed", b"allowed: GET\n")
        elif secrets.compare_digest(asked["path"], self._path.encode()):
            answer(client, "200 OK", self._page().encode(), "text/html; charset=utf-8")
        elif secrets.compare_digest(asked["path"], f"{self._path}news".encode()):
            self._stream(client)
        else:
            text = "There is nothing here: take the whole link, as the station told it.\n"
            answer(client, "404 Not Found", text.encode())

    def _page(self) -> str:
        with self._news:
            plan, run = self._flight.plan, self._flight.beginning()
        asset = resources.files(__package__ or "") / "assets"
        live = (asset / "live.js").read_text("utf-8")
        policy = (
            "default-src 'none'; base-uri 'none'; form-action 'none'; connect-src 'self';"
            f" style-src 'unsafe-inline'; script-src '{script_hash(script())}'"
            f" '{script_hash(live)}'"
        )
        values = {
            "POLICY": policy,
            "STYLE": style() + (asset / "live.css").read_text("utf-8"),
            "NAME": escape(printable(plan.name)),
            "PLAYER": markup({"runs": [run], "live": _ABOUT}),
            "LIVE": live,
        }
        page = (asset / "page.html").read_text("utf-8")
        return re.sub("@([A-Z]+)@", lambda found: values[found[1]], page)

    def _stream(self, client: socket.socket) -> None:
        """All there is, then what is new, until the station ends or the visitor leaves."""
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BYTES)
        client.sendall(_HEAD)
        known, over = Version(), False
        with self._news:
            self._streams += 1
        try:
            while not over:
                with self._news:
                    if not self._over and self._flight.version == known:
                        self._news.wait(_QUIET_WALL_S)
                    told = self._flight.since(known) if self._flight.version != known else {}
                    known, over = self._flight.version, self._over
                if told:
                    told["sent_s"] = wall.wall_s()
                    data = json.dumps(told, allow_nan=False, separators=(",", ":"))
                    client.sendall(f"event: view\ndata: {data}\n\n".encode())
                else:
                    client.sendall(b":\n\n")
            client.sendall(b"event: end\ndata: \n\n")
        finally:
            with self._news:
                self._streams -= 1
                self._news.notify_all()


def _port(argument: str) -> int:
    """The port; InputError for an address, too."""
    if ":" in argument:
        port = argument.rpartition(":")[2] or _PORT
        raise InputError(
            f"web: {argument}: the map has no TLS, so it is for this computer alone; allowed: a"
            f" port of {HOST}; from another computer: ssh -L {port}:{HOST}:{port} to this one"
        )
    return port_of("web", argument or _PORT)
