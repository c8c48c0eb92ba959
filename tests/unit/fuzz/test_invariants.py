"""Each invariant holds in a good flight, and is broken where its contrary is planted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarm_ctl.core.agent import failsafes, landing
from swarm_ctl.core.agent.command_handler import CommandHandler
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.takeover import Takeover
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.route import Routes
from swarm_ctl.fuzz.invariants.seen import Seen
from swarm_ctl.fuzz.invariants.table import Invariant, broken
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.runfolder.truth import TruthEvent
from swarm_ctl.virtual.scenario import load_scenario, scenario_of
from swarm_ctl.virtual.scenario_flight import FlownScenario, fly_scenario

LOW = Path(__file__).parents[2] / "system" / "low.yaml"
FOUND = Path(__file__).parents[2] / "scenarios" / "found"
FAR_M = 50.0


def flown(happens: str = "", more: str = "lands_after_s: 15") -> FlownScenario:
    """`tests/system/low.yaml`, with what happens."""
    text = f"version: 1\nmission: {LOW}\n{more}\nhappens: [{happens}]\n"
    return fly_scenario(*scenario_of(text))


def varied(happens: list[Any], **changed: Any) -> FlownScenario:
    """The same mission with other sections, and with what happens."""
    mission = {**yaml_file.read(LOW, what="mission").data, **changed}
    text = yaml_file.write({"version": 1, "mission": mission, "happens": happens})
    return fly_scenario(*scenario_of(text))


@pytest.fixture(scope="module")
def good() -> FlownScenario:
    return flown()


@pytest.fixture(scope="module")
def dead() -> FlownScenario:
    """Agent 2 dies on its way."""
    return flown("{at_s: 14, kill: [2]}")


@pytest.fixture(scope="module")
def taken() -> FlownScenario:
    """A pilot takes agent 2's vehicle."""
    return flown("{at_s: 12, pilot: {agents: [2], mode: hold}}")


def kinds(flight: FlownScenario) -> set[Invariant]:
    return {each.invariant for each in broken(flight)}


def test_a_good_flight_breaks_none(good: FlownScenario) -> None:
    assert broken(good) == []


def test_a_judge_that_sees_nothing_is_contradicted(good: FlownScenario) -> None:
    """By the truth: a vehicle that is up, one that fell, a pair that came too close."""
    truth = good.truth
    up = truth.airborne.copy()
    up[-1, 0] = True
    assert {Invariant.DOWN, Invariant.VERDICT} <= kinds(with_truth(good, airborne=up))
    sysid = truth.sysids[0]
    fell = TruthEvent(type="event", t=20.0, sysid=sysid, event="crash")
    assert kinds(with_truth(good, events=(*truth.events, fell))) == {Invariant.VERDICT}
    near = truth.position_ned_m.copy()
    near[250:255, 1] = near[250:255, 0] + 0.3
    assert {Invariant.APART, Invariant.VERDICT} <= kinds(with_truth(good, position_ned_m=near))


def test_a_second_take_off_is_none_that_touches_the_ground(good: FlownScenario) -> None:
    """It rises; where it holds at one height, the ground was touched."""
    truth, sysid = good.truth, good.truth.sysids[0]
    up_s = next(e.time_s for e in truth.events if e.sysid == sysid and e.event == "liftoff")
    for at_s, found in ((up_s + 3.2, True), (up_s + 4.9, False)):  # as it climbs, and once it is up
        ups = ((at_s, "liftoff"), (at_s + 0.5, "touchdown"))
        again = [TruthEvent(type="event", t=t, sysid=sysid, event=what) for t, what in ups]
        flight = with_truth(good, events=(*truth.events[:3], *again, *truth.events[3:]))
        assert (Invariant.ORDERED in kinds(flight)) is found


def test_one_that_does_not_stand_before_it_lands(monkeypatch: pytest.MonkeyPatch) -> None:
    """`policies.hold_before_land_s`; of one that lands by the mission see
    `found/station-is-lost-as-they-land.yaml`."""
    gone, land = "{at_s: 14, station: gone}", landing.Landing.land
    assert broken(flown(gone)) == []
    monkeypatch.setattr(landing.Landing, "land", lambda self, tick, hold_s: land(self, tick, 0.0))
    assert kinds(flown(gone)) == {Invariant.ACTS}


def test_a_landing_that_is_done_in_the_air(good: FlownScenario) -> None:
    """Though the vehicle comes down later."""
    ended_s = good.statuses[-1].steps[-1].end_s
    assert ended_s is not None
    late = good.truth.airborne.copy()
    late[good.truth.time_s < ended_s + 0.2] |= late[150]
    assert Invariant.DOWN in kinds(with_truth(good, airborne=late))
    armed = good.truth.armed.copy()
    armed[good.truth.time_s < ended_s + 0.2] = True
    assert Invariant.DOWN in kinds(with_truth(good, armed=armed))


def test_states_that_were_lost_and_are_not_counted() -> None:
    lossy = flown(more="lands_after_s: 15\nmesh: {loss: 0.2}")
    assert broken(lossy) == []
    deaf = [
        replace(status, links={j: replace(link, lost=2) for j, link in status.links.items()})
        for status in lossy.statuses
    ]
    assert "says that 2 of agent " in broken(replace(lossy, statuses=deaf))[0].text


def test_a_verdict_without_a_cause_of_its_kind(good: FlownScenario) -> None:
    for cause in (Cause.WIND, Cause.BATTERY, Cause.STATION, Cause.PILOT):
        summary = good.summary.model_copy(
            update={"outcome": Outcome.FAILED, "cause": cause, "reason": "it says so"}
        )
        assert Invariant.VERDICT in kinds(replace(good, summary=summary)), cause


def test_what_takes_off_again_or_moves_on_the_ground_was_not_ordered(good: FlownScenario) -> None:
    truth = good.truth
    lifts = next(event for event in truth.events if event.event == "liftoff")
    again = lifts.model_copy(update={"time_s": truth.time_s[-1]})
    assert Invariant.ORDERED in kinds(with_truth(good, events=(*truth.events, again)))
    moved = truth.position_ned_m.copy()
    moved[:5, 0, 0] -= FAR_M
    assert Invariant.ORDERED in kinds(with_truth(good, position_ned_m=moved))


def test_a_landing_that_is_accepted_and_not_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    obey = CommandHandler._obey

    def forget(self: CommandHandler, command: Any, situation: Any, leg: int) -> None:
        if command.kind != "land" or not command.agents:
            obey(self, command, situation, leg)

    assert broken(flown("{at_s: 16, order: land @2}")) == []
    monkeypatch.setattr(CommandHandler, "_obey", forget)
    long = "{at_s: 16, order: hold}, {at_s: 17, order: land @2}"
    assert Invariant.OBEYS in kinds(flown(long, "lands_after_s: 45"))


def test_a_death_that_nobody_minds(monkeypatch: pytest.MonkeyPatch) -> None:
    hold = "{at_s: 17, order: hold}"
    assert broken(flown(f"{hold}, {{at_s: 18, kill: [2]}}")) == []
    monkeypatch.setattr(
        failsafes,
        "CHECKS",
        {check: cause for check, cause in failsafes.CHECKS.items() if cause is not Cause.PEER},
    )
    assert Invariant.ACTS in kinds(flown(f"{hold}, {{at_s: 18, kill: [2]}}"))


def without(check: Any) -> dict[Any, Cause]:
    return {each: cause for each, cause in failsafes.CHECKS.items() if each is not check}


def test_a_pilot_whom_nobody_minds(monkeypatch: pytest.MonkeyPatch) -> None:
    """His vehicle counts no longer, but that its agent lets him have it does."""
    taken = "{at_s: 12, pilot: {agents: [2], mode: manual}}"
    assert broken(flown(taken)) == []
    monkeypatch.setattr(failsafes, "CHECKS", without(failsafes._taken_over))
    assert Invariant.ACTS in kinds(flown(taken, "lands_after_s: 60"))


def test_a_vehicle_without_a_position_that_flies_on(monkeypatch: pytest.MonkeyPatch) -> None:
    blind = "{at_s: 12, vehicle: {agents: [2], set: {SIM_GPS_OFF: 1}}, for_s: 3}"
    assert broken(flown(blind)) == []
    monkeypatch.setattr(Tick, "fix", property(lambda tick: tick.newest_fix))
    found = broken(flown(blind))
    assert "agent 2 had no position from 12 s on, and told one at " in found[-1].text


def test_a_landing_that_begins_in_full_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without braking the autopilot carries on sideways while its agent keeps clear no more."""
    land = "{at_s: 12.8, order: land}"
    assert broken(flown(land)) == []
    monkeypatch.setattr(landing, "_AT_REST_MPS", 100.0)
    assert Invariant.ORDERED in kinds(flown(land))


def test_a_silent_agents_vehicle_that_flies_on(dead: FlownScenario) -> None:
    """Its own failsafe stops it within seconds."""
    assert broken(dead) == []
    moved, late = dead.truth.position_ned_m.copy(), dead.truth.time_s > 17
    moved[late, 1, 0] += 2.0 * (dead.truth.time_s[late] - 17)
    assert Invariant.ORDERED in kinds(with_truth(dead, position_ned_m=moved))


def test_a_vehicle_that_is_taken_from_a_pilot(monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent that says that it goes on does so: it can't while the pilot has the vehicle."""
    given = "{at_s: 12, pilot: {agents: [2], mode: hold}}, {at_s: 14, order: resume @2}"
    assert broken(flown(given)) == []
    monkeypatch.setattr(Takeover, "not_given_back", lambda _, __: "")
    assert Invariant.OBEYS in kinds(flown(given))


def test_a_time_out_that_goes_on_in_a_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    orders = {12: "hold", 30: "resume"}
    steps = [{"takeoff": {"height_m": 4}}, {"form": {"shape": "hexagon", "timeout_s": 15}}, "land"]
    happens = [{"at_s": at_s, "order": line} for at_s, line in orders.items()]
    held = partial(varied, happens, steps=steps)
    assert broken(held()) == []
    monkeypatch.setattr(Progress, "hold_up", lambda *_: None)
    assert Invariant.ACTS in kinds(held())


def test_an_order_that_excuses_an_earlier_failure(taken: FlownScenario) -> None:
    assert taken.summary.outcome is Outcome.FAILED
    excused = taken.summary.model_copy(update={"outcome": Outcome.ABORTED, "cause": Cause.ORDER})
    assert Invariant.VERDICT in kinds(replace(taken, summary=excused))


def test_an_order_that_excuses_nobody_after_it() -> None:
    """Two are called back, and one runs empty on its way."""
    flight = fly_scenario(*load_scenario(FOUND / "fails-on-its-way-home.yaml"))
    assert broken(flight) == []
    changed = {"outcome": Outcome.FAILED, "cause": Cause.BATTERY, "reason": "empty"}
    failed = flight.summary.model_copy(update=changed)
    (found,) = broken(replace(flight, summary=failed))
    assert found.text == (
        "the verdict is failed (empty), but agents were ordered to end it at 20.0 s, before any"
        " failed"
    )


def test_a_cause_that_was_not_the_first() -> None:
    """A pilot takes one vehicle, and another one runs empty later."""
    drains = {"at_s": 18.0, "vehicle": {"agents": [3], "set": {"SIM_BATT_DRAIN": 400.0}}}
    takes = {"at_s": 12.0, "pilot": {"agents": [2], "mode": "land"}}
    policies = {"agent_lost": "continue", "battery_low": "land"}
    forms = {"form": {"shape": "row"}}
    steps = [{"takeoff": {"height_m": 4}}, forms, {"hold": {"duration_s": 30}}, "land"]
    flight = varied([takes, drains], policies=policies, steps=steps)
    assert broken(flight) == []
    assert flight.summary.cause is Cause.PILOT
    other = flight.summary.model_copy(update={"cause": Cause.BATTERY})
    (found,) = broken(replace(flight, summary=other))
    assert "the cause is battery, of " in found.text


def test_a_fence_that_counts_for_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """A vehicle that is told to be out of it does something, wherever it is by the truth."""
    fence = {"polygon": [[8, 8], [8, 22], [16, 22], [16, 8]]}
    jump = {"at_s": 11, "vehicle": {"agents": [2], "set": {"SIM_GPS_JUMP_N": 30}}}
    jumped = partial(varied, [jump], fence=fence)
    assert broken(jumped()) == []
    monkeypatch.setattr(failsafes, "CHECKS", without(failsafes._beyond_fence))
    assert Invariant.FENCED in kinds(jumped())


def test_a_flight_that_does_not_end(good: FlownScenario) -> None:
    assert Invariant.ENDS in kinds(replace(good, up=(2,)))


def test_a_pilots_vehicle_is_left_out(taken: FlownScenario) -> None:
    """It stays where the pilot holds it, or flies where he wants (the verdict is that of the true
    way)."""
    assert broken(taken) == []
    places = taken.truth.position_ned_m.copy()
    places[:, 1, 0] += 2.0 * np.clip(taken.truth.time_s - 17.0, 0.0, 8.0)
    assert kinds(with_truth(taken, position_ned_m=places)) == {Invariant.VERDICT}


def with_truth(flight: FlownScenario, **changed: Any) -> FlownScenario:
    """Another truth under the same verdict."""
    assert all(isinstance(value, np.ndarray | tuple) for value in changed.values())
    return replace(flight, truth=replace(flight.truth, **changed))


def rezoned(zone: str) -> FlownScenario:
    """With a zone from about 18 s on, in a hold of 22 s."""
    orders = [(14, "hold"), (16, zone), (36, "resume")]
    return flown(", ".join(f'{{at_s: {at}, order: "{line}"}}' for at, line in orders))


def test_a_zone_that_is_added_in_flight_is_not_entered() -> None:
    """Before it holds, and after it is lifted, nobody is in it."""
    flight = rezoned("zone add pond circle 100 50 3")
    assert broken(flight) == []
    since = next(s.time_s for s in flight.statuses if s.zones is not None)
    for at_s, found in ((since - 3.0, set()), (since + 3.0, {Invariant.ZONED})):
        places = flight.truth.position_ned_m.copy()
        k = int(np.searchsorted(flight.truth.time_s, at_s))
        places[k, 0, :2] = (100.0, 50.0)
        moved = with_truth(flight, position_ned_m=places)
        assert kinds(moved) & {Invariant.ZONED} == found


def test_who_is_in_a_zone_that_is_added_leaves_it() -> None:
    """One whose vehicle stays there is found, and not before it had time to leave."""
    flight = rezoned("zone add pond circle 66 76.6 2")
    assert broken(flight) == []
    places = flight.truth.position_ned_m.copy()
    since = next(s.time_s for s in flight.statuses if s.zones is not None)
    k = int(np.searchsorted(flight.truth.time_s, since))
    places[k:, 0] = places[k, 0]
    (first,) = [b for b in broken(with_truth(flight, position_ned_m=places)) if "zone" in b.text]
    assert "had time to leave it until" in first.text


def test_times_by_a_clock_that_is_ahead_are_those_of_the_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """So what an agent with such a clock does is judged as what the others do."""
    clocks = "clocks: [{agents: [2], ahead_s: -9.5, drift: 1.0e-4}]\nlands_after_s: 15"
    land = "{at_s: 12.8, order: land}"
    flight = flown(land, clocks)
    assert broken(flight) == []
    ends = {agent: said[-1].time_s for agent, said in Seen(flight).statuses.items()}
    assert max(ends.values()) - min(ends.values()) < 5.0
    monkeypatch.setattr(landing, "_AT_REST_MPS", 100.0)
    said = [each.text for each in broken(flown(land, clocks))]
    assert any(text.startswith("agent 2 began to land") for text in said)


def test_a_policy_that_weighs_too_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it says is done, and of two the one that weighs more."""
    policies = {"agent_lost": "hold", "estimate": "land"}
    doubt = {"at_s": 17, "vehicle": {"agents": [2], "set": {"SIM_GPS_SATS": 4}}}
    happens = [{"at_s": 16, "kill": [3]}, doubt, {"at_s": 34, "order": "land"}]
    steps = [{"takeoff": {"height_m": 4}}, {"form": {"shape": "hexagon"}}]
    steps += [{"hold": {"duration_s": 20}}, "land"]
    lost = partial(varied, happens, policies=policies, steps=steps)
    assert broken(lost()) == []
    by_policy = failsafes._by_policy

    def light(policy: Any, reason: str, **more: Any) -> Any:
        found = by_policy(policy, reason, **more)
        return found and replace(found, action=FailsafeAction.HOLD)

    monkeypatch.setattr(failsafes, "_by_policy", light)
    texts = [each.text for each in broken(lost())]
    assert any("did hold for estimate" in text and "says land" in text for text in texts)
    assert any("was in doubt" in text and text.endswith("agent 2 did not land") for text in texts)


def test_an_agent_that_is_given_up_too_early(good: FlownScenario) -> None:
    stop = "{at_s: 16, stop: [3], for_s: 3}"
    assert broken(flown(stop)) == []
    policies = {"agent_lost_after_s": 2.0}
    early = varied([{"at_s": 16, "stop": [3], "for_s": 3}], policies=policies)
    loaded = replace(early.mission, plan=good.mission.plan)
    texts = [each.text for each in broken(replace(early, mission=loaded))]
    assert any("nothing was lost before 16 s" in text for text in texts)


def test_a_link_whose_age_is_not_counted(dead: FlownScenario) -> None:
    said = tuple(
        replace(status, links={i: replace(each, age_s=0.1) for i, each in status.links.items()})
        for status in dead.statuses
    )
    assert Invariant.HEARD in kinds(replace(dead, statuses=said))


def test_a_vehicle_that_is_too_fast(good: FlownScenario) -> None:
    places = good.truth.position_ned_m.copy()
    flies = (good.truth.time_s > 14) & (good.truth.time_s < 20)
    places[flies, 1, 0] += 20.0 * (good.truth.time_s[flies] - 14)
    assert Invariant.SLOW in kinds(with_truth(good, position_ned_m=places))


def test_an_agent_that_ends_before_its_vehicle_is_disarmed(good: FlownScenario) -> None:
    armed = good.truth.armed.copy()
    armed[:, 1] = True
    texts = [each.text for each in broken(with_truth(good, armed=armed))]
    assert any("and its vehicle was armed" in text for text in texts)


def split(happens: list[Any]) -> FlownScenario:
    """Two groups of two that wait for each other at a barrier, which one reaches long before."""
    mission: dict[str, Any] = {**yaml_file.read(LOW, what="mission").data, "name": "split"}
    starts = ([14, 16], [12, 12], [10, 18], [16, 12])
    mission["agents"] = [{"id": k, "start": at} for k, at in enumerate(starts, 1)]
    mission["groups"] = {"red": [1, 2], "blue": [3, 4]}
    red: list[Any] = [{"move": {"by": [2, 0]}}, {"barrier": {"name": "meet"}}]
    red.append({"hold": {"duration_s": 4}})
    blue: list[Any] = [{"move": {"by": [-2, 0]}}, {"hold": {"duration_s": 7}}]
    blue.append({"barrier": {"name": "meet"}})
    shapes = {"ring": {"kind": "ring", "side": 2}}
    steps = [{"takeoff": {"height_m": 4}}, {"form": {"shape": "ring"}}]
    steps += [{"split": {"red": red, "blue": blue}}, "land"]
    text = {"version": 1, "mission": mission | {"shapes": shapes, "steps": steps}}
    return fly_scenario(*scenario_of(yaml_file.write(text | {"happens": happens})))


def test_groups_that_do_not_wait_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each agent is judged by its own steps."""
    assert (
        broken(split([{"at_s": 22, "order": "hold @blue"}, {"at_s": 30, "order": "resume"}])) == []
    )
    waits = Routes.late

    def alone(self: Routes, agent: int, number: int, told: Any) -> list[int]:
        own = self.of[agent].group(number).members
        return waits(self, agent, number, {i: step for i, step in told.items() if i in own})

    monkeypatch.setattr(Routes, "late", alone)
    assert Invariant.TOGETHER in kinds(split([]))


def test_a_group_that_the_operator_lands_leaves_no_step_undone() -> None:
    """The mission is that of the others."""
    flight = split([{"at_s": 20, "order": "land @red"}])
    assert flight.summary.outcome is Outcome.COMPLETED
    assert broken(flight) == []


def test_a_loss_is_one_of_its_own_group() -> None:
    """The other group flies on, until it waits for the lost one."""
    flight = split([{"at_s": 20, "kill": [3]}])
    assert broken(flight) == []
