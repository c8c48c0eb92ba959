"""`truth.jsonl`: where the vehicles really were, by the simulator. Agents never see it.

One JSON object a line; a killed simulator leaves a torn last line, which is no error here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
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


class TruthState(_TruthLine):
    """All vehicles at one moment, in the header's order; NED [m, m/s] relative to the header's
    origin."""

    type: Literal["state"]
    position_ned_m: tuple[Vector3, ...] = Field(alias="ned")
    velocity_ned_mps: tuple[Vector3, ...] = Field(alias="vel")
    armed: tuple[bool, ...]
    airborne: tuple[bool, ...]


class TruthMinima(_TruthLine):
    """Pairs (sysid, sysid, metres) with a smaller horizontal distance than in any line before."""

    type: Literal["min"]
    pairs: tuple[tuple[int, int, float], ...]


class TruthEvent(_TruthLine):
    """`liftoff`, `touchdown`, `collision`, ... of one vehicle."""

    type: Literal["event"]
    sysid: int
    event: str


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
    airborne: Bools
    """(T, n)."""
    minima: dict[tuple[int, int], float]
    """Smallest horizontal distance [m] of each pair of sysids (lower first) during the flight."""
    events: tuple[TruthEvent, ...]
    last_s: float | None
    """Mission time of the last line."""
    complete: bool
    """The simulator wrote the end line."""
    damage: Damage


def load_truth(path: Path) -> Truth:
    """Read a truth file as far as it goes. OSError where it can't be opened."""
    damage, sysids, last_s, complete = Damage(), tuple[int, ...](), None, False
    states: list[tuple[float, Floats, Bools]] = []
    minima: dict[tuple[int, int], float] = {}
    events: list[TruthEvent] = []
    for line in read_truth(path, damage):
        match line:
            case TruthHeader():
                sysids = line.sysids
            case TruthState():
                if not len(line.position_ned_m) == len(line.airborne) == len(sysids):
                    damage.bad_lines += 1
                    continue
                places = np.array(line.position_ned_m).reshape(-1, 3)
                states.append((line.time_s, places, np.array(line.airborne, dtype=np.bool_)))
            case TruthMinima():
                for a, b, distance in line.pairs:
                    pair = (min(a, b), max(a, b))
                    minima[pair] = min(distance, minima.get(pair, np.inf))
            case TruthEvent():
                events.append(line)
            case TruthEnd():
                complete = True
        last_s = line.time_s
    shape = (len(states), len(sysids))
    return Truth(
        sysids=sysids,
        time_s=np.array([time_s for time_s, _, _ in states]),
        position_ned_m=np.array([places for _, places, _ in states]).reshape(*shape, 3),
        airborne=np.array([flying for _, _, flying in states], dtype=np.bool_).reshape(shape),
        minima=minima,
        events=tuple(events),
        last_s=last_s,
        complete=complete,
        damage=damage,
    )
