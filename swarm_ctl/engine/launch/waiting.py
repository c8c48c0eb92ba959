"""What `run` waits for, said every few seconds: an operator sees that it has not hung."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from swarm_ctl.core.model.text import agents_named
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.launch.forked import AgentChild
from swarm_ctl.engine.launch.processes import Child

EVERY_WALL_S: Final = 5.0
_POLL_WALL_S: Final = 0.05


class Waiting:
    """Says what is waited for, each `EVERY_WALL_S` from the first call on, until that changes."""

    def __init__(
        self, say: Callable[[str], None], meanwhile: Callable[[], None] = lambda: None
    ) -> None:
        self._say = say
        self._meanwhile = meanwhile
        self._what = ""
        self._since_s = self._due_s = 0.0

    def tell(self, what: str) -> None:
        """Call it as often as you like; '' when there is nothing to wait for."""
        now = wall.wall_s()
        if what != self._what:
            self._what, self._since_s = what, now
            self._due_s = max(self._due_s, now + EVERY_WALL_S)
        if what and now >= self._due_s:
            self._due_s = now + EVERY_WALL_S
            self._say(f"waiting for {what}: {now - self._since_s:.0f} s so far")

    def wait(
        self,
        children: Sequence[Child],
        wall_seconds: float,
        until: str,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Wait until all have ended, at most so long, or until `stop`; `until`: what they do
        meanwhile."""
        end_s = wall.wall_s() + wall_seconds
        while wall.wall_s() < end_s and not stop() and (names := named(children)):
            self.tell(f"{names} {until}")
            self._meanwhile()
            wall.pause(_POLL_WALL_S)
        self.tell("")


def named(children: Sequence[Child]) -> str:
    """Those that still run: `agents 1-3`, `the simulator`; '' if none does."""
    running = [child for child in children if child.exit_code() is None]
    agents = [child.agent for child in running if isinstance(child, AgentChild)]
    names = [agents_named(agents)] if agents else []
    names += [f"the {child.name}" for child in running if not isinstance(child, AgentChild)]
    return ", ".join(names)
