"""Stands in for an autopilot's program where only its start and end matter: it takes ArduCopter's
or PX4's command line, says that it may be armed, and confirms parameters.

While the file `armed` is in its folder, it says that it is armed; `said` is there once it has.
"""

from __future__ import annotations

import contextlib
import socket
import sys
import time
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect


def _wire(arguments: list[str]) -> tuple[socket.socket, int]:
    """The link to the process that starts autopilots, and the system id."""
    if "-I" in arguments:
        port = 5763 + 10 * int(arguments[arguments.index("-I") + 1])
        with socket.create_server(("127.0.0.1", port)) as server:
            sysid = int(arguments[arguments.index("--sysid") + 1])
            return server.accept()[0], sysid
    instance = int(arguments[arguments.index("-i") + 1])
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.connect(("127.0.0.1", 14030 + instance))
    (line,) = [
        line for line in Path("bin/px4-rc.params").read_text().splitlines() if "MAV_SYS_ID" in line
    ]
    return wire, int(line.split()[-1])


def main() -> None:
    wire, sysid = _wire(sys.argv)
    wire.settimeout(0.05)
    codec = dialect.MAVLink(None, sysid, 1)
    codec.robust_parsing = True
    may_arm = dialect.MAV_SYS_STATUS_PREARM_CHECK
    while True:
        armed = 128 if Path("armed").exists() else 0
        said = [
            dialect.MAVLink_heartbeat_message(2, 3, 1 | armed, 0, 3, 3),
            dialect.MAVLink_sys_status_message(may_arm, may_arm, may_arm, *(0,) * 10),
        ]
        try:
            for message in codec.parse_buffer(wire.recv(4096)) or []:
                if message.get_type() == "PARAM_SET":
                    name, value = message.param_id.encode(), message.param_value
                    said.append(dialect.MAVLink_param_value_message(name, value, 9, 1, 0))
        except OSError:  # none yet, or the other end has gone: it never ends by itself
            pass
        for message in said:
            with contextlib.suppress(OSError):
                wire.send(message.pack(codec))
        if armed:
            Path("said").touch()
        time.sleep(0.02)


main()
