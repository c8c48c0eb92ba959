"""A report of a recording in which words have fields out of all ranges."""

from __future__ import annotations

import math
import struct
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import ExchangeState, Payload
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.errors import PayloadError
from swarm_ctl.mesh.payloads import decode, encode
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.runfolder.manifest import write_manifest
from tests.odd_words import odd_changes
from tests.unit.report import run_folders
from tests.unit.station.swarm import state_of, status_of

STATE = state_of(run_folders.PLAN, 3, 1.0, frame=Frame((0.0, 0.0)), exchange=ExchangeState(2))
STATUS = status_of(run_folders.PLAN, 3, 1.0)


def on_the_wire(payload: Payload) -> Payload | None:
    """What a hearer makes of it; None: no bytes say it."""
    try:
        return decode(type(payload), encode(payload))
    except (struct.error, PayloadError, OverflowError, UserWarning):
        return None


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(odd_changes(STATE), min_size=1, max_size=4), st.lists(odd_changes(STATUS), max_size=4)
)
@example([{"position_ned_m": (1e300, -1e300, 1e300)}], [])
@example([{"time_s": 1e13}], [])
def test_no_recorded_word_breaks_a_report(
    states: list[dict[str, Any]], statuses: list[dict[str, Any]]
) -> None:
    """Of real vehicles, so that the recording is what is judged by: agent 3 says odd words between
    its own."""
    with tempfile.TemporaryDirectory() as name:
        run = run_folders.write_run(Path(name))
        write_manifest(run, run_folders.manifest(simulated=()))
        (run / "truth.jsonl").unlink()
        recorder = RunRecorder(run, McapRecorder(run, 0, {}))
        for k in range(int(2 * run_folders.END)):
            t = 0.5 * k
            up = run_folders.LIFTOFF <= t < run_folders.TOUCHDOWN
            for i in range(1, 7):
                where = run_folders.position(i, t)
                told = state_of(run_folders.PLAN, i, t, seq=2 * k + 1, position_ned_m=where)
                recorder.take(told, t)
                status = status_of(run_folders.PLAN, i, t, armed=up, airborne=up)
                recorder.take(status, t)
                if i == 3:
                    odd = replace(told, **{"seq": 2 * k + 2} | states[k % len(states)])
                    words = [on_the_wire(odd)]
                    if k < len(statuses):
                        words.append(on_the_wire(replace(status, **statuses[k])))
                    for word in words:
                        if word is not None:
                            recorder.take(word, t)
        recorder.close()
        summary = summarise(run, run_folders.EXIT_CODES)
        assert "can't be judged" not in summary.reason
        assert summary.min_distance_m is not None
        assert math.isfinite(summary.min_distance_m)
