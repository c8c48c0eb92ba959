"""What the SIM_* parameters of one vehicle do to it: weather, sensor errors, radio, motors.
Deterministic under a seed.

The parameters are `sim.firmware.fault_parameters.SIM_DEFAULTS`; those the firmware itself feels
(battery, arming, GPS off) it reads there. Errors and gusts are first-order Gauss-Markov processes,
moved on every `TICK_S` of mission time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.firmware.fault_parameters import SIM_DEFAULTS
from sim.firmware.flying.maneuvers import Sensed
from sim.firmware.protocol.parameters import Parameters
from sim.physics.geodesy import Vector3
from sim.world.vehicle_group import STILL

TICK_S = 0.1
_NOISE_S, _DRIFT_S, _GUST_S = 1.0, 60.0, 3.0
_MOST = 10_000.0
"""No error, wind or delay is larger, whatever a parameter says."""
_NEUTRAL = {name: item.value for name, item in SIM_DEFAULTS.items()}


@dataclass(frozen=True, slots=True)
class Radio:
    """What happens to frames on their way."""

    mute_heartbeat: bool
    loss: float
    """Share of frames."""
    delay_s: float


class Wander:
    """A value in three axes that wanders about zero: standard deviation `sigma`, forgotten over
    `tau_s`."""

    def __init__(self, tau_s: float, rng: np.random.Generator) -> None:
        self._keep = math.exp(-TICK_S / tau_s)
        self._fresh = math.sqrt(1.0 - self._keep**2)
        self._rng = rng
        self._unit: Vector3 = STILL

    def move(self, sigma: float) -> Vector3:
        """The next value; nothing is drawn while it is off."""
        if sigma <= 0.0:
            self._unit = STILL
            return STILL
        news = self._rng.standard_normal(3).tolist()
        n, e, d = (
            self._keep * old + self._fresh * new for old, new in zip(self._unit, news, strict=True)
        )
        self._unit = (n, e, d)
        return (sigma * n, sigma * e, sigma * d)


class Faults:
    """The troubles of one vehicle."""

    def __init__(self, parameters: Parameters, seed: int, sysid: int) -> None:
        self._parameters = parameters
        self._version = -1
        self._noise, self._drift, self._gust = (
            Wander(tau, np.random.default_rng([seed, sysid, i]))
            for i, tau in enumerate((_NOISE_S, _DRIFT_S, _GUST_S))
        )
        self.radio_rng = np.random.default_rng([seed, sysid, 9])
        self._due_s = -math.inf
        self._frozen: Sensed | None = None
        self._error = STILL
        self.fallen = False
        """Broken in a collision."""
        self.active = False
        """Anything is not as it should be."""
        self.radio: Radio | None = None
        self.wind: Vector3 = STILL
        self.offset: Vector3 = STILL
        """Reported minus true position [m]."""

    def __getitem__(self, name: str) -> float:
        return max(-_MOST, min(_MOST, self._parameters[name]))

    @property
    def motors_dead(self) -> bool:
        """Nothing lifts the vehicle any more."""
        return self.fallen or (self.active and self["SIM_MOTOR_STOP"] == 1.0)

    def look(self) -> bool:
        """Takes notice of changed parameters; whether there is anything to do."""
        if self._version != self._parameters.version:
            self._version = self._parameters.version
            self.active = any(self[name] != neutral for name, neutral in _NEUTRAL.items())
            loss, delay = min(max(self["SIM_LOSS"] / 100.0, 0.0), 1.0), max(self["SIM_DELAY"], 0.0)
            mute = self["SIM_HB_MUTE"] == 1.0
            self.radio = Radio(mute, loss, delay) if mute or loss or delay else None
            self._due_s = -math.inf
        return self.active or self.fallen or self.offset != STILL or self.wind != STILL

    def move(self, now: float, truth: Sensed) -> bool:
        """Weather and errors go on when it is time; whether they did."""
        if now < self._due_s:
            return False
        self._due_s = now + TICK_S - 1e-6
        speed, from_rad = self["SIM_WIND_SPD"], math.radians(self["SIM_WIND_DIR"])
        gust = self._gust.move(self["SIM_WIND_GUST"])
        self.wind = (
            gust[0] - speed * math.cos(from_rad),
            gust[1] - speed * math.sin(from_rad),
            0.3 * gust[2],
        )
        noise, drift = (
            self._noise.move(self["SIM_GPS_NOISE"]),
            self._drift.move(self["SIM_GPS_DRIFT"]),
        )
        jump = (self["SIM_GPS_JUMP_N"], self["SIM_GPS_JUMP_E"], self["SIM_GPS_JUMP_D"])
        n, e, d = (sum(parts) for parts in zip(noise, drift, jump, strict=True))
        self._error = (n, e, d)
        if self["SIM_GPS_FREEZE"] != 1.0:
            self._frozen = None
        elif self._frozen is None:
            self._frozen = self.sense(truth)
        reported, true = self.sense(truth).position_ned_m, truth.position_ned_m
        self.offset = (reported[0] - true[0], reported[1] - true[1], reported[2] - true[2])
        return True

    def sense(self, truth: Sensed) -> Sensed:
        """What the vehicle believes of itself."""
        if self._frozen is not None:
            there = self._frozen
            return truth._replace(
                position_ned_m=there.position_ned_m, velocity_ned_mps=there.velocity_ned_mps
            )
        if self._error == STILL:
            return truth
        n, e, d = truth.position_ned_m
        return truth._replace(
            position_ned_m=(n + self._error[0], e + self._error[1], d + self._error[2])
        )
