"""What the SIM_* parameters of one vehicle do to it: weather, sensor errors, radio, motors.
Deterministic under a seed.

The firmware itself reads those that it feels (battery, arming, GPS off). Errors and gusts are
first-order Gauss-Markov processes, moved on every `TICK_S` of mission time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from swarm_sim.firmware.flying.maneuvers import STILL, Sensed
from swarm_sim.firmware.parameters import SIM_DEFAULTS, Parameters
from swarm_sim.physics.geodesy import Vector3

TICK_S = 0.1
_NOISE_S, _DRIFT_S, _GUST_S, _VELOCITY_S = 1.0, 60.0, 3.0, 4.0
_MOST = 10_000.0
"""Bound on errors, wind and delays."""
_NEUTRAL = {name: item.value for name, item in SIM_DEFAULTS.items()}


@dataclass(frozen=True, slots=True)
class Radio:
    """What happens to frames on the vehicle link."""

    mute_heartbeat: bool
    loss: float
    """Share of frames."""
    delay_s: float


class Wander:
    """Gauss-Markov noise about zero in three axes, with correlation time `tau_s`."""

    def __init__(self, tau_s: float, rng: np.random.Generator) -> None:
        self._keep = math.exp(-TICK_S / tau_s)
        self._fresh = math.sqrt(1.0 - self._keep**2)
        self._rng = rng
        self._unit: Vector3 = STILL

    def move(self, sigma: float) -> Vector3:
        """The next value, with standard deviation `sigma`; at 0 no random number is drawn."""
        if sigma <= 0.0:
            self._unit = STILL
            return STILL
        drawn = self._rng.standard_normal(3).tolist()
        n, e, d = (
            self._keep * old + self._fresh * new for old, new in zip(self._unit, drawn, strict=True)
        )
        self._unit = (n, e, d)
        return (sigma * n, sigma * e, sigma * d)


class VehicleFaults:
    """Weather and faults of one vehicle."""

    def __init__(self, parameters: Parameters, seed: int, sysid: int) -> None:
        self._parameters = parameters
        self._version = -1
        self._noise, self._drift, self._gust = (
            Wander(tau, np.random.default_rng([seed, sysid, i]))
            for i, tau in enumerate((_NOISE_S, _DRIFT_S, _GUST_S))
        )
        self._velocity = Wander(_VELOCITY_S, np.random.default_rng([seed, sysid, 10]))
        self.radio_rng = np.random.default_rng([seed, sysid, 9])
        self._due_s = -math.inf
        self._frozen: Sensed | None = None
        self._error = STILL
        self.fallen = False
        """Broken in a collision."""
        self.active = False
        """A SIM_* parameter is not at its default."""
        self.radio: Radio | None = None
        self.wind: Vector3 = STILL
        self.drift: Vector3 = STILL
        """True minus estimated velocity in flight [m/s]."""
        self.offset: Vector3 = STILL
        """Reported minus true position [m]."""

    def __getitem__(self, name: str) -> float:
        return max(-_MOST, min(_MOST, self._parameters[name]))

    @property
    def motors_dead(self) -> bool:
        """The rotors no longer lift the vehicle."""
        return self.fallen or (self.active and self["SIM_MOTOR_STOP"] == 1.0)

    def look(self) -> bool:
        """Reads changed parameters; whether there is anything to do. After a change there is: what
        a fault has left must go when it ends."""
        changed = self._version != self._parameters.version
        if changed:
            self._version = self._parameters.version
            self.active = any(self[name] != neutral for name, neutral in _NEUTRAL.items())
            loss, delay = min(max(self["SIM_LOSS"] / 100.0, 0.0), 1.0), max(self["SIM_DELAY"], 0.0)
            mute = self["SIM_HB_MUTE"] == 1.0
            self.radio = Radio(mute, loss, delay) if mute or loss or delay else None
            self._due_s = -math.inf
        return changed or self.active or self.fallen

    def move(self, now: float, truth: Sensed) -> bool:
        """Moves weather and errors on when that is due; whether it did."""
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
        n, e, d = self._velocity.move(self["SIM_VEL_NOISE"])
        self.drift = (n, e, 0.6 * d)
        noise = self._noise.move(self["SIM_GPS_NOISE"])
        drift = self._drift.move(self["SIM_GPS_DRIFT"])
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
            position, velocity = self._frozen[:2]
            return truth._replace(position_ned_m=position, velocity_ned_mps=velocity)
        if self.drift != STILL and not truth.landed:
            north, east, down = (
                v - error for v, error in zip(truth.velocity_ned_mps, self.drift, strict=True)
            )
            truth = truth._replace(velocity_ned_mps=(north, east, down))
        if self._error == STILL:
            return truth
        n, e, d = (p + error for p, error in zip(truth.position_ned_m, self._error, strict=True))
        return truth._replace(position_ned_m=(n, e, d))
