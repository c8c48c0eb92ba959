"""A vehicle that has left the mission never flies, lies or stands under "all well"."""

from __future__ import annotations

import pytest

from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import EntryKind
from tests.scenarios.swarm import VirtualSwarm, flown_once, low_hexagon
from tests.scenarios.test_pilot import PILOTED, holding, switch
from tests.scenarios.watched import Watch

FORM, SHOWN_S = 2, 0.75
"""A status comes twice a second, and a look four times."""


@flown_once
def flying() -> Watch:
    """In the form step, all well."""
    watch = Watch(VirtualSwarm(low_hexagon()))
    watch.wait(lambda swarm: swarm.in_step(FORM))
    watch.run(1)
    assert watch.banners[-1][1:] == (Level.WELL, "all well")
    return watch


def since(watch: Watch, time_s: float) -> list[tuple[Level, str]]:
    """The banners from the moment on at which a screen can know."""
    first = max(k for k, (at, _, _) in enumerate(watch.banners) if at <= time_s + SHOWN_S)
    return [(level, words) for _, level, words in watch.banners[first:]]


@pytest.mark.parametrize(
    ("kind", "words", "level"),
    [
        ("kill", "killed by the operator", Level.ERROR),
        ("land", "landed by the operator", Level.WARNING),
    ],
)
def test_an_order_to_one_agent_stands_after_its_end(kind: str, words: str, level: Level) -> None:
    """Whatever the other then does."""
    watch = Watch(holding("ardupilot"))
    ordered_s = watch.swarm.now
    watch.swarm.command(kind, (PILOTED,))
    watch.wait(lambda swarm: swarm.members[PILOTED].ended is not None)
    watch.run(5)
    assert not any(line == "all well" for _, line in since(watch, ordered_s))
    standing = {(alarm.agents, alarm.words, alarm.level) for alarm in watch.journal.standing}
    assert ((PILOTED,), words, level) in standing


@pytest.mark.parametrize("preparing", [False, True])
def test_a_landing_of_all_is_one_line_and_the_newest_reason(*, preparing: bool) -> None:
    """As Ctrl-C orders it: in flight, and while the agents wait for their vehicles."""
    watch = Watch(VirtualSwarm(low_hexagon())) if preparing else flying()
    watch.run(2)
    ordered_s = watch.swarm.now
    watch.swarm.command("land")
    watch.fly()
    watch.run(3)
    told = (Level.WARNING, "agents 1-6: landed by the operator")
    assert set(since(watch, ordered_s)) == {told}
    alarms = [entry for entry in watch.journal.entries if entry.kind is EntryKind.ALARM]
    assert [entry.text for entry in alarms] == [told[1]]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_pilot_stands_in_the_banner(autopilot: str) -> None:
    """While the vehicle is the pilot's, and after it landed with an agent that failed."""
    watch = Watch(holding(autopilot))
    taken_s = watch.swarm.now
    switch(watch.swarm, autopilot, "pilot")
    watch.run(5)
    switch(watch.swarm, autopilot, "landing")
    watch.wait(lambda swarm: swarm.members[PILOTED].ended is not None)
    watch.run(10)
    assert not any(line == "all well" for _, line in since(watch, taken_s + 3))
    assert ("taken over", (PILOTED,)) in watch.raised
