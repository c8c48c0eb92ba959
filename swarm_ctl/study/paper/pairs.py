"""The paper's claims on each pair inside r_out: sigma, inequality (30), conclusion 5.

Missions start close together, from 1.02 r_in apart, so that pairs are seen at all distances.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from rich.table import Table

from swarm_ctl.core.kernel.law import NARROW, Law, cut_off
from swarm_ctl.core.model.arrays import Bools, Floats, Indices
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.study.batch.batch import draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.paper.claims import holds
from swarm_ctl.study.parameter_space import Study, value
from swarm_ctl.study.rows_table import share

MISSIONS: Final = 200
_AREA: Final = 5.0
"""Side of the square of the starts [units]: a half and a quarter of the experiments'."""
_FEWEST: Final = 30
"""Pair-steps in a third of the avoidance region, for its median to count."""
_DRAWN: Final = 50000


class Samples(NamedTuple):
    """Pair-steps, each agent's view of a pair counted; (K,) each. Lengths in units."""

    distance: Floats
    sigma: Floats
    sigma_lb: Floats
    tuned: Floats
    """1 where D has a value by (66) or the program's rule for a narrow range."""
    displacement: Floats
    """|u_i| of the agent that looks."""
    bound: Floats
    """r / D - d_ic of (30), with the D that the law chose; D = 2 where it leaves D undefined."""
    laxest: Floats
    """The same with D = 2: (30) asks for D > 2."""
    mission: Floats


@dataclass(slots=True)
class PairSteps:
    """Takes in the pairs of each iteration of (9) and what the agents then did; a
    `TickObserver`."""

    law: LawParameters
    parts: list[Floats] = field(default_factory=list)
    _before: tuple[Indices, Floats, Floats] | None = None

    def __call__(self, time_s: float, place: Indices, position: Floats, pairs: Floats) -> None:
        """Take an iteration in."""
        del time_s
        if self._before is not None:
            self.parts.append(self._seen(*self._before, place, position))
        self._before = (place, position, pairs)

    def _seen(
        self, place: Indices, was: Floats, pairs: Floats, now_place: Indices, now: Floats
    ) -> Floats:
        """The last iteration's pairs in the missions that still fly: rows as in `Samples`."""
        kept = np.isin(place, now_place)
        moved = np.full(was.shape[1:], np.nan)
        moved[:, kept] = np.sqrt(((now - was[..., kept]) ** 2).sum(axis=0))
        mission, agent, other = np.nonzero(pairs[..., 0] > 0.0)
        x, sigma, sigma_lb, d, _, status = pairs[mission, agent, other].T
        columns = (
            x,
            sigma,
            sigma_lb,
            status <= NARROW,
            moved[agent, mission],
            self.law.r / np.where(np.isnan(d), 2.0, d) - x / 2,
            self.law.r / 2.0 - x / 2,
            place[mission],
        )
        return np.stack([np.asarray(column, dtype=np.float64) for column in columns])[
            :, kept[mission]
        ]

    def samples(self) -> Samples:
        """All pair-steps so far."""
        return Samples(*np.concatenate([np.zeros((len(Samples._fields), 0)), *self.parts], axis=1))


def pairs_table(studies: Mapping[str, Study], folder: Path) -> Table:
    """The three claims for each experiment in its discrete form, with a figure of sigma."""
    from swarm_ctl.study.mission_figures import sigma_against_distance

    title = (
        f"Claims on pairs: discrete form, random slots, random starts from 1.02 r_in apart in a"
        f" square of {_AREA:g} units, at most {MISSIONS} missions each"
    )
    table = Table("experiment", "claim", "pair-steps", "measured", "holds", title=title)
    drawn, radii = [], []
    for name, study in studies.items():
        if not name.endswith("discrete"):
            continue
        seen, law = _flown(study), study.law
        what = f"n = {study.n[0]}"
        tuned = seen.tuned > 0
        points = np.stack((seen.distance, seen.sigma), axis=-1)[tuned]
        for claim, (steps, measured, word) in (
            ("sigma is small where the distance is small", _sigma(points, law)),
            ("|u_i| < r / D - d_ic, (30)", _inequality(seen)),
            ("sigma is inversely proportional to the root, conclusion 5", _root(seen, tuned, law)),
        ):
            table.add_row(what, claim, str(steps), measured, word)
            what = ""
        drawn.append((f"n = {study.n[0]}", points[:: max(1, len(points) // _DRAWN)]))
        radii.append((law.r_in, law.r_out))
    sigma_against_distance(drawn, radii, folder, "sigma-against-distance")
    return table


def _flown(study: Study) -> Samples:
    close = {"start": ("random",), "area": value(_AREA), "start_spacing": 1.02 * study.law.r_in}
    (cell,) = study.model_copy(update=close | {"slots": ("random",)}).cells()
    steps = PairSteps(cell.law)
    fly(draw(cell, 0, min(MISSIONS, study.missions)), steps)
    return steps.samples()


def _sigma(points: Floats, law: LawParameters) -> tuple[int, str, str]:
    """Holds where the median rises from third to third of the way from r_in to r_out."""
    from scipy.stats import spearmanr

    third = np.clip((points[:, 0] - law.r_in) / (law.r_out - law.r_in) * 3, 0, 2.999).astype(int)
    inside = [points[third == k, 1] for k in range(3)]
    texts = [f"{np.median(s):.3g} of {len(s)}" if len(s) else "none" for s in inside]
    text = f"median in the inner, middle, outer third: {', '.join(texts)}"
    if min(len(s) for s in inside) < _FEWEST:
        return len(points), text, "not tested"
    rank = float(spearmanr(points[:, 0], points[:, 1]).statistic)
    medians = [float(np.median(s)) for s in inside]
    rises = "not broken" if medians == sorted(medians) else "no"
    return len(points), f"{text}; rank correlation over all {rank:+.2f}", rises


def _inequality(seen: Samples) -> tuple[int, str, str]:
    over, lax = seen.displacement >= seen.bound, seen.displacement >= seen.laxest
    tested, broken, badly = (len(np.unique(seen.mission[w])) for w in (over | True, over, lax))
    if not tested:
        return 0, "-", "not tested"
    text = (
        f"broken in {broken} of {tested} missions, {share(broken, tested)}, in"
        f" {100 * over.mean():.3g} % of pair-steps; with D = 2, the laxest that it allows:"
        f" {badly} missions, {share(badly, tested)}, {100 * lax.mean():.3g} %"
    )
    return len(over), text, holds(broken, tested)


def _root(seen: Samples, tuned: Bools, law: LawParameters) -> tuple[int, str, str]:
    """By (52) sigma_lb = g / alpha_ub - x^2. Inversely proportional: the product of the two is the
    same everywhere."""
    chosen = tuned & (seen.sigma_lb > 0)
    if np.count_nonzero(chosen) < _FEWEST:
        return int(np.count_nonzero(chosen)), "-", "not tested"
    x, sigma = seen.distance[chosen], seen.sigma_lb[chosen]
    numbers = Law(law.r, law.r_out, law.r_in, law.h, law.delta_l, law.delta_a)
    g = np.array([cut_off(each, numbers) for each in x.tolist()])
    root = g / (sigma + x * x)
    low, high = np.percentile(sigma * root, (5, 95))
    text = (
        f"sigma_lb alpha_ub from {low:.3g} to {high:.3g} (5 % to 95 %);"
        " (52) says (sigma_lb + x^2) alpha_ub = g"
    )
    return len(x), text, "not broken" if high < 1.01 * low else "no"
