"""A node of ROS 2: a zenoh session of its own, which connects as every node of rmw_zenoh does, to
the router of its host.

`ZENOH_SESSION_CONFIG_URI` and `ZENOH_CONFIG_OVERRIDE` mean what they mean to rmw_zenoh. The swarm's
own mesh is another session: nothing goes from one to the other but by the station. The swarm's keys
may guard this session, too: then all its endpoints are `tls/`.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Mapping
from typing import Any, Final

import zenoh

from swarm_ctl.engine import clock as wall
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.extensions.ros2.messages import NANO
from swarm_ctl.extensions.ros2.rmw import (
    TRIGGER,
    Attachment,
    EntityKind,
    NodeName,
    cdr,
    gid,
    nodes_of,
    trigger_response,
    type_of,
)
from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mission.fleet.exposure import leaves_loopback
from swarm_ctl.trust.identity import Identity
from swarm_ctl.trust.names import Role

ROUTER: Final = "tcp/localhost:7447"
"""Where rmw_zenoh's router is by default."""
_FILE, _OVERRIDE = "ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"
_DEFAULTS: Final[dict[str, Any]] = {
    "mode": "peer",
    "connect/endpoints": [ROUTER],
    "listen/endpoints": ["tcp/localhost:0"],
    "scouting/multicast/enabled": False,
    "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
    "scouting/gossip/autoconnect_strategy": {
        "peer": {"to_router": "always", "to_peer": "greater-zid"}
    },
    "timestamping/enabled": True,
}
"""Those of rmw_zenoh's sessions, as its DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5 has them."""
_ALWAYS: Final[dict[str, Any]] = {
    # the swarm flies, whether a router is there or comes later
    "connect/timeout_ms": -1,
    "connect/exit_on_failure": False,
    "transport/shared_memory/enabled": False,
}


class Request:
    """A call of a service, to be answered once."""

    def __init__(self, service: str, query: Any, asked: Attachment) -> None:
        self.service: Final = service
        """Its name, such as `/swarm/hold`."""
        self._query, self._asked = query, asked

    def answer(self, success: bool, message: str) -> None:
        """To the client, which may have gone."""
        sent = self._asked._replace(unix_ns=_unix_ns())
        with self._query, contextlib.suppress(zenoh.ZError):
            self._query.reply(
                self._query.key_expr, trigger_response(success, message), attachment=sent.encoded()
            )


class _Publisher:
    def __init__(self, publisher: Any, token: Any, gid: bytes) -> None:
        self._publisher, self._token, self._gid, self._number = publisher, token, gid, 0

    def end(self) -> None:
        self._token.undeclare()
        self._publisher.undeclare()

    def put(self, data: bytes) -> None:
        self._number += 1
        sent = Attachment(self._number, _unix_ns(), self._gid)
        self._publisher.put(data, attachment=sent.encoded())


class Ros2Node:
    """A node in the root namespace, from now on. One thread publishes, zenoh's serve.

    Args:
        domain: `ROS_DOMAIN_ID`.
        name: of the node.
        identity: whose keys guard it; None: nothing does.
        environment: where the session's settings are named.

    Raises:
        InputError: the settings can't be used.
        StartError: the session does not open.
    """

    def __init__(
        self,
        domain: int,
        name: str,
        identity: Identity | None = None,
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        config = configuration(environment, identity)
        self.guarded: Final = identity is not None
        """Only members of the swarm's roster hear it, and only operators call its services."""
        self.where: Final = ", ".join(_endpoints(config, "connect/endpoints")) or "any endpoint"
        """At which it looks for a router."""
        self.leaves_host: Final = any(map(leaves_loopback, _endpoints(config)))
        """Its router, or who connects to it, may be on another computer."""
        if identity is not None:
            config.insert_json5("access_control", json.dumps(_rights(identity, domain)))
        try:
            self._session: Any = zenoh.open(config)
        except zenoh.ZError as error:
            raise StartError(f"ros2: its zenoh session does not open: {_words(error)}") from None
        self._name = NodeName(domain, str(self._session.info.zid()), name)
        self._publishers: dict[str, _Publisher] = {}
        self._declared = 0
        self._others: dict[str, str] = {}
        seen = self._session.liveliness().declare_subscriber(
            nodes_of(domain), self._saw, history=True
        )
        self._kept: list[Any] = [seen, self._declare_token(self._name.token())]

    def _saw(self, sample: Any) -> None:
        """On zenoh's thread."""
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            self._others.pop(token, None)
        elif token != self._name.token():
            self._others[token] = token.rpartition("/")[2]

    def linked(self) -> bool:
        """It has a link to a router, or to another node."""
        info = self._session.info
        return any((*info.routers_zid(), *info.peers_zid()))

    def others(self) -> frozenset[str]:
        """The names of the other nodes in the root namespace that are there now."""
        return frozenset(self._others.copy().values())

    def publish(self, topic: str, message: Any) -> None:
        """One of rosbags' messages; `topic` is the same type's always."""
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self._declare(topic, message)
        publisher.put(cdr(message))

    def retract(self, topic: str) -> None:
        """Publish this topic no more, until the next message."""
        publisher = self._publishers.pop(topic, None)
        if publisher is not None:
            publisher.end()

    def _declare(self, topic: str, message: Any) -> _Publisher:
        of = type_of(message)
        token = self._name.endpoint(self._number(), EntityKind.PUBLISHER, topic, of)
        publisher = self._session.declare_publisher(
            self._name.key(topic, of),
            congestion_control=zenoh.CongestionControl.DROP,  # no station waits for a slow reader
            reliability=zenoh.Reliability.RELIABLE,
        )
        return _Publisher(publisher, self._declare_token(token), gid(token))

    def serve(self, service: str, take: Callable[[Request], None]) -> None:
        """Offer a `std_srvs/srv/Trigger`; `take` gets its calls, on zenoh's thread."""

        def hear(query: Any) -> None:
            given = query.attachment
            try:
                asked = Attachment.decoded(b"" if given is None else given.to_bytes())
            except ValueError as error:
                with query:
                    query.reply_err(f"{service}: {error}".encode())
            else:
                take(Request(service, query, asked))

        key = self._name.key(service, TRIGGER)
        self._kept.append(self._session.declare_queryable(key, hear, complete=True))
        token = self._name.endpoint(self._number(), EntityKind.SERVER, service, TRIGGER)
        self._kept.append(self._declare_token(token))

    def _number(self) -> int:
        """None is given twice."""
        self._declared += 1
        return self._declared

    def _declare_token(self, token: str) -> Any:
        """zenoh ends a token that Python forgets."""
        return self._session.liveliness().declare_token(token)

    def close(self) -> None:
        """Leave ROS 2's graph."""
        with contextlib.suppress(zenoh.ZError):  # a link on which no process answers
            self._session.close()


def configuration(environment: Mapping[str, str], identity: Identity | None = None) -> zenoh.Config:
    """The session's settings: rmw_zenoh's defaults, or the file and the single settings that the
    environment names; `identity`: whose keys it has. InputError where they can't be used."""
    where = environment.get(_FILE, "")
    try:
        config = zenoh.Config.from_file(where) if where else zenoh.Config()
    except zenoh.ZError as error:
        raise InputError(f"{_FILE}={where}: {_words(error)}; allowed: zenoh's JSON5") from None
    for key, value in (_ALWAYS if where else _DEFAULTS | _ALWAYS).items():
        config.insert_json5(key, json.dumps(value))
    for setting in environment.get(_OVERRIDE, "").split(";"):
        key, _, value = setting.partition("=")
        try:
            if setting.strip():
                config.insert_json5(key.strip(), value)
        except zenoh.ZError as error:
            allowed = 'allowed: KEY=VALUE;..., as in connect/endpoints=["tcp/10.0.0.5:7447"]'
            raise InputError(f"{_OVERRIDE}: {setting!r}: {_words(error)}; {allowed}") from None
    if identity is not None:
        ends = _endpoints(config)
        bare = [each for each in ends if not each.startswith(("tls/", "quic/"))]
        if bare or not ends:
            raise InputError(
                f"ros2: keys guard no {', '.join(bare) or 'session without endpoints'}; allowed:"
                f" tls/HOST:PORT alone, by {_OVERRIDE}"
            )
        tls = access_settings(identity, identity.swarm)
        for key in ("transport/link/protocols", "transport/link/tls"):
            config.insert_json5(key, json.dumps(tls[key]))
        # a router tells its peers what another one has, and nothing of a peer that they can't reach
        config.insert_json5("mode", '"router"')
    return config


_ENDS: Final = ("connect/endpoints", "listen/endpoints")


def _endpoints(config: zenoh.Config, *which: str) -> list[str]:
    """To which a session connects, and at which it listens; or `which` of them."""
    found: list[str] = []
    for key in which or _ENDS:
        told = json.loads(config.get_json(key))
        for each in told.values() if isinstance(told, dict) else [told]:
            found += each or []
    return found


def _rights(identity: Identity, domain: int) -> dict[str, Any]:
    """All members hear; operators ask, and say who else is there, too."""
    keys = [f"{domain}/**", f"@ros2_lv/{domain}/**"]
    both, tells = ["ingress", "egress"], ["put", "liveliness_token", "declare_queryable", "reply"]
    hears = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    rules = [
        ("hears", both, hears),
        ("is told", ["egress"], tells),
        ("orders", both, ["query"]),
        ("is there", ["ingress"], ["liveliness_token"]),
    ]
    members = identity.roster.current
    operators = [each.common_name for each in members if each.role is Role.OPERATOR]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {"id": name, "permission": "allow", "flows": flows, "messages": told, "key_exprs": keys}
            for name, flows, told in rules
        ],
        "subjects": [
            {"id": "members", "cert_common_names": [each.common_name for each in members]},
            {"id": "operators", "cert_common_names": operators},
        ],
        "policies": [
            {"rules": ["hears", "is told"], "subjects": ["members"]},
            {"rules": ["orders", "is there"], "subjects": ["operators"]},
        ],
    }


def _words(error: Exception) -> str:
    """zenoh appends its own source paths."""
    return " ".join(str(error).split(" at /", 1)[0].split())


def _unix_ns() -> int:
    return round(wall.unix_s() * NANO)
