"""A swarm in ROS 2: its states, pictures and alarms as topics, an operator's orders as services.

Topics and services have fixed names, so that a layout of RViz fits every mission: what flies beside
is another domain. A station tells all drones, an agent's own computer its drone under the same
names. So that no topic has two publishers, a station leaves each drone to the agent that is in the
graph, and takes it again when that has gone.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time

from swarm_ctl.commands.parse import group_names, parse
from swarm_ctl.core.model.messages import AgentState, CommandKind
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine import clock as wall
from swarm_ctl.errors import InputError, TrustError
from swarm_ctl.extension import Answer, Extension, StationHandle
from swarm_ctl.extensions.ros2 import domain_of
from swarm_ctl.extensions.ros2.messages import (
    NANO,
    clock,
    diagnostics,
    drone,
    fix,
    markers,
    odometry,
    pose,
    time_of,
    transforms,
)
from swarm_ctl.extensions.ros2.node import Request, Ros2Node, configuration
from swarm_ctl.extensions.ros2.rmw import ros_name
from swarm_ctl.recording.topics import BY_PAYLOAD, Topic, adapter
from swarm_ctl.station.picture.protection import MeshKind, Protection
from swarm_ctl.station.picture.view import SwarmView
from swarm_ctl.trust.identity import Identity, load_identity

_NODE: Final = "swarm_ctl"
_ORDERS: Final = "orders"
_OF_SOME: Final = (CommandKind.HOLD, CommandKind.RESUME, CommandKind.LAND, CommandKind.RETURN)
_OF_ALL: Final = (*_OF_SOME, CommandKind.NEXT)
"""No `kill` and no `expel`: an operator confirms them, and a service asks no one."""
_DIAGNOSTICS_WALL_S: Final = 1.0
"""The usual rate of `/diagnostics`."""
_ALONE_WALL_S: Final = 3.0
"""For a router to answer, before it is said that none does."""
_LIFETIME_WALL_S: Final = 2.0
"""Of a marker; a station looks at least every half second."""
_OWN_TOPICS: Final = ("pose", "odom", "fix")
_NO_PICTURE: Final = "the station has no picture of the swarm yet"


def services(plan: Plan) -> dict[str, str]:
    """The orders that can be given as a `std_srvs/srv/Trigger`, as an operator types them, by the
    service's name."""
    found = {f"/swarm/{kind}": str(kind) for kind in _OF_ALL}
    for shape in dict.fromkeys(shape.name for shape in plan.shapes):
        found[_free(f"/swarm/form/{ros_name(shape)}", found)] = f"form {shape}"
    for group in group_names(plan):
        free = _free(f"/group_{ros_name(group)}", {name.rpartition("/")[0]: "" for name in found})
        found |= {f"{free}/{kind}": f"{kind} @{group}" for kind in _OF_SOME}
    for agent in plan.agents:
        found |= {f"/{drone(agent.id)}/{kind}": f"{kind} @{agent.id}" for kind in _OF_SOME}
    return found


def _free(name: str, taken: Mapping[str, str]) -> str:
    """`name`, or with a number where two names of the mission become one in ROS."""
    numbered = (f"{name}_{k}" for k in range(2, 2 + len(taken)))
    return name if name not in taken else next(each for each in numbered if each not in taken)


def node_name(agent: int | None) -> str:
    """Of an agent's node; None: of a station's."""
    return _NODE if agent is None else f"{_NODE}_{drone(agent)}"


class Ros2(Extension):
    """The swarm of one station, or the drone of one agent, in a domain of ROS 2, its argument:
    DOMAIN, DOMAIN,FOLDER with the keys that guard the link to ROS 2, or DOMAIN,orders, which lets
    all that reach ROS 2's router order a swarm without keys. Without a domain: `ROS_DOMAIN_ID`, or
    0.

    Where mission time is not the wall clock's, `/clock` tells it, and stamps are of it.
    """

    def __init__(self, argument: str, station: StationHandle) -> None:
        self._domain, identity, self._open = _argument(argument, os.environ)
        if identity is not None and identity.swarm != station.plan.name:
            raise InputError(
                f"ros2={argument}: its keys are of the swarm {identity.swarm}; allowed: those of"
                f" {station.plan.name}"
            )
        self._station = station
        self._simulated = station.stepped or station.speedup != 1.0
        self._accuracy_m: dict[int, float | None] = {}
        self._clock_s = -math.inf
        self._due_wall_s = 0.0
        self._alone_wall_s = wall.wall_s() + _ALONE_WALL_S
        self._why_not = _NO_PICTURE
        """Why no orders are taken; '' where they are."""
        self._own = station.agent
        self._orders = services(station.plan) if self._own is None else {}
        self._node = Ros2Node(self._domain, node_name(self._own), identity)
        self._told_of_two = False
        ids = [None, *(agent.id for agent in station.plan.agents)]
        self._before = {node_name(each) for each in ids[: ids.index(self._own)]}
        """The nodes that tell the clock before this one does."""
        for service in self._orders:
            self._node.serve(service, self._order)
        self.sink = self

    @classmethod
    def check(cls, argument: str) -> None:
        _, identity, _ = _argument(argument, os.environ)
        configuration(os.environ, identity)

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        """Of the mesh's messages only the states go on as they come."""
        del agent, heard_ns, said_ns  # an agent's clock is known to the station as mission time
        if topic is not BY_PAYLOAD[AgentState]:
            return
        state: AgentState = adapter(AgentState).validate_json(data)
        now_s = self._station.now()
        self._tell_clock(now_s)
        if not self._tells(state.agent):
            return
        at, name = self._stamp(state.time_s, now_s), drone(state.agent)
        accuracy_m = self._accuracy_m.get(state.agent)
        self._node.publish(f"/{name}/pose", pose(state, at))
        self._node.publish(f"/{name}/odom", odometry(state, accuracy_m, at))
        self._node.publish("/tf", transforms([(state, at)]))

    def flush(self) -> None:
        """Nothing waits here."""

    def abandon(self) -> None:
        """`close` ends the node."""

    def take(self, view: SwarmView) -> None:
        if wall.wall_s() >= self._alone_wall_s:
            self._alone_wall_s = math.inf
            if not self._node.linked():
                self._station.tell(
                    f"ROS 2 hears nothing yet: no router answers at {self._node.where}"
                    " (ros2 run rmw_zenoh_cpp rmw_zenohd)"
                )
        if self._own is None and not self._told_of_two and _NODE in self._node.others():
            self._told_of_two = True
            self._station.tell(
                f"ROS 2 hears each drone twice: another station is in its domain {self._domain};"
                " allowed: one in a domain (--ros2 DOMAIN)"
            )
        before, self._why_not = self._why_not, self._why_no_orders(view.protection)
        if self._orders and self._why_not not in ("", before):
            self._station.tell(f"no orders from ROS 2: {self._why_not}")
        self._tell_clock(view.time_s)
        at = self._stamp(view.time_s, view.time_s)
        lifetime_s = _LIFETIME_WALL_S * (view.speedup if self._simulated else 1.0)
        mine = [agent.id for agent in view.agents if self._tells(agent.id)]
        self._node.publish("/swarm/markers", markers(view, at, lifetime_s, mine, self._own))
        for agent in view.agents:
            if agent.id not in mine:
                for topic in _OWN_TOPICS:
                    self._node.retract(f"/{drone(agent.id)}/{topic}")
                continue
            accuracy_m = agent.status.position_accuracy_m if agent.status else None
            self._accuracy_m[agent.id] = accuracy_m
            if agent.state is not None and agent.in_plan and not agent.lost:
                true_at = self._stamp(agent.state.time_s, view.time_s)
                told = fix(agent.state, accuracy_m, view.plan.origin, true_at)
                self._node.publish(f"/{drone(agent.id)}/fix", told)
        if wall.wall_s() >= self._due_wall_s:
            self._due_wall_s = wall.wall_s() + _DIAGNOSTICS_WALL_S
            self._node.publish("/diagnostics", diagnostics(view, at, self._own))

    def _tells(self, agent: int) -> bool:
        """It tells this drone's part: of two that could, the drone's own computer does."""
        if self._own is not None:
            return agent == self._own
        return node_name(agent) not in self._node.others()

    def _why_no_orders(self, protection: Protection) -> str:
        """'' where they are taken: from others no easier than on the mesh. ROS 2's router listens
        to all networks unless it is told otherwise; a mesh without keys is this computer's."""
        if not protection.commands:
            return f"{protection.who} may only watch"
        if protection.mesh is MeshKind.TLS and not self._node.guarded:
            return (
                "the swarm has keys, and its link to ROS 2 has none (--attach ros2=DOMAIN,FOLDER)"
            )
        if protection.mesh is MeshKind.LOCAL and self._node.leaves_host:
            return "other computers reach the link to ROS 2, and the swarm has no keys"
        if protection.mesh is MeshKind.LOCAL and not self._open:
            return (
                "the swarm has no keys, and other computers may reach ROS 2's router"
                " (--attach ros2=DOMAIN,orders)"
            )
        return ""

    def _tell_clock(self, now_s: float) -> None:
        """Of all nodes of the swarm, the station's does; else that of the first agent."""
        if not self._simulated:
            return
        if self._before & self._node.others():
            self._node.retract("/clock")
        elif now_s > self._clock_s:
            self._clock_s = now_s
            self._node.publish("/clock", clock(round(now_s * NANO)))

    def _stamp(self, time_s: float, now_s: float) -> Time:
        """Of mission time; on the wall clock, so long ago as it was."""
        if self._simulated:
            return time_of(round(time_s * NANO))
        return time_of(round((wall.unix_s() - (now_s - time_s)) * NANO))

    def _order(self, request: Request) -> None:
        """On zenoh's thread; the answer comes in this extension's."""
        if self._why_not:
            request.answer(False, f"no orders from ROS 2: {self._why_not}")
            return

        def answered(answer: Answer) -> None:
            if isinstance(answer, InputError):
                request.answer(False, str(answer))
            else:
                request.answer(answer.accepted, repr(answer).strip("<>"))

        order = parse(self._orders[request.service], self._station.plan)
        self._station.order(order, answered)

    def close(self) -> None:
        self._node.close()


def _argument(argument: str, environment: Mapping[str, str]) -> tuple[int, Identity | None, bool]:
    """The domain, whose keys guard the link to ROS 2, and whether all that reach it may order."""
    text, _, more = argument.partition(",")
    domain = domain_of(text, environment)
    if more == _ORDERS:
        return domain, None, True
    try:
        return domain, load_identity(Path(more)) if more else None, False
    except TrustError as error:
        raise InputError(f"ros2={argument}: {error}; or {_ORDERS}") from None
