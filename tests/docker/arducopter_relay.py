#!/usr/bin/env python3
"""`arducopter` of the test's image: the binary, and a relay from the container's address to it
where the build listens on loopback alone."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

PORT = 5760
LISTENS = re.compile(rf"(\w{{8}}):{PORT:04X} 0{{8}}:0000 0A")
LOOPBACK = "0100007F"


def main() -> int:
    """The process: its exit code is the binary's."""
    autopilot = subprocess.Popen(["/usr/local/bin/arducopter.bin", *sys.argv[1:]])
    signal.signal(signal.SIGTERM, lambda *_: autopilot.kill())
    while not (at := LISTENS.search(Path("/proc/net/tcp").read_text())):
        time.sleep(0.1)
    if at[1] == LOOPBACK:
        threading.Thread(target=relay, daemon=True).start()
    return autopilot.wait()


def relay() -> None:
    """Each connection gets one of its own to the autopilot."""
    with socket.create_server((socket.gethostbyname(socket.gethostname()), PORT)) as server:
        while True:
            near, _ = server.accept()
            far = socket.create_connection(("127.0.0.1", PORT))
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for ends in ((near, far), (far, near)):
                threading.Thread(target=pump, args=ends, daemon=True).start()


def pump(source: socket.socket, sink: socket.socket) -> None:
    """Until one end closes; then both do."""
    with contextlib.suppress(OSError):
        while data := source.recv(65536):
            sink.sendall(data)
    for end in (source, sink):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


if __name__ == "__main__":
    sys.exit(main())
