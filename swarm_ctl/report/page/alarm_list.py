"""The station's log of a flight, again from the recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarm_ctl.core.model.messages import Payload, Severity
from swarm_ctl.errors import InputError
from swarm_ctl.runfolder.last_statuses import read_events
from swarm_ctl.runfolder.manifest import Manifest
from swarm_ctl.station.picture.alarms import LEVEL_OF, Level
from swarm_ctl.station.picture.journal import EntryKind, JournalLine
from swarm_ctl.station.picture.playback import Film


def log_entries(
    folder: Path, manifest: Manifest, said: Sequence[tuple[float, Payload]]
) -> list[JournalLine]:
    """Alarms, warnings, errors and commands, of all that the recording holds; without a recording
    the agents' warnings alone."""
    try:
        by_time = sorted(said, key=lambda message: message[0])
        film = Film([by_time], manifest.plan, speedup=manifest.speedup)
        film.seek(film.end_s)
        entries = film.journal.entries
    except InputError:  # no recording, or nothing in it: the notes say so
        entries = tuple(
            JournalLine(
                event.time_s, EntryKind.EVENT, LEVEL_OF[event.level], (event.agent,), event.text
            )
            for event in read_events(folder, [])
            if event.level is not Severity.INFO
        )
    wanted = (
        entry
        for entry in entries
        if entry.level >= Level.WARNING or entry.kind in (EntryKind.CLEARED, EntryKind.COMMAND)
    )
    return sorted(wanted, key=lambda entry: entry.time_s)
