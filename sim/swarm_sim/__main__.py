"""`python -m swarm_sim --config FILE`: a swarm of simulated MAVLink vehicles.

It prints one line of JSON on stdout when ready, and later lines with a `note` for an operator.
Stdin is the lifeline: at its end the simulator waits until all vehicles are parked, then exits.
Exit codes: 0 done, 2 bad configuration, 3 a port or file can't be opened.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import sys
from pathlib import Path

from swarm_sim.clock import SimClock
from swarm_sim.config import ConfigError, load_config
from swarm_sim.network.server import EndpointError, Server, signals


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m swarm_sim", description="Simulated MAVLink vehicles."
    )
    parser.add_argument("--config", type=Path, required=True, help="JSON configuration file")
    arguments = parser.parse_args()
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="sim: %(levelname)s: %(message)s"
    )
    try:
        config = load_config(arguments.config)
    except ConfigError as error:
        return _failed(2, str(error))
    try:
        clock = SimClock(config.epoch_s, config.speedup)
        with Server(config, clock, sys.stdin, _tell) as server, signals(server):
            ready = [{"sysid": v.sysid, "endpoint": v.endpoint} for v in config.vehicles]
            print(json.dumps({"ready": True, "vehicles": ready}), flush=True)  # noqa: T201
            server.serve()
            server.report()
    except ValueError as error:  # the signing key
        return _failed(2, str(error))
    except EndpointError as error:
        return _failed(3, str(error))
    except OSError as error:
        return _failed(3, f"{error.filename or ''}: {error.strerror}")
    return 0


def _tell(text: str) -> None:
    with contextlib.suppress(OSError):  # the process that started this one is gone
        print(json.dumps({"note": text}), flush=True)  # noqa: T201


def _failed(code: int, reason: str) -> int:
    print(f"sim: {reason}", file=sys.stderr)  # noqa: T201
    return code


if __name__ == "__main__":
    sys.exit(main())
