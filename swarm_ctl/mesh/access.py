"""Who may do what on a protected mesh: mutual TLS, and zenoh's access control by common name.

zenoh checks the rules at each hop, by the certificate of the link's other end. So an agent may not
pass on what another has said: a command counts on the operator's own link alone, and no member can
speak in another's name.
"""

from __future__ import annotations

from typing import Any, Final

from swarm_ctl.mesh.keys import BEACON, CHANNELS, COMMAND
from swarm_ctl.trust.identity import Identity
from swarm_ctl.trust.names import Role
from swarm_ctl.trust.roster import Entry

_HEARS: Final = "hears"


def station_name(owner: str, suffix: str) -> str:
    """The name on the mesh of a station. The dot, which no operator's name has, keeps `anna` from
    the keys of `anna-maria`."""
    return f"{owner}.{suffix}"


def as_tls(endpoint: str) -> str:
    """The endpoint with TLS: `tls/10.0.0.5:7447` for `tcp/10.0.0.5:7447`."""
    return endpoint.replace("tcp/", "tls/", 1)


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
    delivered = [channel.key_expression(swarm) for channel in CHANNELS]
    rules = [
        _rule(_HEARS, ["ingress", "egress"], "declare_subscriber", [f"swarm/{swarm}/**"]),
        _rule("is told", ["egress"], "put", delivered),
        *(_rule(name, ["ingress"], "put", keys) for name, keys in own.items() if keys),
    ]
    policies = [
        {"rules": [_HEARS, "is told", *([name] if keys else [])], "subjects": [name]}
        for name, keys in own.items()
    ]
    return {
        "transport/link/protocols": ["tls"],
        "transport/link/tls": tls,
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": [{"id": name, "cert_common_names": [name]} for name in own],
            "policies": policies,
        },
    }


def _own_keys(entry: Entry, swarm: str) -> list[str]:
    """The keys under which a member publishes, or passes on."""
    if entry.role is Role.AGENT:
        own = (channel for channel in CHANNELS if channel.publisher == "agent")
        return [channel.key(swarm, entry.name) for channel in own]
    if entry.role is Role.OPERATOR:
        return [channel.key(swarm, station_name(entry.name, "$*")) for channel in (COMMAND, BEACON)]
    if entry.role is Role.ROUTER:
        return [channel.key_expression(swarm) for channel in CHANNELS]
    return []


def _rule(name: str, flows: list[str], message: str, keys: list[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": flows,
        "messages": [message],
        "key_exprs": keys,
    }
