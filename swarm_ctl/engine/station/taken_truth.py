"""The truth of a simulator beside the agents: a copy on the run's clock, in the run's folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing
from swarm_ctl.runfolder.files import Damage, read_lines
from swarm_ctl.runfolder.manifest import Manifest, write_manifest
from swarm_ctl.runfolder.truth import TRUTH, TruthHeader

_FRESH_WALL_S: Final = 2.0
"""A simulator that goes on has written a line by then, also on a busy machine: its truth ends as
well as with its own last line. An older one ended with the simulator."""


def take_truth(source: Path, folder: Path, manifest: Manifest, now_s: float) -> None:
    """Copy what `sim --truth` has written on this computer into the run's folder; from then on the
    run is judged by it. `now_s`: mission time by the run's clock.

    Raises:
        InputError: it is not the truth of this flight; the words say why.
        OSError: it can't be read or written.
    """
    lines = _objects(source)
    header = _header(source, next(lines, None))
    if header.speedup != manifest.speedup:
        raise InputError(f"{source} has speed-up {header.speedup:g}, this run {manifest.speedup:g}")
    if header.epoch_s is None:
        raise InputError(f"{source} does not say when its clock began")
    later_s = (header.epoch_s - manifest.epoch_s) * manifest.speedup
    last: dict[str, Any] = header.model_dump(by_alias=True)
    with replacing(folder / TRUTH) as file:
        file.write(_line(last, later_s))
        for last in lines:
            file.write(_line(last, later_s))
        last_s = last["t"] + later_s
        if last_s < 0.0:
            raise InputError(f"{source} ends {-last_s:.0f} s before this flight")
        if last["type"] != "end" and last_s > now_s - _FRESH_WALL_S * manifest.speedup:
            file.write(_line({"type": "end", "t": last["t"]}, later_s))
    there = set(header.sysids)
    simulated = tuple(agent.id for agent in manifest.fleet if agent.sysid in there)
    write_manifest(folder, manifest.model_copy(update={"simulated": simulated}))


def _header(source: Path, first: dict[str, Any] | None) -> TruthHeader:
    try:
        return TruthHeader.model_validate(first)
    except ValidationError:
        raise InputError(f"{source}: no truth; allowed: what sim --truth writes") from None


def _objects(path: Path) -> Iterator[dict[str, Any]]:
    """All whole lines that have a time; the judge reads the rest of each."""
    for line in read_lines(path, Damage()):
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict) and isinstance(found.get("t"), int | float) and "type" in found:
            yield found


def _line(of: dict[str, Any], later_s: float) -> bytes:
    moved = of | {"t": round(of["t"] + later_s, 4)}
    return json.dumps(moved, separators=(",", ":")).encode() + b"\n"
