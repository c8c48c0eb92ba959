"""Vehicles over MAVLink 2: `VehicleLink` translates between the wire and `core.model.vehicle`."""

from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import MemoryWire, Wire, memory_wires

__all__ = ["MemoryWire", "VehicleLink", "Wire", "memory_wires"]
