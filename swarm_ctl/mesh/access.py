"""Who may do what on a protected mesh: mutual TLS, and zenoh's access control by common name.

zenoh checks the rules at each hop, by the certificate of the link's other end. So an agent may not
pass on what another has said: a command counts on the operator's own link alone, and no member can
speak in another's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from swarm_ctl.errors import InputError
from swarm_ctl.mesh.keys import CHANNELS, alive_key, plan_key
from swarm_ctl.trust.identity import Identity
from swarm_ctl.trust.names import Role
from swarm_ctl.trust.roster import Entry

_WITH_TLS: Final = {"tcp": "tls", "udp": "quic"}
_MIXED: Final = {"udp": "rel=1;mixed_rel=1", "quic": "mixed_rel=1"}
"""zenoh's words for QUIC (of `udp`, which is bare datagrams without them), and for datagrams beside
its streams."""
_KEYS = "keys and rights are made by swarm-ctl trust"
_PLACES = (
    "the fleet, --mesh, --peer and --router name the endpoints, and keep them off other computers"
)
_BOUNDS = "it bounds what one member can do to all others"
_OURS: Final = {
    "mode": "the swarm's size and the fleet's routers decide it",
    "id": "each process has its own",
    "namespace": "rights and bounds go by the keys swarm/NAME/...",
    "listen": _PLACES,
    "connect/endpoints": _PLACES,
    "connect/timeout_ms": "an agent in the air goes on without a link, and tries on",
    "connect/exit_on_failure": "an agent in the air goes on without a link, and tries on",
    "timestamping": "with a host's clock off, zenoh would drop what that host says",
    "access_control": _KEYS,
    "transport/link/tls": _KEYS,
    "transport/link/protocols": _KEYS,
    "transport/auth": _KEYS,
    "low_pass_filter": _BOUNDS,
    "downsampling": _BOUNDS,
    "qos": _BOUNDS,
    "transport/link/rx/max_message_size": _BOUNDS,
    "transport/link/tx/queue/congestion_control": "no control loop may wait for a full queue",
    "adminspace/permissions/write": "others could change the session in flight",
    "plugins": "a session loads no code",
    "plugins_loading": "a session loads no code",
}
"""What of zenoh's configuration a user's own file may not set, and why."""
_FINDS: Final = "scouting"
_HEARS: Final = "hears"
_HEARING: Final = [
    "declare_subscriber",
    "declare_liveliness_subscriber",
    "liveliness_query",
    "query",
]
_SAYING: Final = ["put", "liveliness_token", "declare_queryable", "reply"]


def station_name(owner: str, suffix: str) -> str:
    """The name on the mesh of a station. The dot, which no operator's name has, keeps `anna` from
    the keys of `anna-maria`."""
    return f"{owner}.{suffix}"


def as_tls(endpoint: str) -> str:
    """The endpoint with TLS: `tls/10.0.0.5:7447` for `tcp/10.0.0.5:7447`, `quic/` for `udp/`."""
    scheme, _, address = endpoint.partition("/")
    return f"{_WITH_TLS.get(scheme, scheme)}/{address}"


def for_zenoh(endpoint: str, *, protected: bool) -> str:
    """The endpoint as zenoh is told of it.

    `tcp/` and `tls/` are one stream: a lost packet holds up all that follows. `udp/` and `quic/`
    are QUIC links, without and with TLS, of streams and datagrams: what is said once (events,
    commands, who listens to what) is sent until it arrives; a state that the next one replaces is
    in time or lost.
    """
    told = as_tls(endpoint) if protected else endpoint
    mixed = _MIXED.get(told.partition("/")[0])
    return told if mixed is None or "?" in told else f"{told}?{mixed}"


def access_settings(identity: Identity, swarm: str) -> dict[str, Any]:
    """What zenoh is told so that only members of the identity's roster, in its present epoch, are
    heard on the mesh of `swarm`, and each under its own keys.

    The files are only named: zenoh reads the keys itself.
    """
    certificate, key = str(identity.certificate_file), str(identity.key_file)
    members = identity.roster.current
    own = {each.common_name: _own_keys(each, swarm) for each in members}
    tls = {
        "root_ca_certificate": str(identity.ca_file),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
        # An agent's flight outlasts its certificate.
        "close_link_on_expiration": identity.role is Role.VIEWER,
    }
    delivered = _all_keys(swarm)
    rules = [
        _rule(_HEARS, ["ingress", "egress"], _HEARING, [f"swarm/{swarm}/**"]),
        _rule("is told", ["egress"], _SAYING, delivered),
        *(_rule(name, ["ingress"], _SAYING, keys) for name, keys in own.items() if keys),
    ]
    policies = [
        {"rules": [_HEARS, "is told", *([name] if keys else [])], "subjects": [name]}
        for name, keys in own.items()
    ]
    return {
        "transport/link/protocols": ["tls", "quic"],
        "transport/link/tls": tls,
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": [{"id": name, "cert_common_names": [name]} for name in own],
            "policies": policies,
        },
    }


def is_set(settings: Mapping[str, Any], path: str) -> bool:
    """Whether zenoh settings say anything at a path such as `transport/link/tx/lease`."""
    at: Any = settings
    for name in path.split("/"):
        if not isinstance(at, Mapping) or name not in at:
            return False
        at = at[name]
    return True


def refuse_ours(own: Mapping[str, Any], where: str, *, guarded: bool = True) -> None:
    """InputError where a user's own zenoh settings, of the file `where`, set what keeps a swarm
    safe; `guarded`: the mesh has keys, or other computers may reach it."""
    refused = [f"{path}: {why}" for path, why in _OURS.items() if is_set(own, path)]
    if not guarded and is_set(own, _FINDS):
        refused.append(
            f"{_FINDS}: other computers would find the swarm, which has no"
            " keys (swarm-ctl trust new, or --open-mesh)"
        )
    if refused:
        raise InputError(
            f"{where}: can't be set there: {'; '.join(refused)}; allowed: zenoh's other settings"
        )


def _own_keys(entry: Entry, swarm: str) -> list[str]:
    """The keys under which a member says something and that it is there, or passes that on."""
    if entry.role is Role.AGENT:
        own = (channel for channel in CHANNELS if channel.publisher == "agent")
        keys = [channel.key(swarm, entry.name) for channel in own]
        return [*keys, alive_key(swarm, "agent", entry.name)]
    if entry.role is Role.OPERATOR:
        name = station_name(entry.name, "$*")
        own = (channel for channel in CHANNELS if channel.publisher == "station")
        keys = [channel.key(swarm, name) for channel in own]
        return [*keys, alive_key(swarm, "station", name), plan_key(swarm, name)]
    return _all_keys(swarm) if entry.role is Role.ROUTER else []


def _all_keys(swarm: str) -> list[str]:
    keys = [channel.key_expression(swarm) for channel in CHANNELS]
    return [*keys, alive_key(swarm, "*", "*"), plan_key(swarm, "*")]


def _rule(name: str, flows: list[str], messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": flows,
        "messages": messages,
        "key_exprs": keys,
    }
