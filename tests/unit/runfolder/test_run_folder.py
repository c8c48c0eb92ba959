"""What a run folder has, read once."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from swarm_ctl.core.model.messages import AgentStatus, StepOutcome
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.runfolder.last_statuses import LastStatus, read_statuses
from swarm_ctl.runfolder.run_folder import RunFolder, zone_spells
from tests.unit.report.run_folders import PLAN, STEPS, account, manifest
from tests.unit.station.swarm import status_of

OLD, NEW, LAST = (Zone(name, ((50.0, 5.0 * k),), 1.0, 1.25) for k, name in enumerate("abc"))
PLANNED = replace(PLAN, zones=(OLD,))
Words = dict[int, list[tuple[float, tuple[Zone, ...] | None]]]
LIVED: Words = {
    1: [(1.0, None), (10.0, (OLD, NEW)), (20.0, (NEW,)), (30.0, (NEW, LAST)), (40.0, (NEW, LAST))],
    2: [(1.2, None), (9.7, (OLD, NEW)), (20.3, (NEW,)), (30.1, (NEW, LAST)), (41.0, (NEW, LAST))],
    3: [(1.1, None), (9.9, (OLD, NEW)), (20.1, (NEW,)), (30.3, (NEW, LAST)), (40.5, (NEW, LAST))],
}
SPELLS = [("a", -math.inf, 19.6), ("b", 9.9, math.inf), ("c", 30.1, math.inf)]


def spells(words: Words) -> list[tuple[str, float, float]]:
    """(name, from, until) of all zones of a flight in which agents said this."""
    said = [status_of(PLANNED, i, at, zones=z) for i, told in words.items() for at, z in told]
    found = zone_spells(PLANNED, said)
    return [(zone.name, from_s, until_s) for zone, from_s, until_s in found]


def test_a_step_that_ran_out_of_time_begins_no_landing() -> None:
    """The mission went on after it; a landing begins with the step that is the last."""
    went_on = [*STEPS[:2], replace(STEPS[2], result=StepOutcome.TIMEOUT, end_s=30.0)]
    begun = replace(STEPS[3], start_s=30.0, end_s=None, result=StepOutcome.RUNNING)
    broken = replace(begun, end_s=40.0, result=StepOutcome.ABORTED)
    for last, landing_s in ((begun, math.inf), (broken, 40.0)):
        steps = (*went_on, last)
        told = {i: LastStatus(account(i, steps=steps), final=True) for i in range(1, 7)}
        run = RunFolder(manifest(), None, {}, None, agents=tuple(told), last=told, notes=[])
        assert run.landing_s() == landing_s


def test_zones_are_in_force_while_most_agents_say_so() -> None:
    """Those of the plan from the beginning; an end counts as early as it may have been, which is
    one status before it was told."""
    assert spells(LIVED) == SPELLS
    assert spells({}) == [("a", -math.inf, math.inf)]
    alone = spells({1: LIVED[1]})
    assert alone == [("a", -math.inf, 19.5), ("b", 10.0, math.inf), ("c", 30.0, math.inf)]


@pytest.mark.parametrize(
    "words",
    [
        LIVED[3][:2],
        [*LIVED[3][:3], (25.0, None), (26.5, (NEW,)), *LIVED[3][3:]],
        [(at - 5.0, zones) for at, zones in LIVED[3]],
    ],
    ids=["it fell silent", "it was started again", "its clock is off"],
)
def test_one_agent_of_many_begins_and_ends_no_zone(
    words: list[tuple[float, tuple[Zone, ...] | None]],
) -> None:
    found = {name: (from_s, until_s) for name, from_s, until_s in spells({**LIVED, 3: words})}
    assert sorted(found) == ["a", "b", "c"]
    for name, from_s, until_s in SPELLS:
        assert found[name] == (pytest.approx(from_s, abs=0.5), pytest.approx(until_s, abs=0.5))


def test_the_file_has_each_status_that_tells_of_other_zones(tmp_path: Path) -> None:
    """Others of an agent that goes on are two seconds apart."""
    recorder = RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}))
    for k in range(10):
        zones = (NEW,) if 3 <= k < 6 else None
        recorder.take(status_of(PLAN, 1, 0.5 * k, zones=zones), 0.5 * k)
    recorder.close()

    def at(status: AgentStatus) -> float:
        return status.time_s

    assert list(map(at, read_statuses(tmp_path, []))) == [0.0, 1.5, 3.0]
