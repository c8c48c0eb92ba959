"""The recording of a station that has a run's folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarm_ctl.recording.mcap_recorder import McapRecorder, Sink
from swarm_ctl.report.folder.manifest import Manifest
from swarm_ctl.station.foxglove.desk import Desk


def run_mcap(
    folder: Path, manifest: Manifest, station: str, live: Sequence[Sink] = ()
) -> McapRecorder:
    """`recording.mcap` in `folder`, with Foxglove's view of the swarm; the file names the station
    whose round trips it has. `live`: what gets the same messages."""
    about = {
        "mission": manifest.mission,
        "plan_hash": manifest.plan_hash,
        "manifest": manifest.model_dump_json(),
        "station": station,
    }
    start_ns = round(manifest.started_at.timestamp() * 1e9)
    desk = Desk(manifest.plan, start_ns, speedup=manifest.speedup, station=station)
    return McapRecorder(folder, start_ns, about, manifest.record_hz, desk.hear, live)
