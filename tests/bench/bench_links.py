"""What a link between two hosts does to states when packets are lost and late.

    python -m tests.bench.bench_links tcp udp --loss 0.2 --delay 0.1 --states 6

Two peers in network namespaces (needs root), so many states of 136 bytes each at 20 Hz in each
direction, for 15 s. Of each direction: states that came, how late (p50, p99), and when the first
one came.
"""

from __future__ import annotations

import argparse
import json
import struct
import subprocess
import sys
import time
from typing import Any, Final

from swarm_ctl.mesh.keys import NEWEST
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from tests.hosts.namespaces import Network
from tests.hosts.relay import Air

_SECONDS, _EVERY_S, _START_S = 15.0, 0.05, 20.0
_TOLD: Final = struct.Struct("<d")
_STATE: Final = "swarm/x/agent/{}/state"


def speak(told: dict[str, Any]) -> None:
    """One end: says its states, and prints what came of the other's."""
    mesh = ZenohTransport(told["listen"], told["connect"], time.monotonic)
    inlet, begins, said = mesh.subscribe(_STATE.format("*")), told["begins"], 0
    keys = [_STATE.format(told["id"] * 100 + k) for k in range(told["states"])]
    late: list[float] = []
    first: float | None = None
    while (now := time.monotonic()) < begins + _SECONDS + 3.0:
        if begins + said * _EVERY_S <= now < begins + _SECONDS:
            said += 1
            for key in keys:
                mesh.publish(key, _TOLD.pack(now) + bytes(128), NEWEST)
        for at, _, data in inlet.drain():
            first = at if first is None else first
            late.append(at - _TOLD.unpack_from(bytes(data))[0])
        time.sleep(0.002)
    late.sort()
    came = {f"p{p}_ms": round(1e3 * late[len(late) * p // 100]) for p in (50, 99) if late}
    share = len(late) / (len(keys) * _SECONDS / _EVERY_S)
    heard = None if first is None else round(first - begins, 1)
    print(json.dumps({"came": round(share, 3), "first_s": heard, **came}), flush=True)


def measure(scheme: str, states: int, air: Air) -> None:
    """Print both directions of one link."""
    with Network(2) as network:
        network.air(air)
        begins = time.monotonic() + _START_S
        ends, before = [], list[str]()
        for side, namespace in enumerate(network.sides):
            at = f"{scheme}/{network.address(side)}:7447"
            told = {"id": side + 1, "listen": [at], "connect": before, "begins": begins}
            words = [
                sys.executable,
                "-m",
                __spec__.name,
                "--end",
                json.dumps(told | {"states": states}),
            ]
            ends.append(subprocess.Popen(namespace.inside(words), stdout=subprocess.PIPE))
            before = [at]
        for end in ends:
            print(scheme, end.communicate()[0].decode().strip(), flush=True)


def main() -> None:
    """Measure the schemes one after the other."""
    parser = argparse.ArgumentParser()
    parser.add_argument("schemes", nargs="*")
    parser.add_argument("--loss", type=float, default=0.2)
    parser.add_argument("--delay", type=float, default=0.1)
    parser.add_argument("--states", type=int, default=6)
    parser.add_argument("--end")
    given = parser.parse_args()
    if given.end:
        speak(json.loads(given.end))
        return
    for scheme in given.schemes:
        measure(scheme, given.states, Air(loss=given.loss, delay_s=given.delay))


if __name__ == "__main__":
    main()
