"""`truth.jsonl`: where the vehicles really were, as the simulator wrote it. Agents never see it.

One JSON object a line, written at once; a simulator that was killed leaves a torn last line, which
is no error here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Vector3
from swarm_ctl.report.folder.files import Damage, read_lines

TRUTH: Final = "truth.jsonl"

Floats: TypeAlias = npt.NDArray[np.float64]
Bools: TypeAlias = npt.NDArray[np.bool_]


class _Line(BaseModel):
    model_config = ConfigDict(frozen=True)

    time_s: float = Field(alias="t")
    """Mission time."""


class Header(_Line):
    """The first line: the frame and the order of the vehicles in every state line."""

    type: Literal["header"]
    version: Literal[1]
    origin: Geodetic
    sysids: tuple[int, ...]


class State(_Line):
    """All vehicles at one moment, in the header's order; NED [m, m/s] relative to the header's
    origin."""

    type: Literal["state"]
    position_ned_m: tuple[Vector3, ...] = Field(alias="ned")
    velocity_ned_mps: tuple[Vector3, ...] = Field(alias="vel")
    armed: tuple[bool, ...]
    airborne: tuple[bool, ...]


class Minimum(_Line):
    """Pairs (sysid, sysid, metres) whose smallest horizontal distance has shrunk since the last
    such line."""

    type: Literal["min"]
    pairs: tuple[tuple[int, int, float], ...]


class TruthEvent(_Line):
    """`liftoff`, `touchdown`, `collision`, ... of one vehicle."""

    type: Literal["event"]
    sysid: int
    event: str


class End(_Line):
    """The simulator finished the file."""

    type: Literal["end"]


Line: TypeAlias = Annotated[
    Header | State | Minimum | TruthEvent | End, Field(discriminator="type")
]

_LINE: Final[TypeAdapter[Line]] = TypeAdapter(Line)


def read_truth(path: Path, damage: Damage) -> Iterator[Header | State | Minimum | TruthEvent | End]:
    """The records of a truth file in order, streaming; what is no record is counted in `damage`.
    OSError passes."""
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
    airborne: Bools
    """(T, n)."""
    minima: dict[tuple[int, int], float]
    """Smallest horizontal distance [m] of each pair of sysids (lower first), first lift-off to last
    touchdown."""
    events: tuple[TruthEvent, ...]
    last_s: float | None
    """Mission time of the last line."""
    complete: bool
    """The simulator wrote the end line."""
    damage: Damage


@dataclass(slots=True)
class _Folding:
    sysids: tuple[int, ...] = ()
    times: list[float] = field(default_factory=list)
    positions: list[npt.NDArray[np.float64]] = field(default_factory=list)
    airborne: list[npt.NDArray[np.bool_]] = field(default_factory=list)
    minima: dict[tuple[int, int], float] = field(default_factory=dict)
    events: list[TruthEvent] = field(default_factory=list)
    last_s: float | None = None
    complete: bool = False

    def fold(self, line: Header | State | Minimum | TruthEvent | End) -> bool:
        """Take one record in; False where it does not fit to the header."""
        match line:
            case Header():
                self.sysids = line.sysids
            case State():
                if not len(line.position_ned_m) == len(line.airborne) == len(self.sysids):
                    return False
                self.times.append(line.time_s)
                self.positions.append(np.array(line.position_ned_m).reshape(-1, 3))
                self.airborne.append(np.array(line.airborne, dtype=np.bool_))
            case Minimum():
                for a, b, distance in line.pairs:
                    pair = (min(a, b), max(a, b))
                    self.minima[pair] = min(distance, self.minima.get(pair, np.inf))
            case TruthEvent():
                self.events.append(line)
            case End():
                self.complete = True
        self.last_s = line.time_s
        return True


def load_truth(path: Path) -> Truth:
    """Read a truth file as far as it goes. OSError where it can't be opened."""
    damage, folding = Damage(), _Folding()
    for line in read_truth(path, damage):
        damage.bad_lines += not folding.fold(line)
    n = len(folding.sysids)
    return Truth(
        sysids=folding.sysids,
        time_s=np.array(folding.times),
        position_ned_m=np.stack(folding.positions) if folding.positions else np.zeros((0, n, 3)),
        airborne=np.stack(folding.airborne)
        if folding.airborne
        else np.zeros((0, n), dtype=np.bool_),
        minima=folding.minima,
        events=tuple(folding.events),
        last_s=folding.last_s,
        complete=folding.complete,
        damage=damage,
    )
