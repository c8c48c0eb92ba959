"""Firmware families, one module each: which modes, commands and parameters fly a goal."""

from __future__ import annotations

from collections.abc import Mapping

from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.autopilots.ardupilot import Ardupilot
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.px4 import Px4
from swarm_ctl.mavlink.autopilots.timing import STREAMS_HZ

AUTOPILOTS: dict[str, type[Autopilot]] = {kind.name: kind for kind in (Ardupilot, Px4)}


def autopilot(
    name: str,
    system: int,
    agent_sysid: int = AGENT_SYSID,
    streams_hz: Mapping[str, float] = STREAMS_HZ,
) -> Autopilot:
    """The driver of the firmware `name` for the vehicle `system`; LinkError for another name."""
    if name not in AUTOPILOTS:
        raise LinkError(f"autopilot {name!r} does not exist; allowed: {', '.join(AUTOPILOTS)}")
    return AUTOPILOTS[name](system, agent_sysid, streams_hz)


__all__ = ["AUTOPILOTS", "Autopilot", "autopilot"]
