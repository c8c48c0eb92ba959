"""How a zenoh session is set up: explicit endpoints, leases, timeouts and queues."""

from __future__ import annotations

import contextlib
import ipaddress
import json
import os
from collections.abc import Collection, Mapping, Sequence
from enum import StrEnum
from functools import partial
from typing import Any, Final

import zenoh

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.errors import InputError
from swarm_ctl.mesh.access import for_zenoh, is_set, refuse_ours
from swarm_ctl.mesh.keys import CHANNELS, COMMAND, Channel
from swarm_ctl.mesh.stepped_transport import MARK_SIZE

# zenoh reads it when the first session opens. One worker thread instead of one pool per task: a
# quarter less CPU, 6 threads instead of 11.
os.environ.setdefault(
    "ZENOH_RUNTIME",
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),app:(worker_threads:1))",
)

_ROUTER_RUNTIME: Final = (
    "(rx:(worker_threads:1),acc:(handover:app),tx:(worker_threads:1),"
    "net:(handover:app),app:(worker_threads:1))"
)
"""A router's thread that receives may wait for a full queue: another one has to empty it."""

_LEASE_S = 3.0
"""Mission time after which zenoh drops a silent link. Agents judge a peer by its state's age."""
_FAR_LEASE_S = 12.0
"""The same between hosts. Where a fifth of the packets is lost, TCP may repeat one for longer than
3 s, and a link that is dropped takes longer still to open again: agents lost each other by that."""
_LEAST_LEASE_MS = 1000
"""On the wall clock: a shorter lease would cut links whenever the machine is slow."""
_OPEN_WALL_MS = 3000
"""For one attempt to open a link (zenoh's default: 10 s). After a cut, no link waits for the ever
rarer packets of an old attempt, and a closing session waits no longer than this. Five round trips
of 300 ms and a lost packet fit in."""
_FAR_OPEN_WALL_MS = 6000
"""The same between hosts: a fifth of the packets may be lost."""
_TRIES: Final = 2
"""Attempts to open the link to a router before a client looks whether it was closed meanwhile: one
attempt may be lost on a bad link."""
_QUEUED, _DROPPED_AFTER_US = 2, 1000
"""Batches that a link queues of each priority, and how long a message waits for a full queue before
it is dropped (zenoh's defaults): the control loop must not wait."""
_PATIENT_QUEUED, _PATIENT_DROPPED_AFTER_US = 16, 1_000_000
"""In lockstep mission time waits for the message. With the defaults, one of 17 flights beside four
busy loops lost two, and was another flight."""
_PENDING, _SESSIONS = 600, 300
"""Links that open at a time and have not said yet who they are (zenoh's default, 100, let 500
silent connections keep a new peer away), and links in all: for 250 agents and 50 stations. Together
they leave a process some of its 1024 files."""
_LONGEST: Final = 2 * max(channel.bounds.size for channel in CHANNELS)
"""Bytes of a message with its key; zenoh puts no longer one together of its parts."""
_COMMANDS_PER_S: Final = 200.0
"""That one link may bring. A flood under ever new names has one, an operator one of its own."""
_REFUSED: Final = (
    "zenoh_link_tls=warn,zenoh_link_commons::quic=warn,"
    "zenoh::net::routing::interceptor::access_control=info"
)


class MeshPart(StrEnum):
    """What a process is on the mesh."""

    PEER = "peer"
    """Of a small swarm without routers: has a link to each other process."""
    CLIENT = "client"
    """Of a swarm with routers: has one link, to the router of its host."""
    ROUTER = "router"
    """Passes on between its clients and other routers."""


def part_in(plan: Plan, routers: Collection[str]) -> MeshPart:
    """What the agents and stations of a swarm are. `routers`: those that its fleet names: a small
    swarm that has some uses them."""
    return MeshPart.PEER if hears_all(plan) and not routers else MeshPart.CLIENT


def _passed_on(name: str, keys: Sequence[str], priority: str) -> dict[str, Any]:
    """A sender may ask that its messages wait for a full queue: the thread that passes them on
    would wait, too, with all other links on it, and after 5 s would cut the slow one."""
    return {
        "id": name,
        "flows": ["ingress"],
        "messages": ["put", "delete", "query"],
        "key_exprs": list(keys),
        "overwrite": {"congestion_control": "drop", "priority": priority, "express": False},
    }


_STEADY: Final = [channel for channel in CHANNELS if not channel.qos.reliable]
"""Sent at a steady rate; the next one makes up for one that is lost."""
_URGENT_KEYS: Final = [channel.key_expression("*") for channel in _STEADY if channel.qos.urgent]
_QUALITY: Final = {
    # what a peer passes on, of zenoh clients, goes after all that it sends itself
    MeshPart.PEER: [_passed_on("passed on", ["**"], "background")],
    MeshPart.CLIENT: [],
    # a router passes on all: no sender makes its other messages go before the others' states
    MeshPart.ROUTER: [
        _passed_on("passed on", ["**"], "data"),
        _passed_on("states", _URGENT_KEYS, "real_time"),
    ],
}
_RULES: Final = {
    MeshPart.PEER: ("commands", "steady"),
    MeshPart.CLIENT: (),
    MeshPart.ROUTER: ("commands", "steady"),
}
_LOOPBACK: Final = ["lo", "lo0"]


def be_router() -> None:
    """Before the first session of the process is opened."""
    os.environ["ZENOH_RUNTIME"] = _ROUTER_RUNTIME


def configuration(
    listen: Sequence[str],
    connect: Sequence[str],
    speedup: float,
    *,
    patient: bool,
    access: Mapping[str, Any] | None = None,
    part: MeshPart = MeshPart.PEER,
    own: Mapping[str, Any] | None = None,
) -> zenoh.Config:
    """A session's settings.

    Args:
        listen: endpoints such as `tcp/127.0.0.1:7447`.
        connect: endpoints, tried until they answer.
        speedup: mission seconds per second of the wall clock.
        patient: a message waits for a full queue, up to a second, before it is dropped.
        access: of a protected mesh (`access.access_settings`); None: the mesh is open.
        part: what the process is on the mesh.
        own: a user's settings (`read_settings`), in place of those here that keep no one safe.

    Raises:
        InputError: `own` has a setting that is not the user's, or that zenoh does not know.
    """
    config = _config(own or {})
    queued = {"real_time": _PATIENT_QUEUED if patient else _QUEUED}
    if part is MeshPart.ROUTER:  # a hundred agents' statuses go to a station by one link
        queued = {"real_time": _PATIENT_QUEUED, "data": _PATIENT_QUEUED}
    spelled = partial(for_zenoh, protected=bool(access))
    far = any(_leaves_host(each) for each in (*listen, *connect))
    lease_s, open_ms = (_FAR_LEASE_S, _FAR_OPEN_WALL_MS) if far else (_LEASE_S, _OPEN_WALL_MS)
    client = (
        part is MeshPart.CLIENT
    )  # tries again by itself (`LateSession`), so that it can be closed
    settings: dict[str, Any] = {
        "mode": part,
        "listen/endpoints": [spelled(_interface(each)) for each in listen],
        "connect/endpoints": [spelled(each) for each in connect],
        "connect/timeout_ms": _TRIES * open_ms if client else -1,
        "connect/exit_on_failure": client,
        "connect/retry": {
            "period_init_ms": 50,
            "period_max_ms": 500,
            "period_increase_factor": 1.5,
        },
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": max(_LEAST_LEASE_MS, round(lease_s * 1000 / speedup)),
        "transport/unicast/open_timeout": open_ms,
        "transport/unicast/accept_timeout": open_ms,
        "transport/unicast/accept_pending": _PENDING,
        "transport/unicast/max_sessions": _SESSIONS,
        "transport/link/rx/max_message_size": _LONGEST,
        "low_pass_filter": _sizes(),
        "qos/network": _QUALITY[part],
        # in lockstep the receiver counts what was sent, and waits for all of it
        "downsampling": [] if patient else _rates(part, speedup),
        # Its pools carry nothing here, and take 17 MB of /dev/shm a process.
        "transport/shared_memory/enabled": False,
        "transport/link/tx/batch_size": 8192,
        "transport/link/rx/buffer_size": 8192,
        **{f"transport/link/tx/queue/size/{name}": size for name, size in queued.items()},
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (
            _PATIENT_DROPPED_AFTER_US if patient else _DROPPED_AFTER_US
        ),
    }
    ours = {key: value for key, value in settings.items() if not is_set(own or {}, key)}
    for key, value in (ours | dict(access or {})).items():
        config.insert_json5(key, json.dumps(value))
    return config


def read_settings(text: str, where: str, *, guarded: bool) -> dict[str, Any]:
    """A user's own settings in the JSON5 text of the file `where`; `guarded`: as of `refuse_ours`.
    InputError where they can't be used."""
    reader = zenoh.Config()
    try:
        reader.insert_json5("metadata", text)  # zenoh's own JSON5, to say what the file sets
        own = json.loads(reader.get_json("metadata"))
        if not isinstance(own, dict):
            raise TypeError("it is no object")
    except (zenoh.ZError, TypeError, RecursionError) as error:
        raise InputError(
            f"{where}: is no JSON5: {_words(error)}; allowed: zenoh settings such as"
            " {transport: {link: {tx: {lease: 5000}}}}"
        ) from None
    refuse_ours(own, where, guarded=guarded)
    _config(own, where)
    return own


def _config(own: Mapping[str, Any], where: str = "zenoh settings") -> zenoh.Config:
    """zenoh's defaults with a user's own settings."""
    refuse_ours(own, where)
    try:
        return zenoh.Config.from_json5(json.dumps(own))
    except zenoh.ZError as error:
        raise InputError(f"{where}: {_words(error)}") from None


def _words(error: Exception) -> str:
    """zenoh appends its own source paths."""
    return " ".join(str(error).split(" at /", 1)[0].split())


def _interface(endpoint: str) -> str:
    """Where to listen: on all interfaces for a host's name. What the name stands for may change in
    flight, and on the host itself it may be a loopback address."""
    scheme, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    named = _address(host) is None and host != "localhost"
    return f"{scheme}/0.0.0.0:{port}" if named else endpoint


def _leaves_host(endpoint: str) -> bool:
    """Whether a link of this endpoint may go to another computer."""
    host = endpoint.partition("/")[2].rpartition(":")[0]
    address = _address(host)
    return host != "localhost" if address is None else not address.is_loopback


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """None: it is a name."""
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host.strip("[]"))
    return None


def log_refused_links() -> None:
    """Have zenoh write a line to the standard output for each link that it refuses. Before the
    first session is opened, once a process; what RUST_LOG asks for is written, too."""
    given = os.environ.get("RUST_LOG")
    os.environ["RUST_LOG"] = f"{given},{_REFUSED}" if given else _REFUSED
    zenoh.init_log_from_env_or("error")


def _sizes() -> list[dict[str, Any]]:
    """A payload that is larger than its channel allows does not pass a link, nor does anything that
    is larger than all. Rates are `gate.py`'s (but see `_rates`)."""
    common = {"flows": ["ingress"], "messages": ["put"]}
    channels = [
        common
        | {
            "id": channel.name,
            "key_exprs": [f"swarm/*/{channel.publisher}/*/{channel.name}"],
            "size_limit": channel.bounds.size + MARK_SIZE,
        }
        for channel in CHANNELS
    ]
    other = {"id": "other", "key_exprs": ["**"], "size_limit": _LONGEST}
    return [*channels, common | other | {"messages": ["put", "delete", "query", "reply"]}]


def _rates(part: MeshPart, speedup: float) -> list[dict[str, Any]]:
    """What a link may bring. A rule of zenoh's counts all keys of a link together, by the wall
    clock: a client hears all others by one link, and has no such rule."""
    rules = {
        # a station sends one at a time, and again
        "commands": _rule([COMMAND], _COMMANDS_PER_S * speedup),
        # No client's flood fills the queues to the others. Other routers are on other hosts.
        "steady": {"interfaces": _LOOPBACK}
        | _rule(_STEADY, max(channel.bounds.per_s for channel in _STEADY) * speedup),
    }
    common = {"flows": ["ingress"], "messages": ["put"]}
    return [{"id": name} | common | rules[name] for name in _RULES[part]]


def _rule(channels: Sequence[Channel[Any]], per_s: float) -> dict[str, Any]:
    keys = [channel.key_expression("*") for channel in channels]
    return {"rules": [{"key_expr": key, "freq": per_s} for key in keys]}
