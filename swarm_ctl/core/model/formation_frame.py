"""The frame that all agents of a formation share."""

from __future__ import annotations

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.rows import row


@row
class Frame:
    """Where the formation as a whole is to be: its centre [m], and how the slots of the last form
    step are turned and scaled."""

    point_m: Point
    angle_rad: float = 0.0
    scale: float = 1.0
    leg: int = 0
    """Waypoints passed."""
    rate: float = 0.0
    """Speed now, as a share of the step's."""
