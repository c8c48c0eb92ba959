"""The steps of a mission file in the order in which each agent flies them: those of the whole
swarm, and between a split and the join at its end those of each group."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

from swarm_ctl.core.model.plan import EVERYONE
from swarm_ctl.mission.input.document import Place
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.steps.table import LAST, WrittenStep

REST = "rest"
"""The group of the agents that a split gives no steps: they wait for the others."""


class WrittenGroup(NamedTuple):
    """What a group flies from the start, a split or a join to the next."""

    name: str
    ids: tuple[int, ...]
    """Sorted; none: the file has no such group."""
    steps: tuple[tuple[Place, WrittenStep], ...]
    """Each with its place in the file, that of its entry."""
    joins: bool
    """It waits for the other groups of its split at its end."""

    def seen_by(self, mission: MissionFile) -> MissionFile:
        """The mission as it is for this group alone."""
        if len(self.ids) == len(mission.agents):
            return mission
        agents = tuple(agent for agent in mission.agents if agent.id in self.ids)
        return mission.model_copy(update={"agents": agents})


Split: TypeAlias = tuple[WrittenGroup, ...]


def split_up(mission: MissionFile) -> list[Split]:
    """The whole swarm's steps (one group) and the splits, in the order of the file. A group whose
    last step brings it down does not fly on."""
    found, flying = list[Split](), [agent.id for agent in mission.agents]
    steps = list[tuple[Place, WrittenStep]]()
    for k, entry in enumerate(mission.steps):
        if entry.split is None:
            steps.append((("steps", k), entry))
            continue
        if steps:
            found.append((_whole(flying, steps),))
            steps = []
        found.append(tuple(_groups(mission, k, flying)))
        down = {agent for group in found[-1] if not group.joins for agent in group.ids}
        flying = [agent for agent in flying if agent not in down]
    return [*found, (_whole(flying, steps),)] if steps else found


def written_steps(mission: MissionFile) -> Iterator[tuple[WrittenGroup, Place, WrittenStep]]:
    """All of them, with their groups."""
    for split in split_up(mission):
        for group in split:
            for place, entry in group.steps:
                yield group, place, entry


def _whole(flying: list[int], steps: list[tuple[Place, WrittenStep]]) -> WrittenGroup:
    return WrittenGroup(EVERYONE, tuple(sorted(flying)), tuple(steps), joins=False)


def _groups(mission: MissionFile, k: int, flying: list[int]) -> Iterator[WrittenGroup]:
    """Those of the split that is the k-th entry."""
    left = set(flying)
    for name, entries in (mission.steps[k].split or {}).items():
        ids = tuple(sorted(left.intersection(mission.groups.get(name, ()))))
        left.difference_update(ids)
        steps = tuple((("steps", k, "split", name, j), entry) for j, entry in enumerate(entries))
        yield WrittenGroup(name, ids, steps, joins=entries[-1].kind not in LAST)
    if left:
        yield WrittenGroup(REST, tuple(sorted(left)), (), joins=True)
