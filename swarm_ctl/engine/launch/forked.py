"""The processes that `run` forks, from a server that has imported everything already (32 agents in
0.2 s instead of 2.7 s): the agents, and the router of a large swarm."""

from __future__ import annotations

import contextlib
import multiprocessing
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Final

from swarm_ctl.engine.clock import wall_s
from swarm_ctl.engine.forked import serve_forked
from swarm_ctl.engine.launch import children
from swarm_ctl.engine.launch.processes import Child
from swarm_ctl.engine.lifeline import ALIVE, READY, ChildWords, Lifeline
from swarm_ctl.errors import StartError
from swarm_ctl.signals import deaf_children, deaf_tracker

_LOOK_WALL_S: Final = 0.05
ROUTER_HUNG_WALL_S: Final = 1.5
"""In real time, as peers are lost after 5 s."""
_AGAIN_WALL_S: Final = 1.0
"""From a router that did not start to the next attempt."""
_START_LOOKS: Final = 200
"""For its start, 10 s: a busy machine takes long, and one that is ended too soon never starts."""


class ForkedChild(Child):
    """Does a work of `children` in a process of its own."""

    def __init__(
        self,
        name: str,
        log: Path,
        work: Callable[[Path, int, Lifeline], int],
        folder: Path,
        number: int = 0,
        end: str = "",
    ) -> None:
        super().__init__(name, log, end)
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["swarm_ctl.engine.launch.preload"])
        self._lifeline, theirs = context.Pipe()
        told = work, folder, number, log, theirs
        self._process = context.Process(target=serve_forked, args=told, name=name, daemon=False)
        with _without_main():
            deaf_tracker()
            with deaf_children():
                self._process.start()
        self.pid = self._process.pid or 0
        theirs.close()
        self._words = ChildWords(self._lifeline)
        self._heard_wall_s = wall_s()

    def silent_wall_s(self) -> float:
        """Seconds since it last said that it is alive (an agent does with every status)."""
        if self.words():
            self._heard_wall_s = wall_s()
        return wall_s() - self._heard_wall_s

    def exit_code(self) -> int | None:
        return self._process.exitcode

    def let_go(self) -> None:
        self._lifeline.close()

    def kill(self) -> None:
        if self._process.exitcode is None:
            self._process.kill()
        self._process.join()
        self._lifeline.close()


class AgentChild(ForkedChild):
    """An agent."""

    def __init__(self, folder: Path, agent: int) -> None:
        log = folder / "agents" / f"{agent}.log"
        super().__init__(f"agent-{agent}", log, children.agent, folder, agent)
        self.agent = agent

    @property
    def title(self) -> str:
        return self.name


class RadioLink(ForkedChild):
    """The link of a radio that agents share. One that ends is not started again: its vehicles' own
    failsafes have acted by then, and an agent must not take such a vehicle up again."""

    def __init__(self, folder: Path, number: int, radio: str) -> None:
        name = f"link-{number}"
        end = f"the {name} to {radio} has ended: its vehicles land by their own failsafes"
        super().__init__(name, folder / f"{name}.log", children.link, folder, number, end)


class HostRouter:
    """The router of this host; one that ends, or says nothing for `hung_wall_s`, is started again,
    on the same port. It speaks ten times a second."""

    def __init__(self, folder: Path, say: Callable[[str], None], hung_wall_s: float) -> None:
        # Looks, and not seconds: what stops all processes has not hung the router.
        self._hung_looks = round(hung_wall_s / _LOOK_WALL_S)
        self._folder = folder
        self._say = say
        self.child = self._start()
        self._silent_looks = 0
        self._starts_again = False
        self._failure_told = False
        self._due_wall_s = 0.0

    def _start(self) -> ForkedChild:
        return ForkedChild("router", self._folder / "router.log", children.router, self._folder)

    def look(self) -> bool:
        """Call it every 50 ms; True when there is another router than before."""
        if self._starts_again:
            return self._see_to_start()
        words = self.child.words()
        for word in words:
            if word not in (ALIVE, READY):
                self._say(f"the router: {word}")
        self._silent_looks = 0 if words else self._silent_looks + 1
        code = self.child.exit_code()
        if code is None and self._silent_looks < self._hung_looks:
            return False
        what = "hangs" if code is None else f"has ended, exit code {code}"
        self._say(f"the router {what}: the mesh is cut; it is started again")
        self.child.kill()
        return self._again()

    def _again(self) -> bool:
        self._silent_looks, self._starts_again = 0, True
        self.child = self._start()
        return True

    def _see_to_start(self) -> bool:
        if self._due_wall_s:
            if wall_s() < self._due_wall_s:
                return False
            self._due_wall_s = 0.0
            return self._again()
        try:
            if self.child.poll_ready():
                self._say("the router is there again")
                self._starts_again = self._failure_told = False
                return False
            self._silent_looks += 1
            if self._silent_looks < _START_LOOKS:
                return False
            raise StartError("the router did not start: it says nothing")
        except StartError as error:
            if not self._failure_told:
                self._failure_told = True
                self._say(
                    f"{error}; the mesh stays cut, each agent does as its policy says; trying on"
                )
            self.child.kill()
            self._due_wall_s = wall_s() + _AGAIN_WALL_S
            return False


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Keep multiprocessing from importing our command line (typer, missions) into every agent as
    `__mp_main__`."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
