"""The keeper's process, a child of `run`: `python -m swarm_ctl.engine.lockstep.keeper_process RUN`.
It ends when its lifeline has, and all members have left.

All others wait for it to start, so it reads its part of the run folder without pydantic.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path

from swarm_ctl.engine.forked import serve
from swarm_ctl.engine.lifeline import READY, PipeLifeline
from swarm_ctl.engine.lockstep.keeper import Keeper, Rules


def keep(lifeline: PipeLifeline) -> int:
    """Keep mission time; the exit code."""
    run = Path(sys.argv[1])
    address = json.loads((run / "run.json").read_bytes())["lockstep"]
    rules = json.loads((run / "launch.json").read_bytes())["keeper"]

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
