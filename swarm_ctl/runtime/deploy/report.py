"""What a host says of itself, in JSON over SSH."""

from __future__ import annotations

from enum import StrEnum

from pydantic import BaseModel


class State(StrEnum):
    """How one process of a host stands."""

    RUNNING = "running"
    ENDED = "ended"
    """By its own word: completed, or landed on command."""
    FAILED = "failed"
    STOPPED = "stopped"
    """Not started, or a router that was stopped."""


class ServiceReport(BaseModel):
    """One process."""

    name: str
    state: State
    said: str = ""
    """Its last line, of one that does not run."""


class HostReport(BaseModel):
    """What a host says of itself."""

    version: str
    manager: str
    """What looks after the processes."""
    next: str = ""
    """The digest of the bundle taken in last."""
    current: str = ""
    """The digest of the bundle that runs, or ran last."""
    host: str = ""
    """The fleet's name of this host, in the current bundle."""
    swarm: str = ""
    plan_hash: str = ""
    """Of the current bundle."""
    services: tuple[ServiceReport, ...] = ()
    attention: tuple[str, ...] = ()
    """What will keep the next bundle, or else the current one, from flying."""

    @property
    def running(self) -> tuple[str, ...]:
        """The processes that run, landing ones among them."""
        return tuple(each.name for each in self.services if each.state is State.RUNNING)
