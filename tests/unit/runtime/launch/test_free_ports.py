"""Ports for what `run` starts itself."""

from __future__ import annotations

import socket

from swarm_ctl.runtime.launch.ports import free_ports


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
