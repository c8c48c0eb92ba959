"""The dashboard for web browsers: textual-serve on the loopback interface, under a secret path.
Each visitor has a station of its own, a process, and commands as this terminal's operator would."""

from __future__ import annotations

import logging
import secrets
import shlex
import sys
from collections.abc import Awaitable, Callable, Sequence
from typing import Final

from aiohttp import web
from textual_serve.server import Server

from swarm_ctl.engine.local_server import HOST, refusal

_VISITORS: Final = 4
"""At once: each is a process of about 100 MB."""
_LEAVE_WALL_S: Final = 0.5
"""At the end visitors are not waited for longer."""
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": (
        "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none';"
        " script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline';"
        " font-src 'self'; img-src 'self' data:; connect-src 'self'"
    ),
}
"""Its page names a font of another site: a browser does not ask for it."""


class DashboardServer(Server):
    """Serves until Ctrl-C or SIGTERM; then all visitors' stations leave.

    Args:
        station: the arguments of the `swarm-ctl station` that each visitor gets.
        port: of 127.0.0.1.
    """

    def __init__(self, station: Sequence[str], port: int) -> None:
        words = [sys.executable, "-m", "swarm_ctl.cli.main", "station", *station]
        super().__init__(
            f"exec {shlex.join(words)}",
            HOST,
            port,
            title="swarm-ctl station",
            public_url=f"http://{HOST}:{port}",
        )
        self._path = f"/{secrets.token_urlsafe(16)}"
        self._visitors = 0
        self.link: Final = f"{self.public_url}{self._path}/"
        """Whoever has it may command the swarm."""

    async def on_startup(self, app: web.Application) -> None:
        """Say nothing: the command tells the link."""

    def serve(self, debug: bool = False) -> None:
        """Until a signal ends it."""
        self.debug = debug
        logging.getLogger("textual-serve").addHandler(logging.NullHandler())
        web.run_app(
            self._make_app(),
            host=self.host,
            port=self.port,
            print=None,
            access_log=None,
            shutdown_timeout=_LEAVE_WALL_S,
        )

    async def _make_app(self) -> web.Application:
        app = web.Application(middlewares=[_guard])
        app.add_subapp(self._path, await super()._make_app())
        return app

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """A visitor's station, until it leaves."""
        if self._visitors >= _VISITORS:
            raise web.HTTPServiceUnavailable(
                text=f"{_VISITORS} visitors are there; allowed: no more"
            )
        self._visitors += 1
        try:
            return await super().handle_websocket(request)
        finally:
            self._visitors -= 1


@web.middleware
async def _guard(
    request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
) -> web.StreamResponse:
    """Only clients of this machine: no page of another site, no name that was made to mean it."""
    head = b"\r\n" + b"\r\n".join(name + b": " + value for name, value in request.raw_headers)
    if why := refusal(head):
        raise web.HTTPForbidden(text=f"{why}\n", headers=_HEADERS)
    answer = await handler(request)
    if not answer.prepared:
        answer.headers.update(_HEADERS)
    return answer
