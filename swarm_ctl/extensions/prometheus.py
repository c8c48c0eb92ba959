"""The newest view as Prometheus metrics on a loopback port."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.engine.local_server import LocalServer, answer, port_of, refuse_taken
from swarm_ctl.extension import Extension, StationHandle
from swarm_ctl.station.picture.alarms import RULES, Level, alarms
from swarm_ctl.station.picture.view import AgentView, GroupView, SwarmView

_TEXT: Final = "text/plain; version=0.0.4; charset=utf-8"


def _battery(agent: AgentView) -> float | None:
    percent = agent.status.battery_percent if agent.status else None
    return None if percent is None else percent / 100


_OF_AGENT: Final[dict[str, tuple[str, Callable[[AgentView], float | None]]]] = {
    "phase": (
        "Phase by number: " + ", ".join(f"{p.value} {p.name.lower()}" for p in Phase),
        lambda agent: agent.phase,
    ),
    "state_age_seconds": ("Age of the newest state, mission time", lambda agent: agent.link.age_s),
    "loss_ratio": (
        "Share of states lost on the way to this station, last 10 s",
        lambda agent: agent.link.recent_loss if agent.link.received else None,
    ),
    "round_trip_seconds": (
        "Station to agent and back, mission time",
        lambda agent: agent.round_trip_s,
    ),
    "heartbeat_age_seconds": (
        "Age of the vehicle's last heartbeat, mission time",
        lambda agent: agent.status.heartbeat_age_s if agent.status else None,
    ),
    "battery_ratio": ("Charge of the vehicle's battery", _battery),
    "error_meters": ("Distance from its place in the formation", lambda agent: agent.error_m),
    "nearest_meters": ("Horizontal distance to the nearest agent", lambda agent: agent.nearest_m),
    "tick_rate_hertz": ("Ticks a mission second", lambda agent: agent.link.tick_rate_hz),
    "tick_late_p99_seconds": (
        "Lateness of ticks, wall clock",
        lambda agent: agent.status.tick.late_p99_ms / 1000 if agent.status else None,
    ),
    "states_received": ("States received", lambda agent: agent.link.received),
    "states_lost": ("States lost", lambda agent: agent.link.lost),
}
_OF_GROUP: Final[dict[str, tuple[str, Callable[[GroupView], float | None]]]] = {
    "step": ("The furthest step of a group that flies", lambda group: group.step),
    "agents": ("Agents that fly in it", lambda group: len(group.agents)),
    "error_meters": ("The largest distance of one from its place", lambda group: group.error_m),
    "waits_seconds": ("How long it has waited for others", lambda group: group.waits_s),
}
_COUNTERS: Final = ("states_received", "states_lost")


class Metrics(Extension):
    """Serves on a port of 127.0.0.1, its argument, until closed. A scrape reads the newest view."""

    def __init__(self, argument: str, station: StationHandle) -> None:
        del station
        self._view: SwarmView | None = None
        self._registry = CollectorRegistry()
        self._registry.register(self)
        self._server = LocalServer("metrics", port_of("metrics", argument), self._serve)

    @classmethod
    def check(cls, argument: str) -> None:
        refuse_taken(cls.port(argument), "metrics")

    @classmethod
    def port(cls, argument: str) -> int:
        return port_of("metrics", argument)

    def _serve(self, client: socket.socket, head: bytes) -> None:
        if head.startswith((b"GET ", b"HEAD ")):
            answer(client, "200 OK", generate_latest(self._registry), _TEXT)
        else:
            answer(client, "405 Method Not Allowed", b"allowed: GET\n")

    def take(self, view: SwarmView) -> None:
        self._view = view

    def close(self) -> None:
        self._server.close()

    def describe(self) -> list[Metric]:
        """Nothing is known before the first view."""
        return []

    def collect(self) -> Iterator[Metric]:
        """All metrics of the newest view, as Prometheus asks for them."""
        view = self._view
        if view is None:
            return
        yield GaugeMetricFamily("swarm_time_seconds", "Mission time", value=view.time_s)
        yield GaugeMetricFamily("swarm_step", "The furthest step any agent is in", value=view.step)
        for name, (words, of) in _OF_GROUP.items():
            family = GaugeMetricFamily(f"swarm_group_{name}", words, labels=("group",))
            for group in view.groups:
                if (value := of(group)) is not None:
                    family.add_metric((group.name,), value)
            yield family
        yield GaugeMetricFamily("swarm_agents", "Agents of the plan", value=len(view.plan.agents))
        yield CounterMetricFamily("swarm_events", "Events heard", value=view.event_count)
        standing = [alarm.name for alarm in alarms(view)]
        raised = GaugeMetricFamily("swarm_alarms", "Alarms that stand", labels=("name", "level"))
        for rule in RULES:
            labels = (rule.name, Level(rule.level).name.lower())
            raised.add_metric(labels, standing.count(rule.name))
        yield raised
        for name, (words, value_of) in _OF_AGENT.items():
            kind = CounterMetricFamily if name in _COUNTERS else GaugeMetricFamily
            figures = kind(f"swarm_agent_{name}", words, labels=("agent",))
            for agent in view.agents:
                if (value := value_of(agent)) is not None:
                    figures.add_metric((str(agent.id),), value)
            yield figures
