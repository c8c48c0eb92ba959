"""What a member of the mesh refused, by the owner of the key that it came under and the reason."""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.messages import Refusal, RefusalReason
from swarm_ctl.core.model.text import printable

RECENT_S: Final = 10.0
"""A refusal is told for so long."""
_OWNERS: Final = 64
OTHERS: Final = "others"
"""All owners beyond `_OWNERS` within `RECENT_S`."""
_TOLD: Final = 8
_NAME: Final = 40


def named(owner: tuple[str, str]) -> str:
    """`agent 7`: an owner of keys for an operator, safe on a terminal whatever its name is."""
    return f"{owner[0]} {printable(owner[1], _NAME)}"


class Refusals:
    """A table of bounded size."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, RefusalReason], Refusal] = {}
        self.unread = 0
        """Messages that were refused for what they are: too large, unreadable, another owner's."""

    def add(
        self, owner: str, reason: RefusalReason, words: str, now: float, count: int = 1
    ) -> None:
        """Count `count` messages of `owner` at `now` [s]."""
        if reason is not RefusalReason.TOO_MANY:
            self.unread += count
        words = printable(words)
        if (owner, reason) not in self._kept and len(self._kept) >= _OWNERS:
            old = [key for key, kept in self._kept.items() if now - kept.time_s > RECENT_S]
            for key in old:
                del self._kept[key]
            owner = owner if old else OTHERS
        before = self._kept.get((owner, reason))
        total = count + (before.count if before else 0)
        self._kept[owner, reason] = Refusal(owner, reason, words, total, now)

    def recent(self, now: float) -> tuple[Refusal, ...]:
        """Those of the last `RECENT_S`, the newest first, at most eight."""
        if not self._kept:
            return ()
        found = [refusal for refusal in self._kept.values() if now - refusal.time_s <= RECENT_S]
        return tuple(sorted(found, key=lambda refusal: -refusal.time_s)[:_TOLD])
