"""The columns of a study's rows, and what each means: the data dictionary."""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.kernel.law import STATUSES
from swarm_ctl.study.parameter_space import AGENT_RANGES, LISTS, RANGES, Study

WITH_UNIT: Final = {
    "kappa": "kappa_per_s",
    "loss": "loss_share",
    "area": "area_units",
    "spacing": "spacing_units",
    "silent": "silent_share",
    "smallest": "smallest_units",
    "smallest_silent": "smallest_silent_units",
    "error": "error_units",
    "longest_link": "longest_link_units",
    "touched": "touched_share",
    "smallest_zone": "smallest_zone_units",
    "trunk": "trunk_units",
    "gap": "gap_units",
}
"""Columns whose names say more than the fields of `Study`, `Batch` and `BatchResult` do."""

_RESULTS: Final = {
    "collided": "1: two live agents came under `r_in`, at a tick or between two.",
    "smallest_units": "Smallest true distance of two live agents, between ticks too: each flies"
    " straight from one to the next.",
    "smallest_silent_units": "Smallest true distance of a live agent to the vehicle of a silent"
    " one; `inf` where no agent died. Two silent vehicles do not count.",
    "hit": "1: a live agent came under `r_in` of a silent vehicle.",
    "converged": "1: the formation of the live agents stood for `settle_s`.",
    "time_s": "When the formation stood, before settling; the end of the mission where it did not.",
    "error_units": "Largest |e_i - mean e| of the live agents at the end.",
    "links": "Links at the start: pairs within `r`.",
    "links_broken": "Of those, the ones that ever got longer than `r`.",
    "kept_broken": "Of those, the ones between live agents while their slots were within 0.9 `r`.",
    "longest_link_units": "The longest that one of the links ever was.",
    "stuck": "1: not formed at the end, all commands within 0.05 m/s of their mean for 20 s.",
    "touched_share": "Share of the live agents' ticks in which the safety filter changed the wish.",
    "yielded": "Agents' ticks in which keep-outs excluded each other.",
    "exchanges": "Slot exchanges.",
    "parted": "1: at a look (every 5 ticks) the links within `r` did not connect all agents.",
    "small_gap": "Pairs' ticks with `D_ub - D_lb <= 2`, which the paper takes for impossible.",
    "steps": "Ticks flown.",
    "entered": "1: a live agent was in a zone (a trunk), by truth.",
    "smallest_zone_units": "Smallest true distance of a live agent to a zone, between ticks too,"
    " under 0 inside; `inf` without a zone.",
    "over_shortest": "`time_s` over the time in which the file could be there: all at the top speed"
    " from the first moment on, one behind the other. 0 without a wood.",
}


def _of_parameters() -> dict[str, str]:
    said = {name: Study.model_fields[name].description or "" for name in (*LISTS, *RANGES)}
    told = said | {
        name: said[name].replace("None: ", "Not given: ") for name in said if "model" in name
    }
    alike = [name for name in (*LISTS, *RANGES) if name not in AGENT_RANGES]
    columns = {WITH_UNIT.get(name, name): told[name] for name in alike}
    for name in AGENT_RANGES:
        for end in ("least", "most"):
            columns[f"{end}_{name}"] = f"The {end} of the mission's agents. {said[name]}"
    return columns


MEANINGS: Final[dict[str, str]] = {
    "row": "Number of the mission in the study, from 0.",
    "cell": "Number of the combination of the lists' values, from 0.",
    **_of_parameters(),
    "silent_agents": "How many agents died.",
    "wind_from_rad": "Where the wind comes from, clockwise from north.",
    **_RESULTS,
    **{f"sigma_{name}": f"Pairs' ticks with the sigma status `{name}`." for name in STATUSES},
}
"""By column, in order."""
COLUMNS: Final = tuple(MEANINGS)
