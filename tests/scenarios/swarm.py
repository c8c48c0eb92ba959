"""The project's own scenarios fly the same virtual swarm that comes with the package for
everybody's tests."""

from __future__ import annotations

from swarm_ctl.testing.virtual_swarm import Member, VirtualSwarm

__all__ = ["Member", "VirtualSwarm"]
