"""A controller for swarms of drones; docs/understand/architecture.md says what is where."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the public names
    from swarm_ctl.api.flight import FlightError as FlightError
    from swarm_ctl.api.flight import FlightResult as FlightResult
    from swarm_ctl.api.fly import fly as fly
    from swarm_ctl.api.swarm import AsyncSwarm as AsyncSwarm
    from swarm_ctl.api.swarm import OrderError as OrderError
    from swarm_ctl.api.swarm import Swarm as Swarm

    __version__: str
else:
    __all__ = ["AsyncSwarm", "FlightError", "FlightResult", "OrderError", "Swarm", "fly"]

    def __dir__() -> list[str]:
        """The public names, for completion; none of them is imported by it."""
        return sorted({*globals(), *__all__, "__version__"})

    def __getattr__(name: str) -> object:
        """The public names, when they are asked for: an agent's import takes less."""
        if name in __all__:
            from swarm_ctl.installed import require

            require("ground", f"swarm_ctl.{name}")
            from swarm_ctl.api import fly

            return getattr(fly, name)
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from swarm_ctl.installed import version

        return version()
