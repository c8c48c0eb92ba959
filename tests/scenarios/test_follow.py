"""A formation follows a target: by late and lost words on the mesh, by lies, and by none."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import parse
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import Outcome, Phase, TargetWord
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swarm import at_half_rate, at_step, landing_fast, ready

MISSION = """\
version: 1
name: boat
origin: {lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 30, r_out: 7.5, r_in: 2.5}
vehicle: {limits: {speed_mps: 5}}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [10, 10]}
  - {id: 3, start: [10, 0]}
targets: {boat: {}}
shapes: {block: {kind: grid, spacing: 10, columns: 2}}
steps:
  - takeoff: {height_m: 6}
  - form: {shape: block}
  - follow: {target: boat, offset: [-5, 0], duration_s: 45, MORE}
  - land
fence: {polygon: [[-60, -60], [140, -60], [140, 200], [-60, 200]], height_m: 40}
"""
STEP = 3
EVERY_S = 0.2


class Boat:
    """A receiver on a boat, and the swarm that hears it. `at`: where it is so long after the step
    began, and its velocity [m, m/s]."""

    def __init__(
        self,
        at: Callable[[float], tuple[complex, complex]],
        more: str = "on_lost: hold",
        zones: str = "",
        target: str = "",
        slots: str = "",
        step: str = "",
    ) -> None:
        text = MISSION.replace("MORE", more).replace("boat: {}", f"boat: {{{target}}}")
        text = text.replace("columns: 2", f"columns: 2{slots}")
        text = re.sub("follow: .*", step, text) if step else text
        self.mission = loads(text + zones)
        self.swarm = at_step(self.mission, STEP)
        self._node = Node(MemoryTransport(self.swarm.mesh), "test", "boat.1")
        self._at, self._dice = at, np.random.default_rng(1)
        self.began_s = math.inf
        self.off_m: list[float] = []
        """How far each vehicle is from its place at the boat, tick by tick."""

    def word(self, seconds: float, **changes: object) -> TargetWord:
        at, velocity = self._at(seconds)
        place = geodetic_from_ned((at.real, at.imag, 0.0), self.mission.plan.origin)
        told = TargetWord(
            "boat",
            place.lat_deg,
            place.lon_deg,
            0.0,
            altitude_m=place.alt_m,
            velocity_ned_mps=(velocity.real, velocity.imag, 0.0),
            accuracy_m=0.5,
            station="boat.1",
        )
        return replace(told, **changes)

    def say(self, word: TargetWord) -> None:
        self._node.send(keys.SIGHTING, word)

    def fly(
        self,
        until_s: float,
        *,
        late_s: float = 0.0,
        lost: float = 0.0,
        silent_from_s: float = math.inf,
        silent_to_s: float = math.inf,
        after_s: float = 15.0,
        every_s: float = EVERY_S,
    ) -> None:
        """Until so long after the step began, or to the flight's end."""
        due, mail = 0.0, list[tuple[float, float, TargetWord]]()
        group = self.swarm.members[1].agent._group
        while not all(member.ended for member in self.swarm.members.values()):
            self.swarm.tick()
            now = self.swarm.now
            if group.progress.step == STEP and math.isinf(self.began_s):
                self.began_s = due = now
            seconds = now - self.began_s
            if seconds > until_s:
                return
            if now >= due - 1e-6 and not math.isinf(self.began_s):
                due += every_s
                silent = silent_from_s <= seconds < silent_to_s
                if not silent and self._dice.random() >= lost:
                    mail.append((now + late_s, now, self.word(seconds)))
            for each in [each for each in mail if each[0] <= now + 1e-6]:
                mail.remove(each)
                self.say(replace(each[2], age_s=now - each[1]))
            if seconds > after_s and group.progress.step == STEP:
                self._measure()

    def order(self, text: str) -> None:
        swarm = self.swarm
        agents = tuple(
            AgentNow(i, member.agent._controller.stop_point_m)
            for i, member in swarm.members.items()
        )
        now = SwarmNow(swarm.plan, swarm.now, STEP, agents)
        swarm.command(text.split()[0], step=build(parse(text, swarm.plan), now).step)

    def at_boat(self, agent: int) -> complex:
        """From its place at the boat to where it is [m]."""
        at, _ = self._at(self.swarm.now - self.began_s)
        slots, unit = self.swarm.members[1].agent._group.reference.slots, self.mission.plan.unit_m
        wanted = at - 5.0 + complex(*slots[agent]) * unit
        return complex(*self.swarm.positions()[agent][:2]) - wanted

    def _measure(self) -> None:
        self.off_m += [abs(self.at_boat(agent)) for agent in self.swarm.members]

    @property
    def rms_m(self) -> float:
        return math.sqrt(sum(off * off for off in self.off_m) / len(self.off_m))

    def said(self, words: str) -> bool:
        return any(words in event.text for event in self.swarm.events)

    def outcomes(self) -> set[Outcome]:
        return set(self.swarm.outcomes().values())


def straight(seconds: float) -> tuple[complex, complex]:
    """To the east at 3 m/s, from where the formation is."""
    return 10 + 5j + 3j * seconds, 3j


def circle(seconds: float) -> tuple[complex, complex]:
    """In a circle of 30 m at 3 m/s."""
    turn = complex(math.cos(0.1 * seconds), math.sin(0.1 * seconds))
    return 10 + 5j + 30 * (turn - 1) * -1j, 3 * turn


@pytest.mark.parametrize(
    ("at", "most_m", "late_s", "lost", "every_s"),
    [
        (circle, 1.0, 0.3, 0.2, EVERY_S),
        (straight, 0.8, 0.3, 0.0, 1.0),
        on_demand(straight, 0.6, 0.0, 0.0, EVERY_S),
        on_demand(straight, 0.6, 0.3, 0.2, EVERY_S),
        on_demand(circle, 1.0, 0.0, 0.0, EVERY_S),
    ],
)
def test_the_formation_is_where_its_target_is(
    at: Callable[[float], tuple[complex, complex]],
    most_m: float,
    late_s: float,
    lost: float,
    every_s: float,
) -> None:
    """Also where the news is late, and some of it lost, or said once a second: the formation does
    not brake before each word."""
    boat = Boat(at)
    boat.fly(30.0, late_s=late_s, lost=lost, every_s=every_s)
    assert boat.rms_m < most_m
    assert boat.swarm.closest_m > 2.5


def test_a_receiver_that_tells_no_speed_is_followed_by_its_places() -> None:
    """It tells 0, as some do that do not know it."""
    boat = Boat(lambda seconds: (straight(seconds)[0], 0j))
    boat.fly(30.0)
    assert boat.rms_m < 0.6
    assert boat.said("off that of its places: the places count")


def test_after_a_target_that_circles_at_thrice_its_speed_the_formation_flies_no_faster() -> None:
    """As stop points are ahead of vehicles the formation is put ahead of its target: by as much as
    it flies itself, not by what such a target would need."""

    def plane(seconds: float) -> tuple[complex, complex]:
        turn = complex(math.cos(0.3 * seconds), math.sin(0.3 * seconds))
        return 10 + 5j + 50 * (turn - 1) * -1j, 15 * turn

    boat, frames = Boat(plane), list[complex]()

    def note() -> None:
        frame = boat.swarm.members[1].agent._group.reference.frame
        if frame is not None:
            frames.append(complex(*frame.point_m))

    boat.swarm.after_tick = note
    boat.fly(12.0)
    moved = max(abs(b - a) for a, b in itertools.pairwise(frames)) / boat.swarm.plan.tick_s
    assert 4.5 < moved < 7.5


def test_a_target_that_falls_silent_is_waited_for_and_found_again_without_a_jump() -> None:
    """The formation brakes after a second, stands, says so, and closes up at its speed."""
    boat = Boat(straight)
    boat.fly(15.0, silent_from_s=6.0, silent_to_s=17.0)
    frames = [member.agent._group.reference.frame for member in boat.swarm.members.values()]
    assert all(frame is not None and math.hypot(*frame.velocity_mps) < 0.01 for frame in frames)
    assert boat.said("target boat is not heard: the formation stands")
    fastest = 0.0

    def note() -> None:
        nonlocal fastest
        setpoints = [m.agent._controller.setpoint_mps for m in boat.swarm.members.values()]
        fastest = max(fastest, *(math.hypot(*setpoint) for setpoint in setpoints))

    boat.swarm.after_tick = note
    boat.fly(40.0, silent_to_s=17.0)
    assert boat.said("target boat is heard: the formation closes up")
    assert 4.0 < fastest <= 5.0 + 1e-6
    assert all(abs(boat.at_boat(agent)) < 1.5 for agent in boat.swarm.members)


@pytest.mark.parametrize(
    ("on_lost", "outcome"), [("land", Outcome.FAILED), ("continue", Outcome.COMPLETED)]
)
def test_what_is_done_when_a_target_stays_away(on_lost: str, outcome: Outcome) -> None:
    boat = Boat(straight, f"lost_after_s: 5, on_lost: {on_lost}")
    boat.fly(math.inf, silent_from_s=3.0)
    assert boat.outcomes() == {outcome}
    assert boat.swarm.now < boat.began_s + 30.0
    if outcome is Outcome.FAILED:
        reasons = {member.ended.reason for member in boat.swarm.members.values() if member.ended}
        assert "target boat has not been heard for 5 s" in " ".join(reasons)


@pytest.mark.parametrize("ordered", ["hold", on_demand("form block")])
def test_while_an_order_is_flown_in_place_of_the_step_nothing_is_done_of_a_lost_target(
    ordered: str,
) -> None:
    """The pilot has the swarm where he wants it; with the step the time begins anew."""
    boat = Boat(straight, "lost_after_s: 5, on_lost: land")
    boat.fly(5.0)
    boat.order(ordered)
    boat.fly(12.0, silent_from_s=0.0)
    assert not any(member.ended for member in boat.swarm.members.values())
    boat.swarm.command("resume", name="goes-on")
    boat.fly(16.0, silent_from_s=0.0)
    assert not boat.said("has not been heard for 5 s")
    boat.fly(math.inf, silent_from_s=0.0)
    assert boat.outcomes() == {Outcome.FAILED}
    assert boat.said("target boat has not been heard for 5 s")


@pytest.mark.parametrize("pause_s", [120, 5])
def test_an_agent_that_an_order_held_is_waited_for_and_comes_back(pause_s: int) -> None:
    """For so long; then the formation flies on without it. When it comes back, the formation may be
    far away."""
    policies = f"policies: {{override_pause_s: {pause_s}, left_by_order: continue}}\n"
    boat = Boat(straight, zones=policies)
    boat.fly(5.0)
    boat.swarm.command("hold", agents=(2,))
    boat.fly(18.0)
    flown_m = abs(boat.at_boat(3))
    assert flown_m > 25.0 if pause_s > 60 else flown_m < 20.0
    boat.swarm.command("resume", name="back", agents=(2,))
    boat.fly(44.0)
    assert all(abs(boat.at_boat(agent)) < 1.5 for agent in boat.swarm.members)
    assert not boat.said("not believed")


def test_a_formation_does_not_run_after_an_agent_of_its_own() -> None:
    """Its place is not the target's, so that it would go on and on. When a pilot has taken the
    agent it is followed."""
    policy = "policies: {agent_lost: continue}\n"
    fault = "simulation: {faults: [{at_s: 19, agents: [3], pilot: return}]}\n"
    boat = Boat(straight, zones=policy + fault, target="agent: 3")

    def centre() -> complex:
        frame = boat.swarm.members[1].agent._group.reference.frame
        assert frame is not None
        return complex(*frame.point_m)

    boat.fly(1.0, silent_from_s=0.0)
    began = centre()
    boat.fly(6.0, silent_from_s=0.0)
    assert abs(centre() - began) < 0.1
    assert boat.said("is agent 3 of this formation, and no pilot flies it: the formation stands")
    boat.fly(20.0, silent_from_s=0.0)
    flown = complex(*boat.swarm.positions()[3][:2])
    assert abs(centre() - flown + 5.0) < 1.0


def test_a_liar_beside_the_boat_leads_nobody_away() -> None:
    """A second sender, 60 m to the north; both are named."""
    boat = Boat(straight)
    liar, tick = Node(MemoryTransport(boat.swarm.mesh), "test", "liar.1"), boat.swarm.tick

    def and_lie() -> None:
        tick()
        if not math.isinf(boat.began_s):
            told = boat.word(boat.swarm.now - boat.began_s, station="liar.1")
            liar.send(keys.SIGHTING, replace(told, latitude_deg=told.latitude_deg + 60 / 111_000))

    boat.swarm.tick = and_lie  # type: ignore[method-assign]
    boat.fly(30.0)
    assert boat.rms_m < 0.8
    assert boat.said("is told by two, boat.1 and liar.1")


def test_a_target_that_is_where_it_cannot_be_followed_is_said_to_be() -> None:
    """On the ground, in a zone, and outside the fence."""

    def away(seconds: float) -> tuple[complex, complex]:
        return 10 - 20j - 4j * seconds, -4j

    boat = Boat(away, zones="zones: {oak: {circle: [10, -40], radius: 2}}")
    plain = boat.word
    boat.word = lambda seconds, **changes: replace(  # type: ignore[method-assign]
        plain(seconds, **changes), on_ground=seconds > 3.0
    )
    boat.fly(14.0)
    assert boat.said("target boat is on the ground: the formation stands by it")
    assert boat.said("target boat is in zone oak: the vehicles keep out of it")
    assert boat.said("target boat is outside the fence: the formation stays inside")


def test_a_step_ends_where_its_target_comes_to_a_place() -> None:
    """The boat is 4 m before it after 12 s; the step has 45."""
    boat = Boat(straight, "until: [10, 45], until_within_m: 4")
    boat.fly(math.inf)
    assert boat.outcomes() == {Outcome.COMPLETED}
    ended_s = min(e.time_s for e in boat.swarm.events if e.text.startswith("step 4"))
    assert 11.5 < ended_s - boat.began_s < 15.0


def test_a_formation_rises_with_the_target_that_it_flies_above() -> None:
    """A boat is lifted by a lock: 6 m; its words are off by 2 m up and down, as waves are."""
    boat = Boat(straight, "above_m: 12")
    plain = boat.word

    def lifted(seconds: float, **changes: object) -> TargetWord:
        word, wave = plain(seconds, **changes), 2.0 * math.sin(2.0 * seconds)
        assert word.altitude_m is not None
        return replace(word, altitude_m=word.altitude_m + min(6.0, 0.5 * seconds) + wave)

    boat.word = lifted  # type: ignore[method-assign]
    boat.fly(24.0)
    downs = np.asarray(boat.swarm.hub.world.positions())[:, 2]
    assert all(abs(-downs - 18.0) < 1.0)


def test_the_highest_slot_stays_below_the_fence_above_a_target() -> None:
    """The fence is 40 m high; 30 m and the slots' 12 m are more."""
    boat = Boat(straight, "above_m: 30", slots=", up_m: [0, 6, 12]")
    boat.fly(32.0)
    highest = -np.asarray(boat.swarm.hub.world.positions())[:, 2].min()
    assert 36.5 < highest < 39.0


def test_a_target_that_flies_at_a_standing_vehicle_is_made_way_for() -> None:
    """At 3 m/s, at its height; the vehicle's top speed is 5."""

    def ram(seconds: float) -> tuple[complex, complex]:
        return 10 - 12j + 3j * seconds, 3j

    boat, nearest = Boat(ram, target="height_m: 6", step="hold: {duration_s: 25}"), [math.inf]

    def note() -> None:
        if not math.isinf(boat.began_s):
            at, _ = ram(boat.swarm.now - boat.began_s)
            places = boat.swarm.positions().values()
            nearest.append(min(abs(complex(*place[:2]) - at) for place in places))

    boat.swarm.after_tick = note
    boat.fly(10.0)
    assert 2.0 < min(nearest) < 5.0
    assert boat.swarm.closest_m > 5.0


def test_an_order_follows_a_target_until_another_order() -> None:
    """In place of the mission's step, which goes on where it was."""
    boat = Boat(straight)
    boat.fly(5.0)
    swarm = boat.swarm
    boat.order("follow boat 0 20 course")
    boat.fly(20.0)
    at, _ = straight(swarm.now - boat.began_s)
    wanted = at - 20.0  # its course is east, so that its right is south
    mean = np.mean([complex(*place[:2]) for place in swarm.positions().values()])
    assert abs(mean - wanted) < 2.0
    swarm.command("resume", name="c2")
    boat.fly(32.0)
    assert all(abs(boat.at_boat(agent)) < 1.5 for agent in swarm.members)


@pytest.mark.parametrize(
    ("ready", "seed", "duration_s"),
    [(at_half_rate, 1, 32), *(on_demand(ready, seed, 130) for seed in range(1, 21))],
)
def test_the_ready_mission_around_a_boat(
    ready: Callable[[str], str], seed: int, duration_s: int
) -> None:
    """Twelve, until they land; the boat is played. Past its first turn, or all the way."""
    text = ready("follow.yaml").replace("duration_s: 130", f"duration_s: {duration_s}")
    mission = loads(text)
    swarm = landing_fast(VirtualSwarm(mission, seed=seed))
    swarm.wait(lambda s: s.in_step(5))
    assert swarm.phases() <= {Phase.FLY, Phase.LAND}
    assert swarm.closest_m > 5.0
