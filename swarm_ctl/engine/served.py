"""What a station serves to others' tools."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class ServedPorts:
    """Of 127.0.0.1, by the name of their option; None: it does not serve that."""

    metrics: int | None = None
    foxglove: int | None = None


NO_PORTS: Final = ServedPorts()
