"""The missions of a batch in the air: what is the same for all of them, and the arrays of each.

Indices of pairs are (receiver, sender). A horizontal vector is north + 1j * east. Lengths in units,
times in ticks, unless a name says more.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.control.in_file import GAP
from swarm_ctl.core.kernel.boundary import KEPT_S, LOOK_S, Boundary, boundary_of
from swarm_ctl.core.kernel.constraints import Margins, margins_of
from swarm_ctl.core.kernel.exchange import EVERY_S, NO_PART, ranks
from swarm_ctl.core.kernel.response import ResponseModel, model_of, unknown
from swarm_ctl.core.kernel.walls import NO_WALL_MARGINS, WallMargins, wall_margins_of
from swarm_ctl.core.kernel.wish import NO_RELEASE, SWIRL_OFF
from swarm_ctl.core.model.arrays import Bools, Complex, Floats, Ints, complex_of
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import Compensation, LawParameters, Policies
from swarm_ctl.core.model.timeouts import FAR_EVERY_S, NEIGHBOUR_S, lead_s
from swarm_ctl.core.swarm.hearing import SMALL_SWARM
from swarm_ctl.core.swarm.plausibility import JUMP_M
from swarm_ctl.law_loader import law_of
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.woods import clearance_m
from swarm_ctl.study.parameter_space import Cell

DRAWN: Final = 32
"""Ticks whose random numbers are drawn at once."""
LOOKS: Final = 64
"""Rounds of the exchange that are remembered: no news is older, but that of silent agents, which
have changed nothing since."""
NEVER: Final = 1 << 60
BEFORE: Final = -(1 << 40)
"""A tick long before the start."""
SAID: Final = 8
"""Numbers that an agent says of its exchanges."""


class Setup(NamedTuple):
    """What is the same for all missions of a batch."""

    tick_s: float
    unit_m: float
    last: int
    """No mission takes more ticks."""
    filters: bool
    """What the cell has, each with all before it."""
    guards: bool
    releases: bool
    aligns: bool
    exchanges: bool
    ideal: bool
    """Vehicles that fly what they are told, at once."""
    plain: bool
    """The law is fed with positions."""
    own_law: bool
    own_reach: float
    """Of the own law."""
    seen: bool
    """What the law makes of pairs is looked at."""
    model: ResponseModel
    margins: Margins
    r: float
    r_out: float
    r_in: float
    delta_l: float
    delta_a: float
    swirl_off: float
    speed_mps: float
    blind: float
    """For so long the vehicle of a silent agent flies its last command."""
    tolerance: float
    settle_s: float
    loses: bool
    jitters: bool
    far: bool
    """Some peers are far (`core.kernel.boundary`)."""
    boundary: Boundary
    look: int
    word: int
    kept: int
    late: int
    round: int
    """Between two rounds of the exchange."""
    wood: bool
    """Missions fly through woods."""
    walls: WallMargins
    gap_m: float
    """From one to the next in file."""


def _records(**kinds: str) -> np.dtype[Any]:
    fields = [(name, kind) for kind, names in kinds.items() for name in names.split()]
    return np.dtype((np.record, np.dtype(fields, align=True)))


WHOLE: Final = _records(
    f8="h kappa lead_s loss stays begins jitter nearest nearest_silent since_s moved_s ended_s"
    " error nearest_trunk opens_m",
    c16="goal",
    i8="links flown touched yielded small_gap exchanged steps paper narrow inactive overspeed",
    b1="heard done formed stuck parted broken",
)
"""One mission. `stays`, `begins`: chances of a burst of losses; `nearest`, `nearest_silent`:
squared; `nearest_trunk`: distance of a live agent to one; `opens_m`: from here on the way through
the wood is open; `flown`: agent-ticks; `paper` and those behind it: pair-ticks by status; `heard`:
there was a tick before; `done`: it is over; `broken`: an own law gave what is no velocity."""
AGENT: Final = _records(
    # vehicles in metres; positions, points, slots and what is flown in units
    c16="place_m velocity_mps command position seen point slot consensus avoidance wish side"
    " model_place model_velocity slow_velocity behind slow_behind",
    # the last line is the estimate of the own response, the one before the dead-lock release
    f8="exact_delay silent_from share bound_mps2 wanted got left_s late_s doubt_s moved agreed",
    i8="delay late fails sent",
    b1="begun",
)
"""What is known of one agent. `position`: now; `seen`: at the last tick; `point`: its stop point;
`command`: the newest [m/s]; `share`: of a difference in velocity that its vehicle makes up in a
tick, over the tick [1/s]; `delay`: of what it says; `late`: of its commands."""
PAIR: Final = _records(
    c16="told flies slot passes",
    i8="sent_at near_at heard_from passed",
    b1="link lost rare near always",
)
"""What a receiver knows of a sender: point, command and slot as they were told, the tick they were
sent in. `link`: of the start graph; `lost`: in the tick before; `rare`: it was a far word."""
LINK: Final = _records(f8="farthest farthest_kept", i8="first second", b1="fits held")
"""A link of the start graph, its lower agent first. `farthest`: squared; `fits`: its slots are
within r; `held`: it has been as short as they are."""


KNOWN: Final = _records(c16="at slot flies", f8="age_s", i8="id", b1="neighbour lower")
"""`receiver.Known`."""
TRUNK: Final = _records(c16="at", f8="radius")
"""A round zone."""


class Missions(NamedTuple):
    """The arrays of m missions of n agents."""

    whole: NDArray[Any]
    """`WHOLE` (m,)."""
    agent: NDArray[Any]
    """`AGENT` (m, n)."""
    pair: NDArray[Any]
    """`PAIR` (m, n, n)."""
    link: NDArray[Any]
    """`LINK` (m, most links of one)."""
    commands: Complex
    """A ring (m, n, ticks) [m/s]."""
    sent: Complex
    """A ring of setpoints (m, n, remembered) [m/s]."""
    past: Complex
    """(m, ticks, 2, n): points and commands, a ring."""
    losses: NDArray[np.float32]
    """Drawn (m, DRAWN, n, n), as the next."""
    jitter: NDArray[np.float32]
    newest: Ints
    """By the tick of arrival, a ring (m, ticks, n, n)."""
    roles: Complex
    """Slots by role (m, n)."""
    links: Bools
    """Of the start graph (m, n, n)."""
    rank: Ints
    """Of locks (n,)."""
    said: Ints
    """(m, n, SAID)."""
    part: Floats
    """(m, n, 4)."""
    history: Ints
    """(m, LOOKS, n, SAID), a ring."""
    seen_pairs: Floats
    """(m, n, n, 6), where they are looked at: distance (0: not near), sigma, sigma_lb, D,
    D_ub - D_lb, status."""
    memory: Floats
    """The own law's (m, n, numbers that it remembers)."""
    numbers: Floats
    """The own law's, the same in each mission (m, their count)."""
    known: NDArray[Any]
    """`KNOWN` (m, n, n): what an own law that is not compiled is told."""
    told: Ints
    """(m, n): so many of them."""
    trunk: NDArray[Any]
    """`TRUNK` (m, most trunks of one); behind the last one of radius -infinity."""
    way_m: Complex
    """(m, most corners of one); the last one again and again."""
    ends_m: Floats
    """How far along it each corner is, as many."""
    ranks: Ints
    """In file, the front agent first (m, n)."""
    along_m: Floats
    """(m, n, n): where the first takes the second to be on the way."""


def setup_of(batch: Batch, *, seen: bool = False) -> Setup:
    """What all missions of the batch have in common; `seen`: pairs are looked at."""
    cell, law = batch.cell, batch.cell.law
    own = law_of(law)
    n, tick_s, unit_m = cell.n, cell.tick_s, cell.unit_m
    margins = margins_of(law, cell.model, cell.speed_mps, unit_m)
    reach_m = max(margins.farthest, (law.r_out + SWIRL_OFF) * unit_m)
    silent_s = Policies().agent_lost_after_s
    told_late = any(each.high > 0 for each in (cell.delay_s, cell.jitter_s, cell.loss, cell.silent))
    blind_s = AUTOPILOT_KINDS.get(cell.vehicle, AUTOPILOT_KINDS["ardupilot"]).setpoint_timeout_s
    return Setup(
        tick_s=tick_s,
        unit_m=unit_m,
        last=round(cell.limit_s / tick_s),
        filters=cell.has("filter"),
        guards=cell.has("guard"),
        releases=cell.has("release"),
        aligns=cell.has("align"),
        exchanges=cell.has("exchange"),
        ideal=cell.vehicle == "ideal",
        plain=cell.compensation is Compensation.NONE,
        own_law=bool(law.own),
        own_reach=own.reach(own.numbers(*numbers_of(law))) if law.own else 0.0,
        seen=seen,
        model=model_of(cell.model, tick_s),
        margins=margins_of(law, cell.model, cell.speed_mps, unit_m, unit_m),
        r=law.r,
        r_out=law.r_out,
        r_in=law.r_in,
        delta_l=law.delta_l,
        delta_a=law.delta_a,
        swirl_off=law.r_out + SWIRL_OFF,
        speed_mps=cell.speed_mps,
        blind=blind_s / tick_s,
        tolerance=cell.tolerance,
        settle_s=cell.settle_s,
        loses=bool(batch.loss.any()),
        jitters=bool(batch.jitter_s.any()),
        # without filter and average only links and what is within r_out count: near peers
        far=n > SMALL_SWARM and (told_late or cell.has("filter")),
        boundary=boundary_of(reach_m, JUMP_M, cell.speed_mps, tick_s, silent_s),
        look=max(1, round(LOOK_S / tick_s)),
        word=max(1, round(FAR_EVERY_S / tick_s)),
        kept=round(KEPT_S / tick_s),
        late=round(NEIGHBOUR_S / tick_s),
        round=max(1, round(EVERY_S / tick_s)),
        wood=cell.wood != "none",
        walls=_walls_of(cell),
        gap_m=GAP * law.r_out * unit_m,
    )


def _walls_of(cell: Cell) -> WallMargins:
    if cell.wood == "none":
        return NO_WALL_MARGINS
    return wall_margins_of(clearance_m(cell), cell.model, cell.speed_mps, cell.unit_m)


def numbers_of(law: LawParameters) -> list[float]:
    """Of the own law, in its order."""
    return [each.value for each in law.parameters]


def missions_of(
    batch: Batch, s: Setup, delay_ticks: int, late_ticks: int, *, interpreted: bool = False
) -> Missions:
    """The arrays of all missions, at the start; `interpreted`: an own law that is not compiled is
    told of others by them."""
    cell, (_, n, m) = batch.cell, batch.starts.shape
    tick_s = cell.tick_s

    def zeros(kind: type, *shape: int) -> Any:
        return np.zeros((m, *shape), dtype=kind)

    starts, slots = (
        np.ascontiguousarray(complex_of(each.transpose(2, 1, 0)))
        for each in (batch.starts, batch.slots)
    )
    whole = np.zeros(m, dtype=WHOLE)
    stays = np.maximum(1.0 - tick_s / np.maximum(batch.burst_s, tick_s), batch.loss)
    whole["h"], whole["kappa"] = batch.flown_h, batch.kappa
    whole["lead_s"] = lead_s(batch.kappa * batch.flown_h, np.minimum)
    whole["loss"], whole["stays"] = batch.loss, stays
    whole["begins"] = batch.loss * (1.0 - stays) / (1.0 - batch.loss)
    whole["jitter"] = batch.jitter_s / tick_s
    for name in ("nearest", "nearest_silent", "since_s", "nearest_trunk"):
        whole[name] = np.inf
    dead_s = batch.true_dead_time_s if cell.vehicle == "lag" else batch.late_s.clip(0.0)
    lag_s = np.maximum(batch.true_lag_s, 1e-6)
    agent, pair = np.zeros((m, n), dtype=AGENT), np.zeros((m, n, n), dtype=PAIR)
    for name, values in (
        ("place_m", starts * cell.unit_m),
        ("position", starts),
        ("seen", starts),
        ("point", starts),
        ("slot", slots),
        ("side", NO_RELEASE.side),
        ("delay", np.rint(batch.delay_s / tick_s).T),
        ("exact_delay", (batch.delay_s / tick_s).T),
        ("silent_from", batch.silent_from(tick_s).T),
        ("share", (-np.expm1(-tick_s / lag_s) / tick_s).T),
        ("bound_mps2", batch.acceleration_mps2.T),
        ("late", np.rint(dead_s / tick_s).T),
        ("doubt_s", unknown(s.model).doubt_s),
    ):
        agent[name] = values
    links = np.ascontiguousarray(batch.links.transpose(2, 0, 1))
    pair["told"], pair["slot"] = starts[:, None], slots[:, None]
    pair["near_at"], pair["heard_from"] = BEFORE, NEVER
    pair["link"] = pair["always"] = links
    past = zeros(complex, delay_ticks + 1, 2, n)
    past[:, :, 0] = starts[:, None]
    said = np.full((m, n, SAID), -1)
    said[..., 0], said[..., 1] = np.arange(n), 0
    part = zeros(float, n, 4)
    part[:] = NO_PART
    heard_each = n if s.jitters else 0
    return Missions(
        whole=whole,
        agent=agent,
        pair=pair,
        link=_links(links, whole),
        commands=zeros(complex, n, late_ticks + 1),
        sent=zeros(complex, n, s.model.remembered),
        past=past,
        losses=np.zeros((m, DRAWN if s.loses else 0, n, n), dtype=np.float32),
        jitter=np.zeros((m, DRAWN if s.jitters else 0, n, n), dtype=np.float32),
        newest=np.full((m, delay_ticks + 1, heard_each, heard_each), -1),
        roles=slots,
        links=links,
        rank=np.array(ranks(n)),
        said=said,
        part=part,
        history=np.repeat(said[:, None], LOOKS if s.exchanges else 0, axis=1),
        seen_pairs=zeros(float, *((n, n) if s.seen else (0, 0)), 6),
        memory=zeros(float, n, law_of(cell.law).memory),
        numbers=np.tile(np.array(numbers_of(cell.law), dtype=np.float64), (m, 1)),
        known=np.zeros((m, *((n, n) if interpreted else (0, 0))), dtype=KNOWN),
        told=np.zeros((m, n), dtype=np.int64),
        **_woods(batch, whole),
    )


def _woods(batch: Batch, whole: NDArray[Any]) -> dict[str, Any]:
    """The arrays of the woods, and into `whole` where they end."""
    n, m = batch.starts.shape[1:]
    woods = [wood for wood in batch.woods if wood is not None]
    many, flies = len(woods), n if woods else 0
    trunk = np.zeros((m, max((len(wood.at) for wood in woods), default=0)), dtype=TRUNK)
    trunk["radius"] = -np.inf
    corners = max((len(wood.way_m) for wood in woods), default=0)
    way_m, ends_m = np.zeros((m, corners), dtype=complex), np.zeros((m, corners))
    ranks, along_m = np.zeros((m, flies), dtype=np.int64), np.zeros((m, flies, flies))
    for k in range(many):
        wood = woods[k]
        trunk["at"][k, : len(wood.at)], trunk["radius"][k, : len(wood.at)] = wood.at, wood.radius
        way_m[k], ends_m[k] = wood.way_m[-1], wood.ends_m[-1]
        way_m[k, : len(wood.way_m)], ends_m[k, : len(wood.way_m)] = wood.way_m, wood.ends_m
        ranks[k], along_m[k] = wood.ranks, wood.along_m
        whole["goal"][k], whole["opens_m"][k] = wood.goal, wood.opens_m
    return {"trunk": trunk, "way_m": way_m, "ends_m": ends_m, "ranks": ranks, "along_m": along_m}


def _links(links: Bools, whole: NDArray[Any]) -> NDArray[Any]:
    """The list of each mission's links, and into `whole` how many there are."""
    mission, first, second = np.nonzero(np.triu(links))
    count = np.bincount(mission, minlength=len(links))
    whole["links"] = count
    found = np.zeros((len(links), int(count.max(initial=0))), dtype=LINK)
    place = np.arange(len(mission)) - np.repeat(np.cumsum(count) - count, count)
    found["first"][mission, place], found["second"][mission, place] = first, second
    return found
