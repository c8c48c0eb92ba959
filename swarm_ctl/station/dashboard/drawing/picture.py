"""All a panel is drawn from: the swarm's view, what the journal made of it, and what the operator
has chosen."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, field

from swarm_ctl.core.model.plan import Point
from swarm_ctl.station.picture.alarms import FOLLOWS, Alarm, Level
from swarm_ctl.station.picture.colours import ON_DARK, group_names
from swarm_ctl.station.picture.journal import JournalLine, TrendPoint
from swarm_ctl.station.picture.view import SwarmView


@dataclass(frozen=True, slots=True)
class NewZone:
    """A circle that the operator moves over the map, before it is ordered."""

    centre_m: Point
    radius_m: float


@dataclass(frozen=True, slots=True)
class Chosen:
    """The operator's own settings of the screens."""

    cursor: int = 0
    """The agent under the cursor; 0: none yet."""
    marked: frozenset[int] = frozenset()
    sort: str = "id"
    """Title of the table's column."""
    backwards: bool = False
    metric: str = "age"
    """What the link matrix shows, a key of `link_matrix.METRICS`."""
    seen_from: str = "above"
    """Where the map is seen from, a key of `swarm_map.SIDES`."""
    log_words: str = ""
    """Only entries with these words."""
    log_level: Level = Level.WELL
    """Only entries at least this bad."""
    new_zone: NewZone | None = None
    """None: none is being placed."""


@dataclass(frozen=True)  # no slots: it keeps its colours
class Picture:
    """One moment on screen."""

    view: SwarmView
    alarms: tuple[Alarm, ...] = ()
    """Those that stand, the worst first."""
    entries: tuple[JournalLine, ...] = ()
    unacknowledged: int = 0
    """Alarms that the operator has not acknowledged."""
    chosen: Chosen = field(default_factory=Chosen)
    trends: tuple[TrendPoint, ...] = field(default=(), kw_only=True)
    palette: tuple[str, ...] = field(default=ON_DARK, kw_only=True)
    """The colours of agents and groups on this screen, by their numbers (`colours.inks`)."""

    def group_ink(self, name: str) -> str:
        """The colour of a group; '' of the whole swarm, and of one that flies no steps of its
        own."""
        names = group_names(self.view.plan)
        return self.palette[names.index(name) % len(self.palette)] if name in names else ""

    @functools.cached_property
    def inks(self) -> dict[int, str]:
        """By agent, its colour; of one that flies in a group now, that of the group. With more
        agents than colours they come again: ids stand beside them."""
        view = self.view
        if group_names(view.plan):
            found = ((i, self.group_ink(group.name)) for group in view.groups for i in group.agents)
            return {agent: colour for agent, colour in found if colour}
        ids = (agent.id for agent in view.plan.agents)
        return dict(zip(ids, itertools.cycle(self.palette), strict=False))

    @property
    def innocent(self) -> frozenset[int]:
        """Agents that only follow another one: their alarms are its doing."""
        names: dict[int, set[str]] = {}
        for alarm in self.alarms:
            for agent in alarm.agents:
                names.setdefault(agent, set()).add(alarm.name)
        return frozenset(agent for agent, told in names.items() if told == {FOLLOWS})

    def levels(self) -> dict[int, Level]:
        """The worst alarm of each agent that has one of its own."""
        found: dict[int, Level] = {}
        innocent = self.innocent
        for alarm in self.alarms:
            for agent in set(alarm.agents) - innocent:
                found[agent] = max(found.get(agent, Level.WELL), alarm.level)
        return found
