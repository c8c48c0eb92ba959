"""The keeper's process, a child of `run`: `python -m swarm_ctl.engine.lockstep.keeper_process
ADDRESS RULES` (JSON). It ends when its lifeline has, and all members have left."""

from __future__ import annotations

import contextlib
import json
import sys

from swarm_ctl.engine.forked import serve
from swarm_ctl.engine.lifeline import READY, PipeLifeline
from swarm_ctl.engine.lockstep.keeper import Keeper, Rules


def keep(lifeline: PipeLifeline) -> int:
    """Keep mission time; the exit code."""
    address, rules = sys.argv[1], json.loads(sys.argv[2])

    def note(text: str) -> None:
        sys.stderr.write(f"{text}\n")
        lifeline.tell(f"lockstep: {text}")

    keeper = Keeper(Rules(**rules | {"expected": tuple(rules["expected"])}), address, note)
    stdin = sys.stdin.fileno()

    def read() -> None:
        if lifeline.cut():
            keeper.over = True
            keeper.unwatch(stdin)

    keeper.watch(stdin, read)
    lifeline.tell(READY)
    with contextlib.closing(keeper):
        keeper.serve()
    return 0


if __name__ == "__main__":
    serve(keep)
