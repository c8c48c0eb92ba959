"""The scenarios fly the same virtual swarm that the package brings for its users' tests."""

from __future__ import annotations

from swarm_ctl.testing.virtual_swarm import Member, VirtualSwarm

__all__ = ["Member", "VirtualSwarm"]
