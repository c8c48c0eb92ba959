"""The newest view as Prometheus metrics on a loopback port; imported only when asked for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, Self

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.errors import StartError
from swarm_ctl.station.picture.alarms import RULES, Level, alarms
from swarm_ctl.station.picture.view import AgentView, SwarmView

HOST: Final = "127.0.0.1"
_GAUGES: Final = {
    "swarm_agent_phase": (
        "Phase by number: " + ", ".join(f"{p.value} {p.name.lower()}" for p in Phase),
        "phase",
    ),
    "swarm_agent_state_age_seconds": ("Age of the newest state, mission time", "age"),
    "swarm_agent_loss_ratio": (
        "Share of states lost on the way to this station, last 10 s",
        "loss",
    ),
    "swarm_agent_round_trip_seconds": ("Station to agent and back, mission time", "trip"),
    "swarm_agent_heartbeat_age_seconds": (
        "Age of the vehicle's last heartbeat, mission time",
        "beat",
    ),
    "swarm_agent_battery_ratio": ("Charge of the vehicle's battery", "battery"),
    "swarm_agent_error_meters": ("Distance from its place in the formation", "error"),
    "swarm_agent_nearest_meters": ("Horizontal distance to the nearest agent", "near"),
    "swarm_agent_tick_rate_hertz": ("Ticks a mission second", "rate"),
    "swarm_agent_tick_late_p99_seconds": ("Lateness of ticks, wall clock", "late"),
}


class Metrics:
    """Serves on `HOST:port` until closed; StartError where the port is taken. A scrape reads the
    newest view."""

    def __init__(self, port: int) -> None:
        self.view: SwarmView | None = None
        registry = CollectorRegistry()
        registry.register(self)
        try:
            self._server, self._thread = start_http_server(port, HOST, registry)
        except OSError as error:
            raise StartError(
                f"metrics: {HOST}:{port}: {error.strerror}; name another port"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def describe(self) -> list[Metric]:
        """Nothing is known before the first view."""
        return []

    def collect(self) -> Iterator[Metric]:
        """All metrics of the newest view, as Prometheus asks for them."""
        view = self.view
        if view is None:
            return
        yield GaugeMetricFamily("swarm_time_seconds", "Mission time", value=view.time_s)
        yield GaugeMetricFamily("swarm_step", "The furthest step any agent is in", value=view.step)
        yield GaugeMetricFamily("swarm_agents", "Agents of the plan", value=len(view.plan.agents))
        yield CounterMetricFamily("swarm_events", "Events heard", value=view.event_count)
        standing = alarms(view)
        raised = GaugeMetricFamily("swarm_alarms", "Alarms that stand", labels=("name", "level"))
        for rule in RULES:
            count = sum(alarm.name == rule.name for alarm in standing)
            raised.add_metric((rule.name, Level(rule.level).name.lower()), count)
        yield raised
        for name, (words, key) in _GAUGES.items():
            family = GaugeMetricFamily(name, words, labels=("agent",))
            for agent in view.agents:
                value = _values(agent)[key]
                if value is not None:
                    family.add_metric((str(agent.id),), value)
            yield family
        received = CounterMetricFamily(
            "swarm_agent_states_received", "States received", labels=("agent",)
        )
        lost = CounterMetricFamily("swarm_agent_states_lost", "States lost", labels=("agent",))
        for agent in view.agents:
            received.add_metric((str(agent.id),), agent.link.received)
            lost.add_metric((str(agent.id),), agent.link.lost)
        yield received
        yield lost


def _values(agent: AgentView) -> dict[str, float | None]:
    status, link = agent.status, agent.link
    return {
        "phase": agent.phase,
        "age": link.age_s,
        "loss": link.recent_loss if link.received else None,
        "trip": agent.round_trip_s,
        "beat": status.heartbeat_age_s if status else None,
        "battery": status.battery_percent / 100
        if status and status.battery_percent is not None
        else None,
        "error": agent.error_m,
        "near": agent.nearest_m,
        "rate": link.tick_rate_hz,
        "late": status.tick.late_p99_ms / 1000 if status else None,
    }
