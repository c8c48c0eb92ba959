"""A flight as the invariants look at it: by the simulator's truth, and what the scenario took out
of the swarm's hands."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.kernel.constraints import margins_of
from swarm_ctl.core.model.messages import AgentState, AgentStatus, CommandKind, Phase
from swarm_ctl.core.model.route import Route, Routes
from swarm_ctl.mesh.payloads import decode
from swarm_ctl.mission.checks import envelope
from swarm_ctl.runfolder.run_folder import ZoneSpell, zone_spells
from swarm_ctl.runfolder.truth import EventKind
from swarm_ctl.virtual.as_processes import own_clocks
from swarm_ctl.virtual.scenario import Happening
from swarm_ctl.virtual.scenario_flight import FlownScenario, GivenOrder

FREE_M: Final = 4.0
"""Starts this much over r_in apart leave room for take-offs and landings that autopilots fly."""
FLIES: Final = (Phase.FLY, Phase.HOLD, Phase.RETURN)
"""An agent's vehicle follows its setpoints."""
_LATE_S: Final = 0.2
_LOST: Final = 0.2
"""States that are late or lost by up to this are inside the envelope."""
_NOISE_M: Final = 0.5
"""An estimate that is off by this much is weather, not a fault."""
_VELOCITY_MPS: Final = 0.25
"""That of a PX4 as delivered."""
_WIND_MPS: Final = 6.0
_LEARNS_S: Final = 10.0
_MISLED_S: Final = 2.0
"""A vehicle goes by its places of the last seconds."""


class Seen:
    """A flight as the invariants look at it."""

    def __init__(self, flown: FlownScenario) -> None:
        self.flown, self.plan, self.truth = flown, flown.mission.plan, flown.truth
        self.happens = flown.scenario.happens
        self.ids = [agent.id for agent in self.plan.agents]
        sysid = {entry.id: entry.sysid for entry in flown.mission.fleet.agents}
        column = {s: k for k, s in enumerate(self.truth.sysids)}
        self.column = {agent: column[sysid[agent]] for agent in self.ids}
        self.agent_of = {sysid[agent]: agent for agent in self.ids}
        self.unit_m = self.plan.unit_m
        self.r_in_m = self.plan.law.r_in * self.unit_m

    def events(self, agent: int, kind: EventKind) -> list[float]:
        """When it happened to this agent's vehicle."""
        return [
            event.time_s
            for event in self.truth.events
            if event.event == kind and self.agent_of.get(event.sysid) == agent
        ]

    def track(self, agent: int) -> npt.NDArray[np.float64]:
        """(T, 3), north, east and down [m]."""
        found: npt.NDArray[np.float64] = self.truth.position_ned_m[:, self.column[agent]]
        return found

    def speed_mps(self, agent: int) -> npt.NDArray[np.float64]:
        """(T,), horizontal, by the positions."""
        time_s, track = self.truth.time_s, self.track(agent)[:, :2]
        if len(time_s) < 2:
            return np.zeros(len(time_s))
        velocity = np.gradient(track, time_s, axis=0)
        found: npt.NDArray[np.float64] = np.hypot(velocity[:, 0], velocity[:, 1])
        return found

    def airborne(self, agent: int) -> npt.NDArray[np.bool_]:
        """(T,)"""
        found: npt.NDArray[np.bool_] = self.truth.airborne[:, self.column[agent]]
        return found

    @cached_property
    def statuses(self) -> dict[int, list[AgentStatus]]:
        """By agent, in the order of time, which is that of the truth."""
        found: dict[int, list[AgentStatus]] = {agent: [] for agent in self.ids}
        for status in self.flown.statuses:
            found[status.agent].append(status)
        return found | {
            agent: _in_true_time(found[agent], ahead_s, drift)
            for agent, (ahead_s, drift) in own_clocks(self.flown.scenario).items()
            if agent not in self.elsewhen
        }

    @cached_property
    def states(self) -> dict[int, list[AgentState]]:
        """By agent, in the order of time, which is that of the truth."""
        found: dict[int, list[AgentState]] = {agent: [] for agent in self.ids}
        for data in self.flown.states:
            state = decode(AgentState, data)
            found[state.agent].append(state)
        for agent, (ahead_s, drift) in own_clocks(self.flown.scenario).items():
            if agent not in self.elsewhen:
                found[agent] = [
                    replace(state, time_s=(state.time_s - ahead_s) / (1.0 + drift))
                    for state in found[agent]
                ]
        return found

    def zones(self, agent: int) -> tuple[ZoneSpell, ...]:
        """Those of the plan, and those of the flight, while this agent said that they hold."""
        return zone_spells(self.plan, self.statuses[agent])

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Of all vehicles, from the start."""
        return self.flown.mission.file.simulation.parameters.given()

    @cached_property
    def faults(self) -> list[tuple[float, float, tuple[int, ...], dict[str, float], str]]:
        """From, to, of whom, which parameters, which pilot's mode."""
        found: list[tuple[float, float, tuple[int, ...], dict[str, float], str]] = []
        for entry in self.flown.mission.file.simulation.faults:
            until_s = math.inf if entry.for_s is None else entry.at_s + entry.for_s
            agents = entry.agents or tuple(self.ids)
            found.append((entry.at_s, until_s, agents, entry.set.given(), entry.pilot or ""))
        return found

    @cached_property
    def from_start(self) -> bool:
        """The times of the vehicles' faults count from the start."""
        return self.flown.mission.file.simulation.since == "start"

    def of(self, *kinds: str) -> list[Happening]:
        """The happenings of these kinds, in the order of time."""
        return sorted(
            (each for each in self.happens if each.kind in kinds), key=lambda each: each.at_s
        )

    def first(self, agent: int, *kinds: str) -> float:
        """When such a thing first befell this agent [s]; inf: never."""
        times = []
        for each in self.of(*kinds):
            named = {
                "kill": each.kill,
                "stop": each.stop,
                "restart": each.restart,
                "pilot": each.pilot and each.pilot.agents,
                "says": each.says and each.says.agents,
                "clock": each.clock and each.clock.agents,
                "vehicle": each.vehicle and each.vehicle.agents,
            }[each.kind]
            if agent in (named or ()):
                times.append(each.at_s)
        return min(times, default=math.inf)

    @cached_property
    def taken(self) -> dict[int, float]:
        """From when on an agent's vehicle is in a pilot's hands, or in those of a fault that makes
        it fall, blind or deaf: inf for most."""
        found = dict.fromkeys(self.ids, math.inf)
        for from_s, _, agents, values, pilot in self.faults:
            grave = pilot or any(_grave(name, value) for name, value in values.items())
            for agent in agents if grave else ():
                found[agent] = min(found[agent], from_s if self.from_start else 0.0)
        for agent in self.ids if any(_grave(*each) for each in self.parameters.items()) else ():
            found[agent] = 0.0
        return found

    @cached_property
    def lies(self) -> dict[int, float]:
        """From when on an agent tells what is not so."""
        return {agent: self.first(agent, "says") for agent in self.ids}

    @cached_property
    def elsewhen(self) -> set[int]:
        """Agents whose clock is set in flight: what they say may have happened at two times."""
        jumps = (each.clock.agents for each in self.happens if each.clock is not None)
        return set[int]().union(*jumps)

    @cached_property
    def one_clock(self) -> bool:
        """All go by the swarm's clock."""
        return not own_clocks(self.flown.scenario)

    @cached_property
    def good_mesh(self) -> bool:
        """States come as the envelope has them."""
        mesh = self.flown.scenario.mesh
        return mesh.loss <= _LOST and mesh.delay_s + mesh.jitter_s <= _LATE_S

    @cached_property
    def wind_mps(self) -> float:
        """The most that it is set to anywhere, gusts of three deviations included."""
        return self._most("SIM_WIND_SPD") + 3.0 * self._most("SIM_WIND_GUST")

    @property
    def calm(self) -> bool:
        """The wind is inside the envelope, and so are its gusts."""
        gusts_mps = envelope.most_gusts_mps(self.plan)
        return self.wind_mps <= _WIND_MPS and self._most("SIM_WIND_GUST") <= gusts_mps

    def _most(self, name: str) -> float:
        """The most that a parameter is set to anywhere."""
        sets = [self.parameters, *(values for _, _, _, values, _ in self.faults)]
        return max(values.get(name, 0.0) for values in sets)

    @cached_property
    def blown(self) -> npt.NDArray[np.bool_]:
        """(T,): a wind that was set anew in flight carries vehicles until they have learnt it."""
        time_s = self.truth.time_s
        found = np.zeros(len(time_s), dtype=np.bool_)
        for from_s, until_s, _, values, _ in self.faults:
            if any(name.startswith("SIM_WIND") for name in values):
                for at_s in (from_s, until_s) if self.from_start else (0.0,):
                    ends_s = at_s + _LEARNS_S if self.from_start else math.inf
                    found |= (time_s >= at_s) & (time_s < ends_s)
        return found

    @cached_property
    def enveloped(self) -> bool:
        """The mission is inside the envelope (a tick of up to 0.1 s is let through), and so is the
        weather."""
        found = [finding for finding in envelope.outside(self.plan) if finding.place != ("tick_s",)]
        return not found and self.plan.safety.filter and self.calm

    @cached_property
    def misjudged_m(self) -> float:
        """By how much [m] drawn GPS noise and drift may mislead at most: four deviations of two
        positions, less what is spared."""
        worst = (self._most(name) for name in ("SIM_GPS_NOISE", "SIM_GPS_DRIFT"))
        return max(0.0, 4.0 * math.sqrt(2.0) * math.hypot(*worst) - self.spared_m)

    @cached_property
    def spared_m(self) -> float:
        """Half of what the keep-out spares [m], where vehicles answer as is believed: wind, loss
        and lag use up the other half."""
        plan = self.plan
        margins = margins_of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m)
        fleet = self.flown.mission.fleet.agents
        as_believed = all(entry.simulated_response is None for entry in fleet)
        return 0.5 * (margins.keep_out - self.r_in_m) if as_believed else 0.0

    def off_m(self, agent: int) -> npt.NDArray[np.float64]:
        """(T,): how far the places that an agent told lay off the truth, the most of the last
        `_MISLED_S`."""
        time_s, states = self.truth.time_s, self.states[agent]
        if not states or agent in self.elsewhen:
            return np.full(len(time_s), np.inf if agent in self.elsewhen else 0.0)
        told_s = np.array([state.time_s for state in states])
        told = np.array([state.position_ned_m[:2] for state in states])
        track = self.track(agent)
        true = np.stack([np.interp(told_s, time_s, track[:, k]) for k in range(2)], axis=1)
        off = np.linalg.norm(told - true, axis=1)
        first = np.searchsorted(told_s, time_s - _MISLED_S)
        last = np.searchsorted(told_s, time_s, side="right")
        return np.array(
            [off[i:k].max(initial=0.0) for i, k in zip(first.tolist(), last.tolist(), strict=True)]
        )

    @cached_property
    def apart_at_start(self) -> float:
        """The smallest distance of two starts [m]."""
        starts = [agent.start for agent in self.plan.agents]
        pairs = itertools.combinations(starts, 2)
        return min((math.dist(a, b) * self.unit_m for a, b in pairs), default=math.inf)

    @cached_property
    def fair(self) -> bool:
        """Nothing happens, and nothing blows; clocks may differ."""
        scenario, fleet = self.flown.scenario, self.flown.mission.fleet.agents
        return (
            not (self.happens or self.parameters or self.faults)
            and not scenario.mesh.model_dump(exclude_defaults=True)
            and all(entry.simulated_response is None for entry in fleet)
            and self.enveloped
            and self.apart_at_start >= self.r_in_m + FREE_M
        )

    @cached_property
    def timely(self) -> bool:
        """Its times can be held against the forecast: ticks as the envelope has them."""
        return not envelope.outside(self.plan)

    def orders(self, agent: int, *kinds: CommandKind) -> list[GivenOrder]:
        """Those that this agent accepted; all kinds if none is named."""
        return [
            order
            for order in self.flown.orders
            if order.sent is not None
            and (ack := order.sent.acks.get(agent)) is not None
            and ack.accepted
            and (not kinds or order.sent.command.kind in kinds)
        ]

    @cached_property
    def routes(self) -> Routes:
        """The steps of each agent."""
        return Routes(self.plan)

    def route(self, agent: int) -> Route:
        """That this agent flies, over all its groups."""
        return self.routes.of[agent]

    def step_start(self, agent: int, k: int) -> float:
        """When the first of this agent's group began step k [s]; inf: none did."""
        starts = [
            status.steps[k].start_s
            for other in self.route(agent).group(k).ids
            for status in self.statuses[other][-1:]
            if len(status.steps) > k and other not in self.elsewhen
        ]
        return min(starts, default=math.inf)

    def timed_out(self, agent: int, k: int) -> bool:
        """Step k took all the time that it may: with `continue` all go on."""
        steps = self.route(agent).steps
        if not 0 < k < len(steps):
            return False
        begun_s, ended_s = self.step_start(agent, k), self.step_start(agent, k + 1)
        return ended_s - begun_s >= steps[k - 1].timeout_s - 0.5

    def home_s(self, agent: int) -> float:
        """When the plan's own landing began [s]; inf: it did not."""
        steps = enumerate(self.route(agent).steps, 1)
        home = (k for k, step in steps if step.goes_down)
        return min((self.step_start(agent, k) for k in home), default=math.inf)


def _in_true_time(said: list[AgentStatus], ahead_s: float, drift: float) -> list[AgentStatus]:
    """Statuses by a clock that is so far ahead, by the clock of the truth."""

    def true(own_s: float) -> float:
        return (own_s - ahead_s) / (1.0 + drift)

    return [
        replace(
            status,
            time_s=true(status.time_s),
            left=status.left and replace(status.left, time_s=true(status.left.time_s)),
            steps=tuple(
                replace(
                    step,
                    start_s=true(step.start_s),
                    end_s=None if step.end_s is None else true(step.end_s),
                )
                for step in status.steps
            ),
        )
        for status in said
    ]


def _grave(name: str, value: float) -> bool:
    """A parameter with which a vehicle is no longer where it says, or no longer does as told."""
    if name.startswith("SIM_WIND") or name in ("SIM_GPS_ACC", "SIM_GPS_SATS", "SIM_BATT_DRAIN"):
        return False
    if name in ("SIM_GPS_NOISE", "SIM_GPS_DRIFT"):
        return value > _NOISE_M
    if name == "SIM_VEL_NOISE":
        return value > _VELOCITY_MPS
    if name == "SIM_DELAY":
        return value > 0.05
    if name == "SIM_LOSS":
        return value > 5.0
    return value != 0.0
