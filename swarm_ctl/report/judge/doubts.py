"""What an operator should know of a run that is no failure: how far estimates may be off."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from swarm_ctl.core.model.text import agents_named
from swarm_ctl.report.judge.distances import PairDistance
from swarm_ctl.runfolder.run_folder import RunFolder

_LEVEL_M: Final = 3.0
"""A barometer drifts by less than this in a flight; more is a slope, or a wrong height."""


def doubts(run: RunFolder, pairs: Iterable[PairDistance]) -> Iterator[str]:
    """A sentence each."""
    plan = run.plan
    r_in_m = plan.law.r_in * plan.unit_m if plan else 0.0
    for pair in pairs:
        if r_in_m <= pair.distance_m < r_in_m + pair.doubt_m:
            yield (
                f"{agents_named(pair.agents)} were {pair.distance_m:.2f} m apart at"
                f" {pair.time_s:.1f} s by their own estimates, give or take {pair.doubt_m:.2f} m:"
                f" they may have been under r_in {r_in_m:.2f} m"
            )
    for agent, track in run.tracks.items():
        for since_s, for_s in track.gaps():
            what = "where its vehicle was in the air is not known"
            yield f"agent {agent}: {what} for {for_s:.1f} s from {since_s:.1f} s on"
        heights = track.height_m[np.isfinite(track.height_m)]
        if len(heights) and abs(heights[-1]) > _LEVEL_M:
            height = f"{heights[-1]:+.1f} m from the height of its take-off"
            yield f"agent {agent}: its vehicle ended {height}, by its own estimate"
    silent = [i for i, track in run.tracks.items() if not np.isfinite(track.accuracy_m).any()]
    if silent:
        what = "the vehicle says no accuracy of its position, so the doubt has none of it"
        yield f"{agents_named(silent)}: {what}"
    for agent, last in run.last.items():
        if last.successor:
            how = "took its vehicle over" if last.from_air else "flew its vehicle from the ground"
            yield f"agent {agent}: its process was killed; another {how}"
