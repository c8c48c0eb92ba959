"""The simulator's configuration: strict JSON; errors name the field and what is allowed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from swarm_sim.firmware.parameters import SIM_DEFAULTS
from swarm_sim.physics.geodesy import GeodeticPoint

Persona = Literal["ardupilot", "px4"]
PilotMode = Literal["hold", "land", "return", "manual"]
"""What a pilot may switch to; each firmware has a mode of its own for it."""


class ConfigError(Exception):
    """The configuration was refused; the text names the file, the field and what is allowed."""


class _StrictConfig(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class GeodeticPlace(_StrictConfig):
    """A point on the ellipsoid."""

    lat_deg: float = Field(ge=-89.0, le=89.0)
    lon_deg: float = Field(ge=-180.0, le=180.0)
    alt_m: float = Field(ge=-500.0, le=9000.0)

    def geodetic(self) -> GeodeticPoint:
        return GeodeticPoint(self.lat_deg, self.lon_deg, self.alt_m)


def _known(name: str) -> str:
    if name not in SIM_DEFAULTS:
        raise ValueError(f"no such parameter; there are {', '.join(SIM_DEFAULTS)}")
    return name


SimParameter = Annotated[str, AfterValidator(_known)]


class TimetableEntry(_StrictConfig):
    """SIM_* parameters to set at a given time, or a pilot's mode: of one vehicle, or of all."""

    at_s: float
    """Seconds after what `faults_since` says."""
    sysid: int | None = None
    set: dict[SimParameter, float] = {}
    pilot: PilotMode | None = None

    @model_validator(mode="after")
    def _does_something(self) -> Self:
        if not self.set and self.pilot is None:
            raise ValueError("neither set nor pilot; allowed: one of them, or both")
        return self


_ADDRESS = r"(udpin|udpout|tcpin):[0-9A-Za-z.\-]+:[0-9]{1,5}"
Endpoint = Annotated[str, Field(pattern=f"^{_ADDRESS}$")]
FurtherEndpoint = Annotated[str, Field(pattern=f"^{_ADDRESS}(:[0-9]{{1,5}})?$")]


class LagConfig(_StrictConfig):
    """A dead time, then a first-order lag with bounded acceleration."""

    dead_time_s: float = Field(ge=0.0, le=5.0)
    lag_s: float = Field(gt=0.0, le=10.0)
    acceleration_mps2: float = Field(gt=0.0, le=50.0)


class VehicleConfig(GeodeticPlace):
    """One vehicle: identity, where it listens, where it stands."""

    sysid: int = Field(ge=1, le=250)
    persona: Persona = "ardupilot"
    endpoint: Endpoint
    """`udpin:`, `tcpin:` listen there; `udpout:` speaks to there from the start."""
    also: tuple[FurtherEndpoint, ...] = ()
    """Further endpoints, each with streams of its own; one whose port is taken is left out. A
    second port behind `udpout:` is the own one."""
    heading_deg: float = 0.0
    ready_after_s: float = Field(default=3.0, ge=0.0)
    """Mission seconds from start until position estimate and pre-arm checks are good."""

    response: Literal["persona", "ideal"] | LagConfig = "persona"
    """How velocities are followed: as by the persona's firmware and airframe, at once, or with this
    lag."""
    sim_parameters: dict[SimParameter, float] = {}
    """SIM_* parameters of this vehicle at start, over those for all."""
    signing_key_path: Path | None = None
    """The file with its MAVLink 2 signing key; without it, it serves unsigned frames until
    SETUP_SIGNING."""

    @property
    def motion(self) -> str | LagConfig:
        """Its velocity response; vehicles with the same one move in one group."""
        return self.persona if self.response == "persona" else self.response


class SimConfig(_StrictConfig):
    """Everything the simulator is told; see the README for the units (in the names)."""

    version: Literal[1]
    speedup: float = Field(default=1.0, gt=0.0, le=1000.0)
    epoch_s: float
    """`time.monotonic()` at mission time 0, shared by all processes of this host."""
    lockstep: str | None = None
    """Where the keeper of mission time listens, in Linux's abstract name space; `speedup` and
    `epoch_s` count only when it is gone."""
    seed: int = 0
    origin: GeodeticPlace
    truth_path: Path | None = None
    truth_rate_hz: float = Field(default=10.0, gt=0.0, le=100.0)
    once: bool = False
    """End when a vehicle has flown, and all have stood disarmed for 10 s."""
    sensing_range_m: float = Field(default=50.0, ge=0.0)
    vehicles: tuple[VehicleConfig, ...] = Field(min_length=1)
    sim_parameters: dict[SimParameter, float] = {}
    """SIM_* parameters of all vehicles at start: weather, sensor errors, what is broken."""
    faults: tuple[TimetableEntry, ...] = ()
    """What changes when."""
    faults_since: Literal["start", "liftoff"] = "start"
    """What their times count from: mission time 0, or the first lift-off of any vehicle."""

    @model_validator(mode="after")
    def _unique(self) -> SimConfig:
        for name in ("sysid", "endpoint"):
            seen: dict[object, int] = {}
            for i, vehicle in enumerate(self.vehicles):
                value = getattr(vehicle, name)
                first = seen.setdefault(value, i)
                # several vehicles may speak to one ground station
                if first != i and not str(value).startswith("udpout:"):
                    both = f"vehicles[{first}] and vehicles[{i}]"
                    raise ValueError(f"{both} share {name} {value}; each needs its own")
        known = {vehicle.sysid for vehicle in self.vehicles}
        for i, fault in enumerate(self.faults):
            if fault.sysid is not None and fault.sysid not in known:
                raise ValueError(
                    f"faults[{i}] names sysid {fault.sysid}; there are {sorted(known)}"
                )
        return self


def load_config(path: Path) -> SimConfig:
    """The configuration in `path`; ConfigError says what is wrong with it."""
    try:
        return SimConfig.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise ConfigError(f"{path}: can't be read: {error.strerror}") from error
    except json.JSONDecodeError as error:
        raise ConfigError(f"{path}:{error.lineno}: not JSON: {error.msg}") from error
    except ValidationError as error:
        raise ConfigError("; ".join(f"{path}: {_describe(e)}" for e in error.errors())) from error


def _describe(error: ErrorDetails) -> str:
    field = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in error["loc"]).lstrip(".")
    allowed = "remove it" if error["type"] == "extra_forbidden" else error["msg"]
    got = "" if error["type"] in ("missing", "value_error") else f" (got {error['input']!r})"
    return f"{field + ': ' if field else ''}{allowed}{got}"
