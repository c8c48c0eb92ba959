"""A run folder, read once, for summary, report and figures."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.agent.agent import STATUS_EVERY_S
from swarm_ctl.core.model.messages import AgentStatus, StepOutcome
from swarm_ctl.core.model.plan import GroupPlan, Plan
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.in_plan import InPlan
from swarm_ctl.errors import InputError
from swarm_ctl.recording.mcap_reader import RECORDING
from swarm_ctl.recording.mcap_records import RecordingDamage
from swarm_ctl.runfolder.flight import Flight, flight_of
from swarm_ctl.runfolder.last_statuses import LastStatus, read_last_statuses, read_statuses
from swarm_ctl.runfolder.manifest import Manifest, read_manifest
from swarm_ctl.runfolder.tracks import Track, read_tracks
from swarm_ctl.runfolder.truth import TRUTH, Floats, Truth, load_truth


@dataclass(frozen=True, slots=True, eq=False)
class FlownGroup:
    """What became of one group of the plan."""

    plan: GroupPlan
    columns: list[int]
    """Of its agents in the run's flight."""
    last: dict[int, LastStatus]

    @property
    def form_steps(self) -> list[int]:
        """The numbers of its form steps."""
        steps = zip(self.plan.numbers, self.plan.steps, strict=True)
        return [k for k, step in steps if step.new_shape is not None]

    @property
    def begun(self) -> list[int]:
        """The numbers of the steps that an agent of it began."""
        return [k for k in self.plan.told_steps if math.isfinite(self.start_s(k))]

    def slot_indices(self, time_s: Floats) -> npt.NDArray[np.intp]:
        """The slot index of each of its agents at each moment, (T, n); exchanges change it."""
        found = np.tile(np.arange(len(self.plan.ids)), (len(time_s), 1))
        begins_s = self.start_s(self.plan.before + 1) if self.plan.before else -math.inf
        for k, agent in enumerate(self.plan.ids):
            for since_s, index in self.last[agent].status.roles if agent in self.last else ():
                if 0 <= index < len(self.plan.ids) and since_s >= begins_s:
                    found[time_s >= since_s, k] = index
        return found

    def slots(self, form: FormStep, since_s: float, time_s: Floats) -> Floats:
        """The slot of each of its agents at each moment, in the shape that has been flown since
        then, (T, n, 2) [units]: exchanges change it, and gaps that close."""
        whole = np.array(form.slots)[self.slot_indices(time_s)]
        found = whole.copy()
        for k, agent in enumerate(self.plan.ids):
            told = self.last[agent].status.closings if agent in self.last else ()
            for at_s, fewer, place in told:
                later = time_s >= at_s
                if at_s >= since_s and 0 < fewer <= len(form.closed):
                    smaller = form.closed[fewer - 1]
                    found[later, k] = smaller[place] if 0 <= place < len(smaller) else np.nan
                elif at_s >= since_s:
                    found[later, k] = whole[later, k]
        return found

    def start_s(self, k: int) -> float:
        """When the first of its agents began step k; inf: none did.

        A process that took a vehicle over has not seen the beginning, and has its own clock.
        """
        whole = [last for last in self.last.values() if not last.successor]
        found = (last.step(k) for last in whole or self.last.values())
        return min((result.start_s for result in found if result), default=math.inf)

    def newest_formation(self, unit_m: float) -> PlannedFormation:
        """As planned for the last of its steps that began."""
        reached = max((k - self.plan.before for k in self.begun), default=0)
        return self.plan.formations(unit_m)[max(0, reached)]

    def ends_s(self) -> float:
        """When its landing began, or its agents went on in another group; inf: unknown."""
        return min(self.landing_s(), self.start_s(self.plan.last + 1))

    def landing_s(self) -> float:
        """When its landing began, by plan or because an agent of the formation broke its step off;
        inf: unknown."""
        steps = zip(self.plan.numbers, self.plan.steps, strict=True)
        planned = (self.start_s(k) for k, step in steps if step.goes_down)
        broken = (
            result.end_s
            for status in (last.status for last in self.last.values())
            for result in (status.steps[-1:] if status.left is None else ())
            if result.result in (StepOutcome.ABORTED, StepOutcome.TIMEOUT)
            and result.end_s is not None
        )
        return min([*planned, *broken], default=math.inf)


class ZoneSpell(NamedTuple):
    """A zone while it was in force [mission s]."""

    zone: Zone
    from_s: float
    """-inf: it is of the mission."""
    until_s: float
    """inf: to the end."""


def zone_spells(plan: Plan, statuses: Iterable[AgentStatus]) -> tuple[ZoneSpell, ...]:
    """All zones of a flight, the mission's own first, by what agents say twice a second: one begins
    when more than half of those that speak name it, and ends when more than half do not. It was
    surely in force then: an end counts as early as it may have been.

    So neither a lost word, nor an agent that was started again and knows the plan alone, nor one
    whose clock is off, begins or ends a zone of many.
    """
    words = sorted(_words_on_zones(plan, statuses), key=lambda word: word[0])
    said, begun = dict[int, tuple[Zone, ...]](), dict.fromkeys(plan.zones, -math.inf)
    over = list[ZoneSpell]()
    for time_s, agent, zones in words:
        if zones is not None:
            said[agent] = zones
        elif len(said) > 1:
            del said[agent]
        names = Counter(itertools.chain.from_iterable(said.values()))
        for zone in [zone for zone in begun if 2 * names[zone] < len(said)]:
            from_s = begun.pop(zone)
            over.append(ZoneSpell(zone, from_s, max(from_s, time_s - STATUS_EVERY_S)))
        for zone in [zone for zone, count in names.items() if 2 * count > len(said)]:
            begun.setdefault(zone, time_s)
    last = (ZoneSpell(zone, from_s, math.inf) for zone, from_s in begun.items())
    return tuple(sorted((*over, *last), key=lambda spell: spell.from_s))


def _words_on_zones(
    plan: Plan, statuses: Iterable[AgentStatus]
) -> Iterator[tuple[float, int, tuple[Zone, ...] | None]]:
    """(time, agent, zones) where an agent first names these; None: with its last word."""
    of = dict[int, list[AgentStatus]]()
    for status in statuses:
        of.setdefault(status.agent, []).append(status)
    for agent, own in of.items():
        own.sort(key=lambda status: status.time_s)
        known: tuple[Zone, ...] | None = None
        for status in own:
            zones = plan.zones if status.zones is None else status.zones
            if zones != known:
                yield status.time_s, agent, zones
            known = zones
        yield own[-1].time_s, agent, None


@dataclass(frozen=True, slots=True, eq=False)
class RunFolder:
    """What the folder has; `notes` says what is missing or torn."""

    manifest: Manifest | None
    truth: Truth | None
    tracks: dict[int, Track]
    """By agent: what the vehicles told of themselves that this run did not simulate."""
    flight: Flight | None
    """One column per agent, by the truth or by the vehicles; None: nothing is known of it."""
    agents: tuple[int, ...]
    """The plan's; without a manifest, those that left a trace."""
    last: dict[int, LastStatus]
    """By agent; without an entry nothing is known of the agent."""
    notes: list[str]
    zones: tuple[ZoneSpell, ...] = ()
    """The mission's, and those that were added in flight."""

    @property
    def plan(self) -> Plan | None:
        """The manifest's."""
        return self.manifest.plan if self.manifest else None

    @property
    def statuses(self) -> list[AgentStatus]:
        """The last one of each agent."""
        return [last.status for last in self.last.values()]

    @property
    def groups(self) -> list[FlownGroup]:
        """Those of the plan; none without a manifest."""
        column = {agent: k for k, agent in enumerate(self.agents)}
        return [
            FlownGroup(
                group,
                [column[i] for i in group.ids],
                {i: self.last[i] for i in group.ids if i in self.last},
            )
            for group in (self.plan.groups if self.plan else ())
        ]

    def landing_s(self) -> float:
        """When the last group's landing began; inf: unknown."""
        return max((group.ends_s() for group in self.groups if group.begun), default=math.inf)


def read_run(folder: Path, killed: Collection[int] = ()) -> RunFolder:
    """Read what there is of manifest, truth, statuses and recording; never raises, `notes` has the
    reasons. `killed`: the agents whose processes were ended by a signal."""
    notes: list[str] = []
    manifest = _manifest(folder, notes)
    truth = _truth(folder, manifest, notes)
    planned = tuple(agent.id for agent in manifest.plan.agents) if manifest else None
    statuses = list(read_statuses(folder, notes))
    last = read_last_statuses(folder, statuses, planned, notes, killed)
    statuses += [each.status for each in last.values() if each.final]
    tracks = _tracks(folder, manifest, notes) if manifest else {}
    flight = flown(truth, tracks, manifest, last) if manifest else None
    return RunFolder(
        manifest=manifest,
        truth=truth,
        tracks=tracks,
        flight=flight,
        agents=planned or tuple(last),
        last=last,
        notes=notes,
        zones=zone_spells(manifest.plan, statuses) if manifest else (),
    )


def _manifest(folder: Path, notes: list[str]) -> Manifest | None:
    try:
        return read_manifest(folder)
    except InputError as error:
        notes.append(str(error))
        return None


def _truth(folder: Path, manifest: Manifest | None, notes: list[str]) -> Truth | None:
    if manifest is not None and not manifest.in_truth:
        return None
    try:
        truth = load_truth(folder / TRUTH)
    except OSError as error:
        notes.append(f"{TRUTH}: {error.strerror}")
        return None
    notes += truth.damage.describe(TRUTH)
    if not truth.complete:
        notes.append(f"{TRUTH}: no end line, the simulator did not finish it")
    if manifest is not None:
        sysid = {agent.id: agent.sysid for agent in manifest.fleet}
        strange = set(truth.sysids) ^ {sysid[i] for i in manifest.in_truth}
        if strange:
            sysids = ", ".join(map(str, sorted(strange)))
            notes.append(f"{TRUTH}: it and the fleet do not agree about sysid {sysids}")
    return truth


def _tracks(folder: Path, manifest: Manifest, notes: list[str]) -> dict[int, Track]:
    """Of the vehicles that this run did not simulate."""
    agents = [agent.id for agent in manifest.plan.agents if agent.id not in manifest.in_truth]
    if not agents:
        return {}
    try:
        damage = RecordingDamage()
        tracks = read_tracks(
            folder,
            agents,
            elsewhere=manifest.elsewhere,
            damage=damage,
            in_plan=InPlan(manifest.plan),
        )
    except InputError as error:
        notes.append(str(error))
        return {}
    notes += damage.describe(RECORDING)
    unheard = [agent for agent in agents if agent not in tracks]
    if unheard:
        notes.append(f"{RECORDING}: no state of {agents_named(unheard)}")
    return tracks


def flown(
    truth: Truth | None, tracks: dict[int, Track], manifest: Manifest, last: dict[int, LastStatus]
) -> Flight | None:
    """Where the vehicles of the manifest's plan were; None where nothing is known of them."""
    agents = [agent.id for agent in manifest.plan.agents]
    sysid = {agent.id: agent.sysid for agent in manifest.fleet}
    until_s = [_live_until(last.get(i), manifest.plan) for i in agents]
    places = {k: tracks[agent] for k, agent in enumerate(agents) if agent in tracks}
    flight = flight_of(truth, [sysid[i] for i in agents], until_s, places)
    return flight if len(flight.time_s) else None


def _live_until(last: LastStatus | None, plan: Plan) -> float:
    """An agent without a final status lives until its peers count it as lost, one that left by an
    operator's order until then."""
    if last is None:
        return -math.inf
    if last.status.left is not None:
        return last.status.left.time_s
    return math.inf if last.final else last.status.time_s + plan.policies.agent_lost_after_s
