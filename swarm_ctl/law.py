"""What a law of your own is written with; docs/understand/law.md#an-own-law.

A law is a module. `terms(me, others, p, memory)` gives the `LawTerms` of one receiver, and is all
that it needs. It may have `Parameters`, a NamedTuple of numbers with bounds; `MEMORY`, so many
numbers that it remembers; and `reach(p)`, beyond which others do not count.
"""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from typing import Annotated, NamedTuple, TypeAlias

from swarm_ctl.core.kernel.program import NO_ROW, Row, relaxed
from swarm_ctl.core.kernel.receiver import Known, LawTerms, Me
from swarm_ctl.core.model.plan import Between

Memory: TypeAlias = MutableSequence[float]
"""A law's own numbers of one agent, from tick to tick: read and written in place; 0.0 at first."""
Others: TypeAlias = Sequence[Known]

__all__ = [
    "NO_ROW",
    "Annotated",
    "Between",
    "Known",
    "LawTerms",
    "Me",
    "Memory",
    "NamedTuple",
    "Others",
    "Row",
    "relaxed",
]
