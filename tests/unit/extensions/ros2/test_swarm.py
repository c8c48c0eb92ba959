"""A station's swarm in ROS 2: what is published when, and orders as services."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra `ros2` is not installed")

from swarm_ctl.commands.parse import Order, parse
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import Ack, AgentState, Command
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError
from swarm_ctl.extension import Answer
from swarm_ctl.extensions.ros2 import swarm as module
from swarm_ctl.extensions.ros2.swarm import Ros2, services
from swarm_ctl.recording.topics import BY_PAYLOAD, adapter
from swarm_ctl.station.picture.protection import LOCAL, MeshKind, Protection
from swarm_ctl.trust.identity import Identity
from tests.unit.plans import groups_mission
from tests.unit.station.pictures import PICTURES
from tests.unit.station.swarm import hexagon_plan, state_of

PLAN = hexagon_plan()
IDS = [agent.id for agent in PLAN.agents]


class Asked:
    """A call of a service."""

    def __init__(self, service: str) -> None:
        self.service, self.answers = service, list[tuple[bool, str]]()

    def answer(self, success: bool, message: str) -> None:
        self.answers.append((success, message))


class Graph:
    """Stands for ROS 2."""

    guarded = leaves_host = False
    where, there_is_a_router = "tcp/localhost:7447", True

    def __init__(self, domain: int, name: str, identity: Identity | None) -> None:
        self.domain, self.name, self.identity = domain, name, identity
        self.served: dict[str, Callable[[Any], None]] = {}
        self.told = list[tuple[str, Any]]()
        self.there = set[str]()
        self.retracted = set[str]()
        self.closed = False

    def serve(self, service: str, take: Callable[[Any], None]) -> None:
        self.served[service] = take

    def publish(self, topic: str, message: Any) -> None:
        self.told.append((topic, message))

    def retract(self, topic: str) -> None:
        self.retracted.add(topic)

    def linked(self) -> bool:
        return self.there_is_a_router

    def others(self) -> frozenset[str]:
        return frozenset(self.there)

    def close(self) -> None:
        self.closed = True

    def topics(self) -> Counter[str]:
        told, self.told = self.told, []
        return Counter(topic for topic, _ in told)


class Desk:
    """Stands for the station."""

    name, speedup, stepped = "station", 1.0, False

    def __init__(self, plan: Plan = PLAN, agent: int | None = None) -> None:
        self.plan, self.agent, self.time_s = plan, agent, 5.0
        self.orders = list[tuple[Order, Callable[[Answer], None]]]()
        self.told = list[str]()

    def tell(self, text: str) -> None:
        self.told.append(text)

    def now(self) -> float:
        return self.time_s

    def order(self, order: Order, answered: Callable[[Answer], None] | None = None) -> None:
        assert answered is not None
        self.orders.append((order, answered))


class Flight:
    """A station, and ROS 2 beside it."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, desk: Desk, argument: str = "5,orders"
    ) -> None:
        monkeypatch.setattr(module, "Ros2Node", Graph)
        self.desk = desk
        self.swarm = Ros2(argument, desk)
        self.graph: Graph = self.swarm._node  # type: ignore[assignment]

    def tell(self, agent: int, time_s: float) -> None:
        """The station hears an agent's state."""
        topic = BY_PAYLOAD[AgentState]
        data = adapter(AgentState).dump_json(state_of(PLAN, agent, time_s))
        self.swarm.write(topic, agent, 0, 0, data)

    def ask(self, service: str) -> Asked:
        asked = Asked(service)
        self.graph.served[service](asked)
        return asked


@pytest.fixture
def flight(monkeypatch: pytest.MonkeyPatch) -> Iterator[Flight]:
    made = Flight(monkeypatch, Desk())
    yield made
    made.swarm.close()
    assert made.graph.closed


def test_that_no_router_answers_is_said_once(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight.graph.there_is_a_router = False
    flight.swarm.take(PICTURES["well"]())
    assert not flight.desk.told
    later = time.monotonic() + 4.0
    monkeypatch.setattr("swarm_ctl.engine.clock.wall_s", lambda: later)
    for _ in range(2):
        flight.swarm.take(PICTURES["well"]())
    (words,) = flight.desk.told
    assert words.startswith("ROS 2 hears nothing yet: no router answers at tcp/localhost:7447")


def test_another_station_in_the_domain_is_said_once(flight: Flight) -> None:
    """Of two swarms, or one that is attached twice, each topic would have two publishers."""
    flight.swarm.take(PICTURES["well"]())
    flight.graph.there = {"swarm_ctl", "swarm_ctl_drone_3", "rviz"}
    for _ in range(2):
        flight.swarm.take(PICTURES["well"]())
    (words,) = flight.desk.told
    assert "another station is in its domain 5; allowed: one in a domain" in words


def test_on_the_wall_clock_a_stamp_is_unix_time(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So long ago as the state was true."""
    monkeypatch.setattr("swarm_ctl.engine.clock.unix_s", lambda: 1_700_000_000.5)
    flight.tell(1, 4.75)
    told = dict(flight.graph.told)
    assert "/clock" not in told
    stamp = told["/drone_1/odom"].header.stamp
    assert stamp.sec == 1_700_000_000
    assert stamp.nanosec == pytest.approx(250_000_000, abs=1000)


@pytest.mark.parametrize(("speedup", "stepped"), [(5.0, False), (1.0, True)])
def test_simulated_time_is_told_once_and_stamps_are_of_it(
    monkeypatch: pytest.MonkeyPatch, speedup: float, stepped: bool
) -> None:
    desk = Desk()
    desk.speedup, desk.stepped, desk.time_s = speedup, stepped, 5.25
    flight = Flight(monkeypatch, desk)
    flight.tell(1, 5.0)
    told = dict(flight.graph.told)
    assert (told["/clock"].clock.sec, told["/clock"].clock.nanosec) == (5, 250_000_000)
    assert told["/drone_1/odom"].header.stamp.sec == 5
    flight.graph.told.clear()
    flight.tell(2, 5.0)
    assert "/clock" not in flight.graph.topics()
    flight.swarm.take(PICTURES["well"]())
    assert flight.graph.topics()["/clock"] == 1


def test_a_refused_order_says_who_refused_it_and_why(flight: Flight) -> None:
    flight.swarm.take(PICTURES["well"]())
    asked, other = flight.ask("/swarm/hold"), flight.ask("/swarm/form/hexagon")
    (_, answered), (order, refused) = flight.desk.orders
    assert order.arguments == ("hexagon",)
    sent = SentCommand(Command("c1", "hold", (), 5.0), (1, 2, 3))
    sent.acks |= {i: Ack(i, "c1", False, f"agent {i} is not flying yet") for i in (1, 3)}
    answered(sent)
    refused(InputError("form: the swarm lands"))
    assert asked.answers == [
        (False, "hold: refused by agents 1, 3: not flying yet; no answer from agent 2")
    ]
    assert other.answers == [(False, "form: the swarm lands")]


KEYS = Protection(MeshKind.TLS, "operator anna")
VIEWER = Protection(MeshKind.TLS, "viewer ben", commands=False)


@pytest.mark.parametrize(
    ("who", "guarded", "leaves", "why"),
    [
        (LOCAL, False, False, ""),
        (LOCAL, False, True, "other computers reach the link to ROS 2, and the swarm has no keys"),
        (Protection(MeshKind.OPEN), False, True, ""),
        (KEYS, False, False, "the swarm has keys, and its link to ROS 2 has none"),
        (KEYS, True, True, ""),
        (VIEWER, True, True, "viewer ben may only watch"),
        (None, False, False, "the station has no picture of the swarm yet"),
    ],
)
def test_ros_orders_no_easier_than_the_mesh(
    flight: Flight, who: Protection | None, guarded: bool, leaves: bool, why: str
) -> None:
    flight.graph.guarded, flight.graph.leaves_host = guarded, leaves
    if who is not None:
        for _ in range(2):
            flight.swarm.take(replace(PICTURES["well"](), protection=who))
        assert len(flight.desk.told) == bool(why)
    asked = flight.ask("/swarm/hold")
    assert len(flight.desk.orders) == (not why)
    assert len(asked.answers) == bool(why)
    for success, message in asked.answers:
        assert not success
        assert message.startswith(f"no orders from ROS 2: {why}")


def test_a_swarm_without_keys_takes_orders_where_its_operator_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ROS 2's router listens to all networks, unless it is told otherwise."""
    shown = Flight(monkeypatch, Desk(), "0")
    shown.swarm.take(PICTURES["well"]())
    ((success, why),) = shown.ask("/swarm/hold").answers
    assert not success
    assert why.endswith("(--attach ros2=DOMAIN,orders)")
    assert not shown.desk.orders
    shown.swarm.close()


@pytest.mark.parametrize(
    ("argument", "variable", "domain"),
    [("", None, 0), ("", "17", 17), ("3", "17", 3), ("232", None, 232)],
)
def test_a_domain_is_the_arguments_or_that_of_ros(
    argument: str, variable: str | None, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "Ros2Node", Graph)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if variable is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", variable)
    Ros2.check(argument)
    made: Any = Ros2(argument, Desk())._node
    assert made.domain == domain


@pytest.mark.parametrize(
    ("argument", "variable", "words"),
    [
        ("233", "", "ros2=233: is no domain of ROS 2; allowed: 0 to 232"),
        ("-1", "", "ros2=-1: is no domain"),
        ("zero", "", "ros2=zero: is no domain"),
        ("", "x", "ROS_DOMAIN_ID=x: is no domain"),
        ("0,orderz", "", "ros2=0,orderz: 'orderz' names no identity; .*; or orders$"),
    ],
)
def test_what_is_no_domain_is_refused_before_anything_flies(
    argument: str, variable: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", variable)
    with pytest.raises(InputError, match=words):
        Ros2.check(argument)


def test_keys_of_another_swarm_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from swarm_ctl.trust.provision import Terms, new

    new(tmp_path / "field", "field", {1: "127.0.0.1"}, ["anna"], [], Terms(datetime.now(UTC)))
    word = f"0,{tmp_path}/field/operator-anna"
    override = 'connect/endpoints=["tls/127.0.0.1:7450"];listen/endpoints=[]'
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", override)
    Ros2.check(word)
    with pytest.raises(InputError, match="its keys are of the swarm field; allowed: those of"):
        Ros2(word, Desk())


def test_a_station_leaves_a_drone_to_its_own_agent_while_that_is_there(flight: Flight) -> None:
    flight.graph.there = {"swarm_ctl_drone_3", "rviz"}
    for agent in IDS:
        flight.tell(agent, 5.0)
    flight.swarm.take(PICTURES["well"]())
    told = dict(flight.graph.told)
    assert {f"/drone_{i}/odom" for i in IDS} - told.keys() == {"/drone_3/odom"}
    assert flight.graph.retracted == {f"/drone_3/{each}" for each in ("pose", "odom", "fix")}
    drawn = {(m.ns, m.id) for m in told["/swarm/markers"].markers}
    assert ("drones", 2) in drawn
    assert ("links", 0) in drawn
    assert ("drones", 3) not in drawn
    assert ("slots", 3) not in drawn
    flight.graph.there = {"rviz"}
    flight.graph.told.clear()
    flight.tell(3, 5.1)
    assert "/drone_3/odom" in flight.graph.topics()


@pytest.mark.parametrize("plan", [PLAN, groups_mission().plan], ids=["hexagon", "groups"])
def test_each_service_is_an_order_of_the_mission(plan: Plan) -> None:
    """None that an operator has to confirm because a vehicle falls or is no longer listened to."""
    found = services(plan)
    for line in found.values():
        order = parse(line, plan)
        assert order.kind not in ("kill", "expel")
    assert all(re.fullmatch(r"(/[a-z][a-z0-9_]*)+", name) for name in found)
    for agent in plan.agents:
        assert found[f"/drone_{agent.id}/return"] == f"return @{agent.id}"


def test_names_that_become_one_in_ros_stay_apart() -> None:
    shape = PLAN.shapes[0]
    shapes = tuple(replace(shape, name=name) for name in ("v-1", "v_1", "V.1"))
    found = services(replace(PLAN, shapes=shapes))
    assert found["/swarm/form/v_1"] == "form v-1"
    assert found["/swarm/form/v_1_2"] == "form v_1"
    assert found["/swarm/form/v_1_3"] == "form V.1"
