"""A controller for swarms of drones; docs/pages/architecture.md says what is where."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> str:
        """`__version__`, read when asked for: the reading takes longer than an agent's import."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import metadata

        try:
            return metadata.version("swarm-ctl")
        except metadata.PackageNotFoundError:
            return "0+unknown"  # a source tree that is not installed
