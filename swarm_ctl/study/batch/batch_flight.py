"""Flies a batch: draws what is random, and reads what the flight of its missions (`flight.py`) has
found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Final, Self, TypeAlias

import numpy as np

from swarm_ctl.core.kernel.law import STATUSES
from swarm_ctl.core.kernel.receiver import Known
from swarm_ctl.core.law.formation_law import FormationLaw
from swarm_ctl.core.model.arrays import Bools, Floats, Indices, Ints, complex_of
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.law_loader import LawError, own_law_of
from swarm_ctl.study.batch import flight
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.compiled import compiled, interpreted
from swarm_ctl.study.batch.missions import DRAWN, Missions, Setup, missions_of, setup_of
from swarm_sim.physics import response as firmware
from swarm_sim.physics.kinematics import Demands, MotionState, VelocityResponse, advance

_PAIRS: Final = 8000
"""Of agents in missions that are in memory together: what a core's own cache holds."""
_COMPACT: Final = 0.75
"""Vehicles of missions that are over are left out once no more than this share is left."""

TickObserver: TypeAlias = Callable[[float, Indices, Floats, Floats], None]
"""Called every tick with the time, the places in the batch that are still flown, their positions
(2, n, m), and what the law makes of their pairs (m, n, n, 6) (`missions.Missions.seen_pairs`)."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchResult:
    """How each mission of a batch went; all (m,) unless they say more. Lengths in units."""

    smallest: Floats
    """Smallest true distance of any two live agents, between ticks too: each flies straight from
    one to the next."""
    smallest_silent: Floats
    """Smallest true distance of a live agent to the vehicle of a silent one; infinity without
    one."""
    converged: Bools
    time_s: Floats
    """When the formation stood (before settling); at the limit where it did not."""
    error: Floats
    """Largest |e_i - mean e| at the end."""
    links: Ints
    links_broken: Ints
    """Links of the start graph that ever got longer than r."""
    kept_broken: Ints
    """Of those, the ones between live agents while their slots were within 0.9 r."""
    longest_link: Floats
    stuck: Bools
    """A dead-lock: not formed at the end, and all commands within 0.05 m/s of their mean for the
    last 20 s."""
    touched: Floats
    """Share of agent-ticks in which the safety filter changed the wish; 0 without one."""
    yielded: Ints
    """Agent-ticks in which keep-outs excluded each other."""
    exchanges: Ints
    parted: Bools
    """The links that were within r did not hang together at some look (every `_CHECK` ticks)."""
    statuses: Ints
    """Pair-ticks by sigma status (4, m), each agent's view of a pair counted."""
    small_gap: Ints
    """Pair-ticks with D_ub - D_lb <= 2, which the paper takes for impossible."""
    steps: Ints
    """Ticks flown."""
    smallest_zone: Floats
    """Smallest true distance of a live agent to a trunk, under 0 inside; infinity without one."""
    over_shortest: Floats
    """`time_s` over what the file needs at the top speed alone; 0 without a wood."""

    @classmethod
    def blank(cls, m: int) -> Self:
        """For m missions, nothing flown yet."""
        types = {"Floats": np.float64, "Ints": np.int64, "Bools": np.bool_}
        shapes = {"statuses": (len(STATUSES), m)}
        return cls(*(np.zeros(shapes.get(f.name, (m,)), types[str(f.type)]) for f in fields(cls)))

    def only(self, missions: slice) -> Self:
        """Of some of the missions."""
        return type(self)(*(getattr(self, f.name)[..., missions] for f in fields(self)))


def fly(batch: Batch, observer: TickObserver | None = None) -> BatchResult:
    """Fly all missions of a batch to their ends."""
    setup, result = setup_of(batch, seen=observer is not None), BatchResult.blank(len(batch))
    own_law = own_law_of(batch.cell.law)
    called = own_law if own_law is not None and interpreted(own_law) else None
    by_ticks = observer is not None or called is not None or batch.cell.vehicle in AUTOPILOT_KINDS
    together = len(batch) if by_ticks else max(1, _PAIRS // batch.cell.n**2)
    for first in range(0, len(batch), together):
        place = np.arange(first, min(first + together, len(batch)))
        flight = MissionsFlight(batch.only(place), setup, own_law)
        if by_ticks:
            flight.fly_by_ticks(observer, called)
        else:
            flight.fly()
        flight.tell(result, place)
    return result


class MissionsFlight:
    """Missions in the air."""

    def __init__(self, batch: Batch, setup: Setup, own_law: FormationLaw | None = None) -> None:
        self._setup, tick_s, self._law = setup, batch.cell.tick_s, own_law
        called = own_law is not None and interpreted(own_law)
        self._ahead = compiled(None if called else own_law)
        late_s = batch.delay_s + (batch.jitter_s if setup.jitters else 0.0)
        dead_s = batch.true_dead_time_s if batch.cell.vehicle == "lag" else batch.late_s.clip(0.0)
        late_ticks = int(np.rint(dead_s.max() / tick_s))
        delay_ticks = int(np.rint(late_s.max() / tick_s))
        self.many = missions_of(batch, setup, delay_ticks, late_ticks, interpreted=called)
        self.motion = None
        if batch.cell.vehicle in AUTOPILOT_KINDS:
            self.motion = FirmwareMotion(batch, late_ticks)
        woods = [wood for wood in batch.woods if wood is not None]
        self._shortest_s = np.array([wood.shortest_s for wood in woods])
        self._losses = _generators(batch, 0) if setup.loses else []
        self._jitter = _generators(batch, 1) if setup.jitters else []
        self._ahead(setup, self.many, 0, 1, flight.BEGIN)

    @property
    def flying(self) -> Bools:
        """Which missions are not over, (m,)."""
        found: Bools = ~self.many.whole["done"]
        return found

    def fly(self) -> None:
        """All to their ends, in one call for the ticks between two draws."""
        ahead = self._ahead
        for tick in range(0, self._setup.last + 1, DRAWN):
            flying = self.flying
            if not flying.any():
                break
            self.draw(flying)
            ticks = min(DRAWN, self._setup.last + 1 - tick)
            ahead(self._setup, self.many, tick, ticks, flight.TICK)

    def fly_by_ticks(self, observer: TickObserver | None, called: FormationLaw | None) -> None:
        """The same tick by tick, for what has to be seen, and for a law that is not compiled."""
        setup, many, ahead = self._setup, self.many, self._ahead
        moves = flight.MOVE if self.motion is None else 0
        flying = self.flying
        for tick in range(setup.last + 1):
            if tick % DRAWN == 0:
                self.draw(flying)
            ahead(setup, many, tick, 1, flight.DECIDE)
            if called is not None:
                ahead(setup, many, tick, 1, flight.TELL)
                _decide_own(called, setup, many, np.flatnonzero(flying))
            ahead(setup, many, tick, 1, flight.ACT)
            if observer is not None:
                place = np.flatnonzero(flying)
                points = many.agent["position"][place].T
                seen = np.stack((points.real, points.imag))
                observer(tick * setup.tick_s, place, seen, many.seen_pairs[place])
            if self.motion is not None:
                self.motion.move(many)
            ahead(setup, many, tick, 1, moves | flight.LOOK)
            before, flying = flying, self.flying
            if not flying.any():
                break
            if self.motion is not None and (before != flying).any():
                self.motion.only(flying)

    def draw(self, flying: Bools) -> None:
        """What is lost and late by chance in the next ticks."""
        for generators, drawn in (
            (self._losses, self.many.losses),
            (self._jitter, self.many.jitter),
        ):
            for k, random in enumerate(generators):
                if flying[k]:
                    random.random(out=drawn[k], dtype=np.float32)

    def tell(self, result: BatchResult, place: Indices) -> None:
        """What was found, of the missions at this place of the result."""
        many, whole, r2 = self.many, self.many.whole, self._setup.r**2
        if self._law is not None and whole["broken"].any():
            name = self._law.name
            raise LawError(f"law {name!r} gave numbers that are no velocity; allowed: finite ones")
        result.smallest[place] = np.sqrt(whole["nearest"])
        result.smallest_silent[place] = np.sqrt(whole["nearest_silent"])
        result.converged[place], result.stuck[place] = whole["formed"], whole["stuck"]
        result.time_s[place], result.error[place] = whole["ended_s"], whole["error"]
        farthest, kept = many.link["farthest"], many.link["farthest_kept"]
        if not self._setup.filters:
            kept = np.where(many.link["fits"], farthest, 0.0)
        result.links[place] = whole["links"]
        result.links_broken[place] = np.count_nonzero(farthest > r2, axis=1)
        result.kept_broken[place] = np.count_nonzero(kept > r2, axis=1)
        result.longest_link[place] = np.sqrt(farthest.max(axis=1, initial=0.0))
        result.parted[place] = whole["parted"]
        result.statuses[:, place] = [whole[name] for name in STATUSES]
        result.small_gap[place], result.steps[place] = whole["small_gap"], whole["steps"]
        result.touched[place] = whole["touched"] / np.maximum(whole["flown"], 1)
        result.yielded[place] = whole["yielded"]
        result.exchanges[place] = whole["exchanged"] // 2
        result.smallest_zone[place] = whole["nearest_trunk"]
        if self._setup.wood:
            result.over_shortest[place] = whole["ended_s"] / self._shortest_s


def _decide_own(law: FormationLaw, setup: Setup, many: Missions, flying: Indices) -> None:
    """The terms of an own law that is not compiled, by what `TELL` has told."""
    for k in flying.tolist():
        w, agents = many.whole[k], many.agent[k]
        numbers = law.numbers(*many.numbers[k].tolist())
        for i, count in enumerate(many.told[k].tolist()):
            me = flight.receiver(setup, w, agents[i], i)
            rows = [Known(*each) for each in many.known[k, i, :count][_FIELDS].tolist()]
            memory = many.memory[k, i].tolist()
            consensus, avoidance, _ = law.form(me, rows, numbers, memory, [])
            many.memory[k, i] = memory
            flight.steer(w, agents[i], consensus, avoidance)


_FIELDS: Final = list(Known._fields)


def _generators(batch: Batch, stream: int) -> list[np.random.Generator]:
    """One for each mission, by seed and row: it loses the same states whatever missions it is flown
    beside. Streams do not meet."""
    seed, counter = batch.cell.seed, np.array([0, 0, stream, 0], dtype=np.uint64)
    keys = [np.array([seed, row], dtype=np.uint64) for row in batch.row.tolist()]
    return [np.random.Generator(np.random.Philox(key=key, counter=counter)) for key in keys]


_SUBSTEPS: Final = 4
"""Physics steps a tick: the firmwares' fastest lags are 0.05 s."""


class FirmwareMotion:
    """The vehicles of a batch that have a firmware, (missions, agents), moved by the simulator's
    own kinematics (`swarm_sim.physics`), the one thing that this side imports of it: with others a
    study would prove nothing about runs. Ideal points and vehicles with a plain lag fly in
    `flight.py`."""

    def __init__(self, batch: Batch, late_ticks: int) -> None:
        cell = batch.cell
        self._tick_s = cell.tick_s
        self._response: VelocityResponse = (
            firmware.Px4Response() if cell.vehicle == "px4" else firmware.ArdupilotResponse()
        )
        self._flying = np.arange(len(batch))
        place = np.zeros((len(batch), cell.n, 3))
        place[..., :2] = batch.starts.transpose(2, 1, 0) * cell.unit_m
        place[..., 2] = -10.0
        self._state = MotionState.at_rest(place, self._response)
        self._state.landed[:] = False
        self._state.ground[:] = 0.0
        from_rad = batch.wind_from_rad
        towards = np.stack((np.cos(from_rad), np.sin(from_rad))) * -batch.wind_mps
        self._state.wind[..., :2] = towards.T[:, None]
        self._commands = np.zeros((late_ticks + 1, len(batch), cell.n), dtype=np.complex128)
        """The last ones, newest last [m/s]."""

    def move(self, many: Missions) -> None:
        """Fly one tick, by the newest commands of the missions that are not over; tells places and
        velocities."""
        state, flying = self._state, self._flying
        self._commands[:-1] = self._commands[1:]
        self._commands[-1] = many.agent["command"][flying]
        ago = len(self._commands) - 1 - many.agent["late"][flying]
        acting = np.take_along_axis(self._commands, ago[None], axis=0)[0]
        demands = Demands.idle(state)
        demands.lift[:] = True
        demands.velocity[..., 0], demands.velocity[..., 1] = acting.real, acting.imag
        for _ in range(_SUBSTEPS):
            advance(state, demands, self._response, self._tick_s / _SUBSTEPS)
        many.agent["place_m"][flying] = complex_of(state.position)
        many.agent["velocity_mps"][flying] = complex_of(state.velocity)

    def only(self, flying: Bools) -> None:
        """Go on with those missions of all that still fly."""
        kept = flying[self._flying]
        for name in MotionState.__slots__:
            setattr(self._state, name, getattr(self._state, name)[kept])
        self._commands = np.ascontiguousarray(self._commands[:, kept])
        self._flying = self._flying[kept]
