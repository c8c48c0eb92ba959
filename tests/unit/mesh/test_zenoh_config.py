"""A user's own zenoh file: what it changes in a session, what it may not, and how that is said."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import zenoh

from swarm_ctl.cli.shared.options import zenoh_settings
from swarm_ctl.errors import InputError
from swarm_ctl.mesh.access import _OURS, is_set
from swarm_ctl.mesh.zenoh_config import MeshPart, configuration, read_settings

FREE = {"aggregation", "gateway", "metadata", "open", "queries_default_timeout", "region_name"}
FREE |= {"routing", "scouting", "stats"}
"""Sections that a file may set as a whole."""
TRUST: dict[str, Any] = {
    "transport/link/protocols": ["tls"],
    "access_control": {
        "enabled": True,
        "default_permission": "deny",
        "rules": [],
        "subjects": [],
        "policies": [],
    },
}


def read(text: str, *, guarded: bool = True) -> dict[str, Any]:
    return read_settings(text, "my.json5", guarded=guarded)


def session(own: dict[str, Any], at: str = "tcp/h:1", **more: Any) -> dict[str, Any]:
    """The whole configuration of a session."""
    return dict(json.loads(str(configuration([at], [], 1.0, patient=False, own=own, **more))))


def test_what_the_file_sets_stands() -> None:
    """In JSON5, with comments; what it does not name stays as without it."""
    own = read(
        "{ // a slow radio\n transport: {link: {tx: {lease: 9000, queue: {size: {data: 4}}}}},}"
    )
    plain, mine = session({}), session(own)
    tx, before = mine["transport"]["link"]["tx"], plain["transport"]["link"]["tx"]
    assert (tx["lease"], tx["queue"]["size"]["data"]) == (9000, 4)
    assert (before["lease"], before["queue"]["size"]["data"]) == (12000, 2)
    tx["lease"], tx["queue"]["size"]["data"] = 12000, 2
    assert mine == plain


@pytest.mark.parametrize(
    ("at", "lease_ms", "open_ms"),
    [
        ("tcp/127.0.0.1:1", 3000, 3000),
        ("tcp/localhost:1", 3000, 3000),
        ("udp/[::1]:1", 3000, 3000),
        ("tcp/[::]:1", 12000, 6000),
        ("tcp/10.0.0.11:1", 12000, 6000),
        ("udp/drone3.local:1", 12000, 6000),
    ],
)
def test_links_between_hosts_are_kept_longer(at: str, lease_ms: int, open_ms: int) -> None:
    """A packet that is lost there comes late; on one host silence means that a process is gone."""
    transport = session({}, at)["transport"]
    assert transport["link"]["tx"]["lease"] == lease_ms
    unicast = transport["unicast"]
    assert (unicast["open_timeout"], unicast["accept_timeout"]) == (open_ms, open_ms)


@pytest.mark.parametrize("path", _OURS)
def test_what_is_not_the_users(path: str) -> None:
    """Each setting that keeps a swarm safe is refused by its own path and with the reason, whether
    it comes from a file or, unread, from a run's folder."""
    own: Any = {"x": 1}
    for name in reversed(path.split("/")):
        own = {name: own}
    assert is_set(own, path)
    why = re.escape(f"my.json5: can't be set there: {path}: {_OURS[path]}; allowed: ")
    with pytest.raises(InputError, match=why):
        read(json.dumps(own))
    with pytest.raises(InputError, match=re.escape(f"{path}: ")):
        session(own)


def test_keys_stay_as_they_are() -> None:
    """Whatever a file sets beside them."""
    everything = {
        "scouting": {"multicast": {"enabled": True}, "gossip": {"enabled": True}},
        "adminspace": {"enabled": True},
        "transport": {"unicast": {"lowlatency": False}, "link": {"tx": {"lease": 5000}}},
    }
    found = session(read(json.dumps(everything)), access=TRUST, part=MeshPart.CLIENT)
    assert found["access_control"] == TRUST["access_control"]
    assert found["transport"]["link"]["protocols"] == ["tls"]
    assert found["scouting"]["multicast"]["enabled"] is True


def test_discovery_needs_keys_or_consent() -> None:
    text = "{scouting: {gossip: {enabled: true}}}"
    assert read(text)
    with pytest.raises(InputError, match=r"scouting: other computers would find.*--open-mesh"):
        read(text, guarded=False)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "my.json5: is no JSON5: "),
        ("{transport: ", "is no JSON5: "),
        ("[1]", "it is no object"),
        ("{transport: {leese: 1}}", "my.json5: unknown field `leese`, expected one of"),
        ("{transport: {link: {tx: {lease: 'soon'}}}}", "my.json5: error parsing number"),
        ('{"transport/link/tls": {}}', "unknown field `transport/link/tls`"),
    ],
    ids=["empty", "torn", "list", "unknown", "type", "slashes"],
)
def test_what_is_no_zenoh_file(text: str, why: str) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        read(text)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert zenoh_settings(None, guarded=False) == {}
    with pytest.raises(InputError, match=r"--zenoh-config .*no.json5: can't be read: No such file"):
        zenoh_settings(tmp_path / "no.json5", guarded=False)
    (tmp_path / "own.json5").write_text("{aggregation: {publishers: ['a/**']}}")
    assert zenoh_settings(tmp_path / "own.json5", guarded=False)["aggregation"]


def test_every_section_of_this_zenoh_is_known() -> None:
    """A new version's new section is looked at before a file may set it."""
    assert set(json.loads(str(zenoh.Config()))) == FREE | {path.split("/")[0] for path in _OURS}


@pytest.mark.parametrize(
    ("listen", "told"),
    [
        ("tcp/10.0.0.5:7447", ["tcp/10.0.0.5:7447"]),
        ("udp/10.0.0.5:7447", ["udp/10.0.0.5:7447?mixed_rel=1;rel=1"]),
        ("udp/localhost:7447", ["udp/localhost:7447?mixed_rel=1;rel=1"]),
        ("tcp/drone3.local:7447", ["tcp/0.0.0.0:7447"]),
        ("tcp/[::1]:7447", ["tcp/[::1]:7447"]),
    ],
)
def test_where_a_process_listens(listen: str, told: list[str]) -> None:
    """`udp` is QUIC; a name stands for all interfaces, as what it means may
    change."""
    config = configuration([listen], [], 1.0, patient=False)
    assert json.loads(config.get_json("listen/endpoints")) == told
