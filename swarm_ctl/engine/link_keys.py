"""The keys that sign the vehicles' links, as a fleet names them."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.core.model.fleet import SigningPolicy as Rule
from swarm_ctl.engine.clock import unix_s
from swarm_ctl.engine.protection import agent_identity_folder, own_identity
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.stamp import kept_signing
from swarm_ctl.trust.identity import MAVLINK_KEY, STAMP

AGENT: Final = 0
"""The link id of an agent's own signatures."""
TOOL: Final = 1
"""Of a command that speaks in the agent's place: a vehicle counts its stamps by themselves."""


@dataclass(frozen=True, slots=True)
class LinkKeys:
    """Where each agent's folder with its key is; without `trust`, or with signing off, links are
    open."""

    trust: str | None = None
    rule: Rule = Rule.OFF
    given: Path | None = None
    """The identity of one agent, whose folder is not in `trust`."""

    @classmethod
    def of(cls, fleet: Fleet, given: Path | None = None) -> LinkKeys:
        """As the fleet says; with an identity that is `given` alone, links are signed."""
        alone = given is not None and fleet.trust is None
        return cls(fleet.trust, Rule.REQUIRED if alone else fleet.signing, given)

    def key_file(self, agent: int) -> Path | None:
        """The file with the key of an agent's vehicle; None: its link is open."""
        folder = self._folder(agent)
        return None if folder is None else folder / MAVLINK_KEY

    def signing(self, agent: int) -> AbstractContextManager[LinkSigning | None]:
        """What signs the link of a command to an agent's vehicle. TrustError where the key can't be
        used."""
        folder = self._folder(agent)
        return nullcontext() if folder is None else folder_signing(folder, TOOL)

    def _folder(self, agent: int) -> Path | None:
        if self.rule is not Rule.REQUIRED:
            return None
        folder = agent_identity_folder(self.trust, agent, self.given)
        if self.given is not None:
            own_identity(folder, agent)
        return folder


OPEN: Final = LinkKeys()


def folder_signing(
    folder: Path, link: int = AGENT, pace: float = 1.0
) -> AbstractContextManager[LinkSigning]:
    """Signing with the key and the stamp in an identity's folder."""
    return kept_signing(folder / MAVLINK_KEY, folder / STAMP, unix_s(), link, pace)
