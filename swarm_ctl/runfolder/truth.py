"""`truth.jsonl`: where the vehicles really were, by the simulator. Agents never see it.

One JSON object a line; a killed simulator leaves a torn last line, which is no error here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Vector3
from swarm_ctl.runfolder.files import Damage, read_lines

TRUTH: Final = "truth.jsonl"

Floats: TypeAlias = npt.NDArray[np.float64]
Bools: TypeAlias = npt.NDArray[np.bool_]


class _TruthLine(BaseModel):
    model_config = ConfigDict(frozen=True)

    time_s: float = Field(alias="t")
    """Mission time."""


class TruthHeader(_TruthLine):
    """The first line: the frame and the order of the vehicles in every state line."""

    type: Literal["header"]
    version: Literal[1]
    origin: Geodetic
    sysids: tuple[int, ...]
    epoch_s: float | None = None
    """Zero of its clock on the computer's monotonic clock; None in lockstep."""
    speedup: float = 1.0


class TruthState(_TruthLine):
    """All vehicles at one moment, in the header's order; NED [m, m/s] relative to the header's
    origin."""

    type: Literal["state"]
    position_ned_m: tuple[Vector3, ...] = Field(alias="ned")
    velocity_ned_mps: tuple[Vector3, ...] = Field(alias="vel")
    armed: tuple[bool, ...]
    airborne: tuple[bool, ...]

    def is_of(self, n: int) -> bool:
        """Whether it has as many vehicles."""
        columns = (self.position_ned_m, self.velocity_ned_mps, self.armed, self.airborne)
        return all(len(column) == n for column in columns)


class TruthMinima(_TruthLine):
    """Pairs (sysid, sysid, metres) with a smaller horizontal distance than in any line before."""

    type: Literal["min"]
    pairs: tuple[tuple[int, int, float], ...]


class EventKind(StrEnum):
    """The events of a truth file that count for the verdict."""

    LIFTOFF = "liftoff"
    TOUCHDOWN = "touchdown"
    CRASH = "crash"
    DISARM = "disarm"
    """In the air."""
    COLLISION = "collision"


class TruthEvent(_TruthLine):
    """What happened to one vehicle: an `EventKind`, or a fault of the timetable."""

    type: Literal["event"]
    sysid: int
    event: str
    impact_mps: float | None = None
    """Speed at a touch-down or crash."""
    height_m: float | None = None
    """Above the ground, of a disarming in the air."""
    other: int | None = None
    """The other vehicle of a collision."""


class TruthEnd(_TruthLine):
    """The simulator finished the file."""

    type: Literal["end"]


TruthLine: TypeAlias = Annotated[
    TruthHeader | TruthState | TruthMinima | TruthEvent | TruthEnd, Field(discriminator="type")
]

_LINE: Final[TypeAdapter[TruthLine]] = TypeAdapter(TruthLine)


def read_truth(path: Path, damage: Damage) -> Iterator[TruthLine]:
    """The records of a truth file one by one; `damage` counts other lines. OSError passes."""
    for line in read_lines(path, damage):
        try:
            yield _LINE.validate_json(line)
        except ValidationError:
            damage.bad_lines += 1


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """A whole truth file: T state lines of n vehicles, in the order of `sysids`."""

    sysids: tuple[int, ...]
    time_s: Floats
    """(T,) mission time."""
    position_ned_m: Floats
    """(T, n, 3) relative to the mission's origin."""
    descent_mps: Floats
    """(T, n)"""
    armed: Bools
    """(T, n)"""
    airborne: Bools
    """(T, n)."""
    minima: dict[tuple[int, int], float]
    """Smallest horizontal distance [m] of each pair of sysids (lower first) during the flight."""
    minima_s: dict[tuple[int, int], float]
    """When that was, mission time: at most a line of states before."""
    events: tuple[TruthEvent, ...]
    last_s: float | None
    """Mission time of the last line."""
    complete: bool
    """The simulator wrote the end line."""
    damage: Damage


def load_truth(path: Path) -> Truth:
    """Read a truth file as far as it goes. OSError where it can't be opened."""
    damage = Damage()
    return truth_of(read_truth(path, damage), damage)


def truth_line(fields: dict[str, Any]) -> TruthLine:
    """A record of its fields, as the simulator writes them; ValidationError where it is none."""
    return _LINE.validate_python(fields)


def truth_of(lines: Iterable[TruthLine], damage: Damage) -> Truth:
    """All records of a flight as one; `damage` counts those of other vehicles."""
    sysids, last_s, complete = tuple[int, ...](), None, False
    states: list[TruthState] = []
    minima: dict[tuple[int, int], float] = {}
    minima_s: dict[tuple[int, int], float] = {}
    events: list[TruthEvent] = []
    for line in lines:
        match line:
            case TruthHeader():
                sysids = line.sysids
            case TruthState():
                if not line.is_of(len(sysids)):
                    damage.bad_lines += 1
                    continue
                states.append(line)
            case TruthMinima():
                for a, b, distance in line.pairs:
                    pair = (min(a, b), max(a, b))
                    if distance < minima.get(pair, np.inf):
                        minima[pair], minima_s[pair] = distance, line.time_s
            case TruthEvent():
                events.append(line)
            case TruthEnd():
                complete = True
        last_s = line.time_s
    shape = (len(states), len(sysids))
    return Truth(
        sysids=sysids,
        time_s=np.array([s.time_s for s in states]),
        position_ned_m=np.array([s.position_ned_m for s in states]).reshape(*shape, 3),
        descent_mps=np.array([s.velocity_ned_mps for s in states]).reshape(*shape, 3)[..., 2],
        armed=np.array([s.armed for s in states], dtype=np.bool_).reshape(shape),
        airborne=np.array([s.airborne for s in states], dtype=np.bool_).reshape(shape),
        minima=minima,
        minima_s=minima_s,
        events=tuple(events),
        last_s=last_s,
        complete=complete,
        damage=damage,
    )
