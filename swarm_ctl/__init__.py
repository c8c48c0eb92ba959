"""A controller for swarms of drones; docs/pages/architecture.md says what is where."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarm_ctl.api.fly import fly as fly  # the public name

    __version__: str
else:

    def __getattr__(name: str) -> object:
        """`fly` and `__version__`, when they are asked for: an agent's import takes less."""
        if name == "fly":
            from swarm_ctl.cli.shared.extras import require

            require("ground", "swarm_ctl.fly")
            from swarm_ctl.api.fly import fly

            return fly
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import metadata

        try:
            return metadata.version("swarm-ctl")
        except metadata.PackageNotFoundError:
            return "0+unknown"  # a source tree that is not installed
