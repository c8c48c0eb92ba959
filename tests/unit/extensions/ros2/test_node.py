"""The node on the wire: a router as rmw_zenoh's, and a client by others, which needs no ROS."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra `ros2` is not installed")

import zenoh

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.errors import InputError
from swarm_ctl.extensions.ros2.messages import clock, pose, time_of
from swarm_ctl.extensions.ros2.node import ROUTER, Ros2Node, configuration
from swarm_ctl.extensions.ros2.rmw import TRIGGER, Attachment, gid
from swarm_ctl.trust.identity import load_identity
from tests.unit.station.swarm import hexagon_plan, state_of

pytestmark = pytest.mark.realtime
STATE = state_of(hexagon_plan(), 3, 5.0)
DOMAIN = 7


def opened(mode: str, **settings: Any) -> zenoh.Session:
    config = zenoh.Config()
    told = {"mode": mode, "scouting/multicast/enabled": False, **settings}
    for key, value in told.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@pytest.fixture
def router() -> Iterator[int]:
    """Its port."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    with opened("router", **{"listen/endpoints": [f"tcp/127.0.0.1:{port}"]}):
        yield port


@pytest.fixture
def node(router: int) -> Iterator[Ros2Node]:
    made = Ros2Node(DOMAIN, "swarm_ctl", None, at(router))
    yield made
    made.close()


@pytest.fixture
def sdk() -> Iterator[Any]:
    """A client by others, whose session is set up as rmw_zenoh's are."""
    found = pytest.importorskip("zenoh_ros2_sdk")
    yield found
    found.ZenohSession.get_instance().close()


def at(port: int) -> dict[str, str]:
    where = f'connect/endpoints=["tcp/127.0.0.1:{port}"]'
    return {"ZENOH_CONFIG_OVERRIDE": where}


def until(true: Callable[[], bool]) -> None:
    """Wait for it; fails where it does not come in time. It is asked once more than it is false:
    while a node's links change, others may see less of it for a moment."""
    end = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def client(port: int) -> zenoh.Session:
    return opened("client", **{"connect/endpoints": [f"tcp/127.0.0.1:{port}"]})


def test_a_message_goes_out_with_its_attachment(router: int, node: Ros2Node) -> None:
    """Numbered from 1 on, and its gid is that of the token of a publisher that is announced."""
    heard: list[zenoh.Sample] = []
    tokens: list[str] = []
    with client(router) as other:
        seen = other.liveliness().declare_subscriber(
            f"@ros2_lv/{DOMAIN}/**", lambda s: tokens.append(str(s.key_expr)), history=True
        )
        ear = other.declare_subscriber(f"{DOMAIN}/**", heard.append)

        def told() -> bool:
            node.publish("/drone_3/pose", pose(STATE, time_of(7)))
            return len(heard) >= 2

        until(told)
        (token,) = (each for each in tokens if "/MP/" in each)
        first, second = (Attachment.decoded(each.attachment.to_bytes()) for each in heard[:2])
        assert second.number == first.number + 1
        assert abs(first.unix_ns / 1e9 - time.time()) < 60
        assert first.gid == second.gid == gid(token)
        assert "/NN/%/%/swarm_ctl" in next(each for each in tokens if "/NN/" in each)
        head = f"{DOMAIN}/drone_3/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_"
        assert str(heard[0].key_expr).startswith(head)
        for each in (seen, ear):
            each.undeclare()


def test_the_graph_sees_topics_and_services_come_and_go(router: int, sdk: Any) -> None:
    made = Ros2Node(DOMAIN, "swarm_ctl", None, at(router))
    made.publish("/clock", clock(1))
    made.serve("/swarm/hold", lambda _: None)
    there = {"domain_id": DOMAIN, "router_port": router}
    until(lambda: ("/clock", ["rosgraph_msgs/msg/Clock"]) in sdk.get_topic_names_and_types(**there))
    until(
        lambda: (
            sdk.get_service_names_and_types(**there) == [("/swarm/hold", ["std_srvs/srv/Trigger"])]
        )
    )
    made.close()
    until(lambda: not sdk.get_topic_names_and_types(**there))


def test_a_node_sees_others_come_and_go_and_ends_single_topics(router: int, sdk: Any) -> None:
    made, other = (Ros2Node(DOMAIN, name, None, at(router)) for name in ("a", "b"))
    until(lambda: made.others() == {"b"} and other.others() == {"a"})
    assert made.linked()
    there = {"domain_id": DOMAIN, "router_port": router}
    for number, topic in enumerate(("/clock", "/clock_of_b"), 1):
        other.publish(topic, clock(number))
    other.retract("/clock")
    until(lambda: [name for name, _ in sdk.get_topic_names_and_types(**there)] == ["/clock_of_b"])
    other.close()
    until(lambda: not made.others())
    made.close()


def test_a_client_by_others_calls_a_service(router: int, node: Ros2Node, sdk: Any) -> None:
    node.serve("/swarm/hold", lambda r: r.answer(True, f"{r.service}: accepted by agents 1-6"))
    asking = sdk.ROS2ServiceClient(
        "/swarm/hold",
        TRIGGER.name,
        request_definition="#",
        response_definition="bool success\nstring message\n",
        type_hash=TRIGGER.hash,
        domain_id=DOMAIN,
        router_port=router,
        timeout=20.0,
    )
    told = asking.call()
    asking.close()
    assert (told.success, told.message) == (True, "/swarm/hold: accepted by agents 1-6")


def test_an_answer_has_the_number_and_the_gid_of_its_request(router: int, node: Ros2Node) -> None:
    node.serve("/swarm/hold", lambda request: request.answer(False, "no"))
    asked = Attachment(41, 5, bytes(range(16)))
    key = f"{DOMAIN}/swarm/hold/{TRIGGER.dds}/{TRIGGER.hash}"
    with client(router) as other:
        (reply,) = other.get(key, attachment=asked.encoded(), payload=b"\0\1\0\0\0")
        told = Attachment.decoded(reply.ok.attachment.to_bytes())
    assert (told.number, told.gid) == (41, asked.gid)
    assert told.unix_ns > asked.unix_ns


def test_a_call_that_is_none_of_rmw_zenohs_is_refused_in_words(router: int, node: Ros2Node) -> None:
    heard: list[object] = []
    node.serve("/swarm/hold", heard.append)
    key = f"{DOMAIN}/swarm/hold/{TRIGGER.dds}/{TRIGGER.hash}"
    with client(router) as other:
        (reply,) = other.get(key, payload=b"\0\1\0\0\0")
        assert b"an attachment of 0 bytes; allowed: 33" in reply.err.payload.to_bytes()
    assert not heard


def test_the_swarm_flies_without_a_router_and_is_seen_when_one_comes() -> None:
    (port,) = free_ports(1, socket.SOCK_STREAM)
    made = Ros2Node(DOMAIN, "swarm_ctl", None, at(port))
    made.publish("/clock", clock(1))
    with opened("router", **{"listen/endpoints": [f"tcp/127.0.0.1:{port}"]}):
        heard: list[zenoh.Sample] = []
        with client(port) as other:
            ear = other.declare_subscriber(f"{DOMAIN}/clock/**", heard.append)

            def told() -> bool:
                made.publish("/clock", clock(2))
                return bool(heard)

            until(told)
            ear.undeclare()
        made.close()


def test_the_settings_are_those_of_rmw_zenoh_or_of_its_variables(tmp_path: Path) -> None:
    def value(config: zenoh.Config, key: str) -> Any:
        return json.loads(config.get_json(key))

    plain = configuration({})
    assert value(plain, "connect/endpoints") == [ROUTER]
    assert value(plain, "mode") == "peer"
    assert value(plain, "listen/endpoints") == ["tcp/localhost:0"]
    file = tmp_path / "session.json5"
    file.write_text('{mode: "client", connect: {endpoints: ["tcp/10.0.0.5:7447"]}}')
    named = configuration({"ZENOH_SESSION_CONFIG_URI": str(file)})
    assert value(named, "connect/endpoints") == ["tcp/10.0.0.5:7447"]
    assert value(named, "mode") == "client"
    override = 'mode="client"; connect/endpoints=["tcp/10.0.0.6:7447"]'
    told = configuration({"ZENOH_SESSION_CONFIG_URI": str(file), "ZENOH_CONFIG_OVERRIDE": override})
    assert value(told, "connect/endpoints") == ["tcp/10.0.0.6:7447"]


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"ZENOH_SESSION_CONFIG_URI": "/nowhere.json5"}, "ZENOH_SESSION_CONFIG_URI=/nowhere"),
        ({"ZENOH_CONFIG_OVERRIDE": "mode"}, "ZENOH_CONFIG_OVERRIDE: 'mode'"),
        ({"ZENOH_CONFIG_OVERRIDE": "no/such/key=1"}, "ZENOH_CONFIG_OVERRIDE: 'no/such/key=1'"),
    ],
)
def test_settings_that_can_not_be_used_are_refused(environment: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        configuration(environment)


@pytest.fixture(scope="module")
def trust(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a swarm with two operators and a viewer."""
    from swarm_ctl.trust.provision import Terms, new

    folder = tmp_path_factory.mktemp("trust") / "field"
    new(folder, "field", {1: "127.0.0.1"}, ["anna", "ros"], ["tv"], Terms(datetime.now(UTC)))
    return folder


@contextlib.contextmanager
def behind(folder: Path | None, port: int) -> Iterator[zenoh.Session]:
    """A node of ROS 2 on a machine whose router has these keys; without, a stranger's."""
    tls: dict[str, Any] = {"verify_name_on_connect": False}
    if folder is not None:
        identity = load_identity(folder)
        tls |= {
            "root_ca_certificate": str(identity.ca_file),
            "enable_mtls": True,
            "connect_certificate": str(identity.certificate_file),
            "connect_private_key": str(identity.key_file),
        }
    (own,) = free_ports(1, socket.SOCK_STREAM)
    settings = {
        "connect/endpoints": [f"tls/127.0.0.1:{port}"],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "listen/endpoints": [f"tcp/127.0.0.1:{own}"],
        "transport/link/tls": tls,
    }
    near = {"connect/endpoints": [f"tcp/127.0.0.1:{own}"], "listen/endpoints": []}
    with opened("router", **settings), opened("peer", **near) as node:
        yield node


def test_keys_guard_the_link_to_ros(trust: Path) -> None:
    """A viewer's machine hears and may not order, nor say that agents are behind it; an operator's
    may, and no one else gets in."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    where = f'connect/endpoints=[];listen/endpoints=["tls/127.0.0.1:{port}"]'
    identity = load_identity(trust / "operator-anna")
    made = Ros2Node(DOMAIN, "swarm_ctl", identity, {"ZENOH_CONFIG_OVERRIDE": where})
    assert made.guarded
    orders: list[str] = []

    def take(request: Any) -> None:
        orders.append(request.service)
        request.answer(True, "taken")

    made.serve("/swarm/hold", take)
    key = f"{DOMAIN}/swarm/hold/{TRIGGER.dds}/{TRIGGER.hash}"
    asked = Attachment(1, 5, bytes(16)).encoded()

    def hears(node: zenoh.Session, wall_s: float = 20.0) -> bool:
        heard: list[zenoh.Sample] = []
        ear = node.declare_subscriber(f"{DOMAIN}/clock/**", heard.append)
        end = time.monotonic() + wall_s
        while not heard and time.monotonic() < end:
            made.publish("/clock", clock(2))
            time.sleep(0.02)
        ear.undeclare()
        return bool(heard)

    def announced(node: zenoh.Session, name: str) -> bool:
        """As an agent's node is; the link works already."""
        token = f"@ros2_lv/{DOMAIN}/{node.info.zid()}/0/0/NN/%/%/{name}"
        declared = node.liveliness().declare_token(token)
        end = time.monotonic() + 2.0
        while name not in made.others() and time.monotonic() < end:
            time.sleep(0.02)
        seen = name in made.others()
        declared.undeclare()
        return seen

    def ordered(node: zenoh.Session) -> bool:
        return any(reply.ok for reply in node.get(key, attachment=asked, timeout=2.0))

    with behind(trust / "viewer-tv", port) as node:
        assert hears(node)
        tokens = node.liveliness().get(f"@ros2_lv/{DOMAIN}/**")
        assert len([each for each in tokens if each.ok]) == 3
        assert not ordered(node)
        assert not announced(node, "swarm_ctl_drone_1")  # a station would tell no drone 1 then
    assert not orders
    with behind(trust / "operator-ros", port) as node:
        assert hears(node)
        assert ordered(node)
        assert announced(node, "swarm_ctl_drone_1")
    assert orders == ["/swarm/hold"]
    with behind(None, port) as node:
        assert not hears(node, 2.0)
        assert not ordered(node)
    made.close()


@pytest.mark.parametrize(
    "override",
    ["", 'listen/endpoints=["tcp/127.0.0.1:0"]', "connect/endpoints=[];listen/endpoints=[]"],
)
def test_keys_guard_no_link_without_tls(trust: Path, override: str) -> None:
    identity = load_identity(trust / "operator-anna")
    with pytest.raises(InputError, match=r"ros2: keys guard no .*allowed: tls/HOST:PORT"):
        configuration({"ZENOH_CONFIG_OVERRIDE": override}, identity)
