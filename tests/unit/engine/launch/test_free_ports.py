"""Ports for what `run` starts itself."""

from __future__ import annotations

import socket

import pytest

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.local_server import refuse_taken
from swarm_ctl.errors import StartError


def test_free_ports_are_free_and_different() -> None:
    """Each can be bound at once, and none that is taken is offered."""
    taken = free_ports(1, socket.SOCK_STREAM)[0]
    with socket.create_server(("127.0.0.1", taken)):
        ports = free_ports(20, socket.SOCK_STREAM)
        assert len(set(ports)) == 20
        assert taken not in ports
        servers = [socket.create_server(("127.0.0.1", port)) for port in ports]
        for server in servers:
            server.close()


def test_a_taken_port_is_refused() -> None:
    """Before anything of a run is started; one that a server has left is not taken."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with (
            socket.create_connection(("127.0.0.1", port)),
            pytest.raises(StartError, match=f"metrics: 127.0.0.1:{port}: Address already in use"),
        ):
            refuse_taken(port, "metrics")
    refuse_taken(port, "metrics")
