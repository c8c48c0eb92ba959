"""What takes a station's messages: the recording of a run, and live views."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.recording.mcap_recorder import McapRecorder, Recorder, Sink
from swarm_ctl.rim import Trouble
from swarm_ctl.runfolder.manifest import Manifest
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


class LiveRecorder(Recorder):
    """Of a station that records nothing: its messages go to live views alone. `start_ns`: Unix
    time of mission time 0."""

    def __init__(self, live: Sequence[Sink], plan: Plan, start_ns: int, station: str) -> None:
        desk = Desk(plan, start_ns, station=station)
        super().__init__(start_ns, *live, derive=desk.hear)

    def note(self, trouble: Trouble, time_s: float) -> None:
        """Nothing is recorded."""
