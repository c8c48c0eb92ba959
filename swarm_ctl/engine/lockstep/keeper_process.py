"""The keeper's process, a child of `run`: `python -m swarm_ctl.engine.lockstep.keeper_process
ADDRESS RULES` (JSON). It says on stdout, in JSON lines, that it is ready, and what the operator is
to know. It ends when stdin has (`run` is gone, or lets it go) and all members have left."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys

from swarm_ctl.engine.lockstep.keeper import Keeper, Rules


def main() -> int:
    """Entry."""
    address, rules = sys.argv[1], json.loads(sys.argv[2])
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # `run` answers Ctrl-C
    keeper = Keeper(Rules(**rules | {"expected": tuple(rules["expected"])}), address, _note)
    stdin = sys.stdin.fileno()

    def read() -> None:
        if not os.read(stdin, 4096):
            keeper.over = True
            keeper.unwatch(stdin)

    os.set_blocking(1, False)  # a `run` that does not read must not stop the clock
    keeper.watch(stdin, read)
    _say(say="ready")
    with contextlib.closing(keeper):
        keeper.serve()
    return 0


def _note(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    _say(note=f"lockstep: {text}")


def _say(**word: str) -> None:
    with contextlib.suppress(OSError):  # `run` is gone
        os.write(1, json.dumps(word).encode() + b"\n")


if __name__ == "__main__":
    sys.exit(main())
