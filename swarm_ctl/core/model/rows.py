"""Dataclasses of which an agent builds many in each tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def row(cls: type[T]) -> type[T]:
    """A dataclass with slots that never changes. The type checker holds it frozen; at run time
    nothing does: a frozen one takes ten times as long to build."""
    return dataclass(slots=True, unsafe_hash=True)(cls)
