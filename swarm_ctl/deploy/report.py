"""What a host says of itself, in JSON over SSH. It is bounded: the host may be taken over."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, TypeAlias

from pydantic import BaseModel, Field

_Words: TypeAlias = Annotated[str, Field(max_length=2000)]


class ReportedState(StrEnum):
    """How one process of a host stands."""

    RUNNING = "running"
    ENDED = "ended"
    """By its own word: completed, or landed on command."""
    FAILED = "failed"
    STOPPED = "stopped"
    """Not started, or a router that was stopped."""


class ServiceReport(BaseModel):
    """One process."""

    name: _Words
    state: ReportedState
    said: _Words = ""
    """Its last line, of one that does not run."""


class HostReport(BaseModel):
    """What a host says of itself."""

    version: _Words
    manager: _Words
    """What looks after the processes."""
    next: _Words = ""
    """The digest of the bundle taken in last."""
    current: _Words = ""
    """The digest of the bundle that runs, or ran last."""
    host: _Words = ""
    """The fleet's name of this host, in the current bundle."""
    swarm: _Words = ""
    whole_hash: _Words = ""
    """Of the plan, fleet and signing of the current bundle."""
    services: tuple[ServiceReport, ...] = Field(default=(), max_length=300)
    attention: tuple[_Words, ...] = Field(default=(), max_length=600)
    """What will keep the next bundle, or else the current one, from flying."""

    @property
    def running(self) -> tuple[str, ...]:
        """The processes that run, landing ones among them."""
        return tuple(each.name for each in self.services if each.state is ReportedState.RUNNING)

    @property
    def failed(self) -> tuple[ServiceReport, ...]:
        """The processes that did not start, or broke off."""
        return tuple(each for each in self.services if each.state is ReportedState.FAILED)
