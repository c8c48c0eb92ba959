"""`launch.json`: what the processes of a run read beside its manifest, the same for all. `run`
writes it before it starts them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from swarm_ctl.engine.gcs.config import RelayConfig
from swarm_ctl.engine.lockstep.keeper import Rules
from swarm_ctl.engine.script import RunScript
from swarm_ctl.files import replacing

LAUNCH: Final = "launch.json"


@dataclass(frozen=True, slots=True)
class Launch:
    """How the operator wants the run."""

    show: str
    """The station's screen."""
    attach: tuple[str, ...] = ()
    """The extensions of its station, each `NAME[=ARGUMENT]`."""
    tlog: bool = False
    """Agents keep their vehicles' frames."""
    autopilots: tuple[int, ...] = ()
    """The agents whose autopilots the run has started: they have no keys, and end with it."""
    remembered: tuple[int, ...] = ()
    """The agents whose vehicles were there before the run, and will be after it: their own
    parameters are remembered."""
    relay: RelayConfig | None = None
    keeper: Rules | None = None
    script: RunScript | None = None
    """What a scenario does to the processes."""


_JSON: Final = TypeAdapter(Launch)


def write_launch(folder: Path, launch: Launch) -> None:
    """For the user who flies alone: it has the secret of shared links."""
    with replacing(folder / LAUNCH, 0o600) as file:
        file.write(_JSON.dump_json(launch, indent=1))


def read_launch(folder: Path) -> Launch:
    """As `run` wrote it."""
    return _JSON.validate_json((folder / LAUNCH).read_bytes())
