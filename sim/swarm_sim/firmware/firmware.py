"""What an autopilot does as time passes and messages come. Pure.

Both calls bring what the sensors say at that time.
"""

from __future__ import annotations

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.flying.maneuvers import Sensed
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol import uploaded_mission
from swarm_sim.firmware.protocol.handlers import HANDLERS, sane
from swarm_sim.firmware.protocol.telemetry import readings
from swarm_sim.firmware.streams import next_on_grid

TICK_S = 0.1
"""Failsafes, mode logic and landing detection run this often."""
_PARAMETERS_PER_TICK = 25
_BATTERY_S = 0.5
"""The battery is looked at this often."""


class Firmware(SimAutopilot):
    """An autopilot that runs."""

    @property
    def due_s(self) -> float:
        """When `run` has something to do next."""
        return min([self.tick_s, *[streams.next_s for streams in self.channel_streams]])

    def run(self, now: float, sensed: Sensed) -> None:
        """Does what is due at `now`."""
        if now < self.boot_s:
            return
        self.now, self.sensed, self.asked_on = now, sensed, None
        if now + 1e-6 >= self.tick_s:  # a sum of steps, and a multiple
            self.tick_s = next_on_grid(now, TICK_S)
            self._tick()
        for channel, streams in enumerate(self.channel_streams):
            for name in streams.take_due(now):
                for fields in readings(self, name):
                    self.say(name, fields, channel=channel)

    def handle(self, message: Message, now: float, sensed: Sensed, channel: int = 0) -> None:
        """Acts on a received message; one that is not for this vehicle or makes no sense is
        counted in `ignored`."""
        handler = HANDLERS.get(message.name)
        ours = now >= self.boot_s and message.fields.get("target_system", 0) in (0, self.sysid)
        if handler is None or not ours or not sane(message):
            self.ignored += 1
            return
        self.now, self.sensed, self.asked_on = now, sensed, channel
        handler(self, message)

    def switch(self, kind: str, now: float, sensed: Sensed) -> None:
        """A pilot's switch (`pilot_modes`): the mode is entered or refused, as one that SET_MODE
        asks for."""
        if now >= self.boot_s:
            self.now, self.sensed, self.asked_on = now, sensed, None
            self.enter(self.pilot_modes[kind])

    def _tick(self) -> None:
        if not self.sensed.landed:
            self.landed_s = None
        elif self.landed_s is None:
            self.landed_s = self.now
        if self.now >= self.battery_s:
            self.battery_s = self.now + _BATTERY_S - TICK_S / 2
            self._watch_battery()
        if not self.told_ready and self.ready():
            self.told_ready = True
            for name in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION"):
                for fields in readings(self, name):
                    self.say(name, fields)
        self.keep_transfer_going()
        if self.armed:
            self.housekeeping()
        self.update_demand()
        uploaded_mission.keep_up(self)
        for _ in range(min(_PARAMETERS_PER_TICK, len(self.pending_parameters))):
            channel, name = self.pending_parameters.popleft()
            self.say("PARAM_VALUE", self.parameters.value_message(name), channel=channel)

    def _watch_battery(self) -> None:
        p = self.parameters
        self.battery.failed = p["SIM_BATT_FAIL"] == 1.0
        factor = max(0.0, p["SIM_BATT_DRAIN"])
        self.battery.drain(_BATTERY_S, flying=not self.sensed.landed, factor=factor)
        low = self.battery_low()
        if low and not self.low_battery:
            self.on_battery_low()
        self.low_battery = low
