"""What stops an agent's mission, since when, and what the agent says of it.

`Interruption` alone writes the trigger: a failsafe's or an order's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from swarm_ctl.core.agent.failsafes import FailsafeTrigger
from swarm_ctl.core.agent.own_vehicle import HOLDS_M, OwnVehicle
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.messages import Event, Outcome, Severity


@dataclass(slots=True)
class EventLog:
    """What an agent has to say. Each tick's events go out with it."""

    agent: int
    events: list[Event] = field(default_factory=list)

    def say(self, now: float, severity: Severity, text: str) -> None:
        """A line."""
        self.events.append(Event(self.agent, now, severity, text))

    def take(self) -> tuple[Event, ...]:
        """What was said since it was last taken."""
        taken, self.events = tuple(self.events), []
        return taken


class Interruption:
    """What stops the mission: the failsafe that is carried out, and since when. Without one the
    mission goes on."""

    def __init__(self, vehicle: OwnVehicle, progress: Progress, log: EventLog) -> None:
        self._vehicle, self._progress, self._log = vehicle, progress, log
        self.trigger: FailsafeTrigger | None = None
        self.since_s = math.inf
        self._failed = False
        """What was carried out before this trigger had failed."""

    @property
    def reason(self) -> str:
        """Why the mission is stopped, or ''."""
        return self.trigger.reason if self.trigger else ""

    @property
    def holds(self) -> bool:
        """The mission waits until the cause is gone."""
        return self.trigger is not None and self.trigger.action is FailsafeAction.HOLD

    @property
    def outcome(self) -> Outcome:
        """How the flight ended: one that a failure broke off has failed, whatever was ordered."""
        if self._vehicle.ended_s is None:
            return Outcome.RUNNING
        if self.trigger is None:
            return Outcome.COMPLETED
        return Outcome.FAILED if self._failed else self.trigger.outcome

    def heed(self, tick: Tick, trigger: FailsafeTrigger | None) -> None:
        """A failsafe fires, or (None) its cause is gone and the mission goes on. A hold that goes
        on does not begin again: its sentence has new figures. What had failed says so on, and
        why."""
        if self.holds and trigger == self.trigger:
            self.trigger = trigger
            return
        if trigger is None:
            self._log.say(tick.now, Severity.INFO, "going on")
            self._vehicle.climb_again()
        else:
            severity = Severity.ERROR if trigger.outcome is Outcome.FAILED else Severity.WARNING
            self._log.say(tick.now, severity, f"{trigger.action}: {trigger.reason}")
            holds = trigger.action is FailsafeAction.HOLD
            if not holds:
                before = None if self.holds else self.trigger
                self._failed |= before is not None and before.outcome is Outcome.FAILED
                if self._failed and before is not None and trigger.outcome is not Outcome.FAILED:
                    why = f"{self.reason}; then {trigger.reason}"
                    trigger = replace(trigger, reason=why, cause=before.cause)
                self._progress.break_off(trigger.step_outcome, tick.now)
            self._vehicle.stop_climbing(tick.newest_fix, HOLDS_M if holds else 0.0)
        self.trigger, self.since_s = trigger, tick.now

    def go_over_to(self, trigger: FailsafeTrigger, *, anew_s: float | None = None) -> None:
        """What is carried out has come to this; `anew_s`: it begins again at that time."""
        self.trigger = trigger
        if anew_s is not None:
            self.since_s = anew_s

    def lift(self) -> None:
        """By the operator's word the mission goes on."""
        self.trigger, self._failed = None, False
