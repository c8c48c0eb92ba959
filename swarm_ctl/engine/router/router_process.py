"""The router of a host: all processes of a large swarm on this host have one link, to it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.lifeline import ALIVE, READY, Lifeline
from swarm_ctl.engine.protection import access, router_identity
from swarm_ctl.engine.refused_links import News, refused_links
from swarm_ctl.mesh.keys import alive_key
from swarm_ctl.mesh.zenoh_config import be_router
from swarm_ctl.mesh.zenoh_transport import Router
from swarm_ctl.trust.identity import Identity

_TURN_WALL_S: Final = 0.1
_LINGER_WALL_S: Final = 300.0
"""After the lifeline's end: agents land, a station writes the summary. It ends with its last
client."""


@dataclass(frozen=True, slots=True)
class RouterConfig:
    """All a router's process is told."""

    swarm: str
    listen: str
    connect: tuple[str, ...] = ()
    """Other hosts' routers."""
    speedup: float = 1.0
    patient: bool = False
    """In lockstep: a message waits for a full queue, up to a second, before it is dropped."""
    identity: Path | None = None
    """The folder with the router's own keys; None: the mesh is open."""
    zenoh: Mapping[str, Any] = field(default_factory=dict)
    """A user's own zenoh settings."""


def run_router(config: RouterConfig, lifeline: Lifeline) -> int:
    """Pass on until the lifeline is cut and the last client has gone; the exit code."""
    identity = router_identity(config.identity)
    be_router()
    until: float | None = None
    news = News()
    with refused_links(identity) as refused, closing(_router(config, identity)) as router:
        lifeline.tell(READY)
        while until is None or (wall_s() < until and router.clients()):
            lifeline.tell(ALIVE)
            for words in news.of((*refused(wall_s()), *router.refused(wall_s()))):
                lifeline.tell(words)
            pause(_TURN_WALL_S)
            if until is None and lifeline.cut():
                until = wall_s() + _LINGER_WALL_S
    return 0


def _router(config: RouterConfig, identity: Identity | None) -> Router:
    name = identity.name if identity else config.listen.partition("/")[2]
    return Router(
        [config.listen],
        config.connect,
        config.speedup,
        patient=config.patient,
        access=access(identity, config.swarm),
        alive=alive_key(config.swarm, "router", name),
        own=config.zenoh,
    )
