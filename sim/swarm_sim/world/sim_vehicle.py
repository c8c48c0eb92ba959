"""One simulated vehicle: its firmware, its faults, and its row in a group of vehicles. Pure."""

from __future__ import annotations

from swarm_sim.firmware.firmware import Firmware
from swarm_sim.firmware.flying.maneuvers import Demand, Sensed
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol.commands import REBOOT_S
from swarm_sim.world.faults import VehicleFaults
from swarm_sim.world.vehicle_group import VehicleGroup


class SimVehicle:
    """Gives the firmware what the vehicle senses, and the group what the firmware demands."""

    def __init__(
        self, firmware: Firmware, faults: VehicleFaults, group: VehicleGroup, row: int
    ) -> None:
        self.sysid = firmware.sysid
        self.firmware = firmware
        self.faults = faults
        self.due_s = 0.0
        """When `run` has something to do next."""
        self._group = group
        self._row = row
        self._obeyed: Demand | None = None

    def sense(self) -> Sensed:
        """What it senses now: the truth, unless its sensors have a fault."""
        truth = self.truth()
        return self.faults.sense(truth) if self.faults.active else truth

    def truth(self) -> Sensed:
        """How it really moves."""
        return self._group.sense(self._row)

    def move_faults(self, now: float) -> None:
        """Moves weather and errors on, where there are any."""
        faults = self.faults
        if not faults.look() or not faults.move(now, self.truth()):
            return
        self._group.state.wind[self._row] = faults.wind
        self._group.state.drift[self._row] = faults.drift
        if faults["SIM_REBOOT"] == 1.0:
            self.firmware.parameters.set("SIM_REBOOT", 0.0)
            self.firmware.start(self.sense(), now + REBOOT_S)
        self._take(self.firmware.demand, None)

    def fell(self) -> bool:
        """Whether a touch-down now is a crash."""
        return self.faults.motors_dead or not self.firmware.armed

    def run(self, now: float) -> None:
        """Lets the firmware do what is due."""
        self.firmware.run(now, self.sense())
        self._obey()

    def handle(self, message: Message, now: float, channel: int) -> None:
        """Gives the firmware a message; its new demand acts at the next step."""
        self.firmware.handle(message, now, self.sense(), channel)
        self._obey()

    def pilot(self, kind: str, now: float) -> None:
        """A pilot's switch: the firmware may refuse it, as it may any mode."""
        self.firmware.switch(kind, now, self.sense())
        self._obey()

    def _obey(self) -> None:
        self.due_s = self.firmware.due_s
        demand = self.firmware.demand
        if demand is not self._obeyed:
            self._take(demand, self._obeyed)

    def _take(self, demand: Demand, before: Demand | None) -> None:
        self._obeyed = demand
        if self.faults.motors_dead:
            demand, before = demand._replace(lift=False), None
        self._group.obey(self._row, demand, before, self.faults.offset)
