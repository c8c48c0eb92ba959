"""`python -m sim --config FILE`: a swarm of simulated MAVLink vehicles.

Prints one line of JSON on stdout when ready. Stdin is the lifeline: at its end the simulator waits
until all vehicles are parked, then exits. Exit codes: 0 done, 2 bad configuration, 3 a port or file
can't be opened.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from pathlib import Path

from sim.clock import Clock
from sim.config import ConfigError, load_config
from sim.network.server import PortError, Server, signals


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m sim", description="Simulated MAVLink vehicles."
    )
    parser.add_argument("--config", type=Path, required=True, help="JSON configuration file")
    arguments = parser.parse_args()
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="sim: %(levelname)s: %(message)s"
    )
    try:
        config = load_config(arguments.config)
    except ConfigError as error:
        print(f"sim: {error}", file=sys.stderr)  # noqa: T201
        return 2
    try:
        with (
            Server(config, Clock(config.epoch_s, config.speedup), sys.stdin) as server,
            signals(server),
        ):
            ready = [{"sysid": v.sysid, "endpoint": v.endpoint} for v in config.vehicles]
            print(json.dumps({"ready": True, "vehicles": ready}), flush=True)  # noqa: T201
            server.serve()
            server.report()
    except ValueError as error:  # the signing key
        print(f"sim: {config.signing_key_path}: {error}", file=sys.stderr)  # noqa: T201
        return 2
    except PortError as error:
        print(f"sim: {error}", file=sys.stderr)  # noqa: T201
        return 3
    except OSError as error:
        print(f"sim: {error.filename or ''}: {error.strerror}", file=sys.stderr)  # noqa: T201
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
