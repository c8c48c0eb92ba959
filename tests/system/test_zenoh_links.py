"""What zenoh's links do to this process when the other end does not answer any more."""

from __future__ import annotations

import os
import socket
import stat
import struct
import sys
import time
from pathlib import Path

import pytest

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh.keys import NEWEST
from swarm_ctl.mesh.links import Sockets
from swarm_ctl.mesh.zenoh_transport import ZenohTransport, _tend_socket


def lingering(port: int) -> dict[tuple[int, int], bool]:
    """Whether close() waits, of each TCP connection of this process with `port` at an end: by its
    two ports."""
    found = {}
    for descriptor in [int(entry.name) for entry in Path("/dev/fd").iterdir()]:
        try:
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                continue
            with socket.socket(fileno=os.dup(descriptor)) as one:
                ends = (one.getsockname()[1], one.getpeername()[1])
                if port in ends:
                    linger, _ = struct.unpack(
                        "ii", one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                    )
                    found[ends] = bool(linger)
        except (OSError, IndexError):
            continue  # closed meanwhile, or not connected, or no TCP
    return found


def test_no_link_waits_for_its_last_bytes() -> None:
    """Both ends of a link close at once, whichever end has opened it: SO_LINGER blocks the thread
    that carries all others. No link has shared memory: a container's /dev/shm would be full."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    one = ZenohTransport([f"tcp/127.0.0.1:{port}"], [], time.monotonic)
    two = ZenohTransport([], [f"tcp/127.0.0.1:{port}"], time.monotonic)
    try:
        inlet, until = one.subscribe("a/*"), time.monotonic() + 10
        while not inlet.drain():
            assert time.monotonic() < until
            two.publish("a/b", b"hello", NEWEST)
            time.sleep(0.01)
        links = lingering(port)
        assert len(links) == 2
        assert not any(links.values())
        maps = Path("/proc/self/maps").read_text()
        assert "/dev/shm" not in maps  # noqa: S108 - looked for, not written
    finally:
        one.close()
        two.close()


@pytest.mark.skipif(sys.platform != "linux", reason="names TCP's options as Linux does")
def test_a_link_to_another_host_bears_loss() -> None:
    """What listens for other hosts, and so each link that it accepts, sends on where packets are
    lost, if the kernel has BBR; a link within the host stays as it is."""
    offered = Path("/proc/sys/net/ipv4/tcp_available_congestion_control").read_text().split()
    with (
        socket.create_server(("", 0)) as far,
        socket.create_server(("127.0.0.1", 0)) as listening,
        socket.create_connection(listening.getsockname()) as near,
    ):
        for one in (far, near):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, b"reno")
        Sockets().look(_tend_socket)
        assert control(far) == ("bbr" if "bbr" in offered else "reno")
        assert control(near) == "reno"


def control(one: socket.socket) -> str:
    """What decides how much the socket sends."""
    name = one.getsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, 16)
    return name.rstrip(b"\0").decode()
