"""Prometheus metrics: what a scrape gets, and from where."""

from __future__ import annotations

import socket
import urllib.request
from contextlib import closing
from types import SimpleNamespace

import pytest
from prometheus_client.parser import text_string_to_metric_families

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.local_server import HOST
from swarm_ctl.errors import StartError
from swarm_ctl.extensions.prometheus import Metrics
from tests.unit.station.pictures import PICTURES

pytestmark = pytest.mark.foreign


def metrics_on(port: int) -> Metrics:
    return Metrics(str(port), SimpleNamespace())


def _scrape(port: int) -> dict[tuple[str, str], float]:
    """(name, agent, alarm or group) -> value."""
    with urllib.request.urlopen(f"http://{HOST}:{port}/metrics") as answer:
        families = list(text_string_to_metric_families(answer.read().decode()))
    samples = (sample for family in families for sample in family.samples)
    label = ("agent", "name", "group")
    return {
        (s.name, next((s.labels[name] for name in label if name in s.labels), "")): s.value
        for s in samples
    }


def test_a_scrape_gets_the_newest_view() -> None:
    (port,) = free_ports(1, socket.SOCK_STREAM)
    with closing(metrics_on(port)) as metrics:
        assert _scrape(port) == {}
        metrics.take(PICTURES["waiting"]())
        assert ("swarm_agent_battery_ratio", "6") not in _scrape(port)
        metrics.take(PICTURES["lost"]())
        found = _scrape(port)
    assert found["swarm_alarms", "silent"] == 1
    assert found["swarm_alarms", "too close"] == 0
    assert found["swarm_agent_phase", "1"] == 5
    assert found["swarm_agent_battery_ratio", "4"] == pytest.approx(0.87)
    assert found["swarm_agent_states_received_total", "3"] == 200
    assert found["swarm_time_seconds", ""] == 34.0


def test_each_group_has_a_step_of_its_own() -> None:
    (port,) = free_ports(1, socket.SOCK_STREAM)
    with closing(metrics_on(port)) as metrics:
        metrics.take(PICTURES["groups"]())
        found = _scrape(port)
    groups = {"scouts": (5, 4), "sweepers": (4, 6), "rest": (3, 2)}
    for name, (step, agents) in groups.items():
        assert found["swarm_group_step", name] == step
        assert found["swarm_group_agents", name] == agents
    assert found["swarm_group_waits_seconds", "scouts"] == pytest.approx(13.9)
    assert ("swarm_group_waits_seconds", "sweepers") not in found


def test_a_taken_port_is_refused_with_words() -> None:
    with socket.socket() as held:
        held.bind((HOST, 0))
        held.listen()
        with pytest.raises(StartError, match="Address already in use; name another port"):
            metrics_on(held.getsockname()[1])
        with pytest.raises(StartError, match="Address already in use; name another port"):
            Metrics.check(str(held.getsockname()[1]))
