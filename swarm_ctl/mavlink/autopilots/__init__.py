"""Firmware families, one module each: which modes, commands and parameters fly a goal."""

from __future__ import annotations

from collections.abc import Mapping

from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.addressed import ToldMode
from swarm_ctl.mavlink.autopilots.ardupilot import Ardupilot
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.failsafe_words import NAMES
from swarm_ctl.mavlink.autopilots.px4 import Px4
from swarm_ctl.mavlink.autopilots.timing import STREAMS_HZ

GUARDED = frozenset(name for names in NAMES.values() for name in names)
"""The parameters of all firmware that decide what a vehicle does in trouble: while an agent flies
it, no other may set them."""
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


def flown_by_agent(told: ToldMode) -> bool:
    """The vehicle is armed, in the mode in which agents fly it."""
    return told.armed and any(
        kind.wire_id == told.autopilot and kind.modes.name(told.custom_mode) == kind.controlled_mode
        for kind in AUTOPILOTS.values()
    )


__all__ = ["AUTOPILOTS", "GUARDED", "Autopilot", "autopilot", "flown_by_agent"]
