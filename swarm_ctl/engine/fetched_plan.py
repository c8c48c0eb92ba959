"""An agent's plan from a ground station, by name and hash; kept on this computer, so that an agent
that starts again in flight needs no station."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.protection import access, explained
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.files import replacing
from swarm_ctl.mesh.keys import owner_of, plan_key
from swarm_ctl.mesh.zenoh_config import MeshPart
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.offers import Offers, PlanName
from swarm_ctl.mission.compile.plan_file import PlanFile, read_plan
from swarm_ctl.trust.identity import Identity

ASK_WALL_S: Final = 1.0
"""Between two questions: a station may come, or be linked, at any time."""
_POLL_WALL_S: Final = 0.02
_UNREAD: Final = 64


class Asked(Protocol):
    """What answers questions on the mesh: `ZenohTransport`."""

    def ask(self, key_expression: str, take: Callable[[str, bytes], None]) -> None:
        """Ask all that serve a key that matches; `take` gets each answer, on any thread."""


@dataclass(frozen=True, slots=True)
class AgentPost:
    """Where an agent is on the mesh before it has a plan: it listens for those that connect to it
    (a station does), and connects, or is the client of a router."""

    listen: tuple[str, ...]
    connect: tuple[str, ...]
    router: str | None = None

    @property
    def endpoints(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.listen, *self.connect, *((self.router,) if self.router else ()))

    def __str__(self) -> str:
        if self.router:
            return f"asking at router {self.router}"
        ways = [f"listening at {at}" for at in self.listen]
        return ", ".join([*ways, *(f"asking at {at}" for at in self.connect)])


def fetched_plan(
    wanted: PlanName,
    folder: Path,
    post: AgentPost,
    identity: Identity | None,
    patience_s: float,
    own: Mapping[str, Any] | None = None,
) -> PlanFile:
    """The plan of this name that a station has; it is kept in `folder`. `own`: a user's zenoh
    settings.

    Raises:
        InputError: stations have different plans of the name.
        StartError: no station offers it in `patience_s` of the wall clock, or the mesh does not
            open.
    """
    sys.stderr.write(f"agent: waits {patience_s:g} s for {wanted} of a station, {post}\n")
    part = MeshPart.CLIENT if post.router else MeshPart.PEER
    connect = [post.router] if post.router else post.connect
    mesh = ZenohTransport(
        post.listen, connect, wall.wall_s, access=access(identity, wanted.name), part=part, own=own
    )
    with closing(mesh):
        offers = Offers(wanted)
        found = await_offer(offers, mesh, patience_s)
    if found is None:
        raise StartError(_missed(offers, post, explained(identity, connect), patience_s))
    sys.stderr.write(f"agent: {found.name}, from a station\n")
    _keep(found, folder)
    return found


def await_offer(
    offers: Offers,
    mesh: Asked,
    patience_s: float,
    now: Callable[[], float] = wall.wall_s,
    pause: Callable[[float], None] = wall.pause,
) -> PlanFile | None:
    """Ask until an offer is chosen; None: none was in time."""
    answers: deque[tuple[str, bytes]] = deque(maxlen=_UNREAD)
    until, ask_s = now() + patience_s, now()
    while now() < until:
        if now() >= ask_s:
            ask_s = now() + ASK_WALL_S
            mesh.ask(plan_key(offers.wanted.name, "*"), lambda *answer: answers.append(answer))
        while answers:
            key, data = answers.popleft()
            offers.hear(owner_of(key)[1], data, now())
        if found := offers.chosen(now()):
            return found
        pause(_POLL_WALL_S)
    return None


def _missed(offers: Offers, post: AgentPost, why: str, patience_s: float) -> str:
    told = list(offers.refusals()) or [why or "no station answered"]
    return (
        f"no plan {offers.wanted} in {patience_s:g} s, {post}: {'; '.join(told)}; allowed: a"
        " station that flies it and reaches this agent (swarm-ctl station --mission FILE), or a"
        " plan file"
    )


def kept_plan(wanted: PlanName, folder: Path) -> PlanFile | None:
    """The plan of this hash that was fetched before; a damaged file is told and fetched again. Of a
    name alone, no plan: it may be another one today. InputError where several have this hash."""
    if not wanted.digits:
        return None
    found = []
    for path in sorted(folder.glob(f"{wanted}*.json")):
        try:
            found.append((path, read_plan(path)))
        except InputError as error:
            sys.stderr.write(f"agent: not used: {error}\n")
    if len(found) > 1:
        names = ", ".join(each.name for _, each in found)
        raise InputError(f"{wanted} names several plans in {folder}: {names}; allowed: one of them")
    for path, each in found:
        if not wanted.mistake(each):
            sys.stderr.write(f"agent: {each.name}, fetched before: {path}\n")
            return each
    return None


def _keep(found: PlanFile, folder: Path) -> None:
    """A full disk keeps no agent on the ground, but from starting again without a station."""
    path = folder / f"{found.name}.json"
    try:
        folder.mkdir(0o700, parents=True, exist_ok=True)
        with replacing(path, 0o600, durable=True) as file:
            file.write(found.model_dump_json(indent=1).encode())
    except OSError as error:
        sys.stderr.write(
            f"agent: {path} can't be kept: {error.strerror}; a restart needs a station\n"
        )
