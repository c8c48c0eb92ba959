"""How an agent marches through the mission's steps: a barrier made of state, not of events.

Every state carries (step, done), ordered lexicographically. An agent leaves step k when everyone
that it waits for, and that lives, shows at least (k, done); a peer at k + 1 proves k. A barrier
with `on_timeout: continue` is left without the other groups when its time is over. Lost or repeated
messages change nothing.
"""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.model.messages import StepOutcome, StepResult
from swarm_ctl.core.model.plan import GroupPlan
from swarm_ctl.core.model.route import Route
from swarm_ctl.core.model.steps.step import Step


class Progress:
    """Where one agent is in its steps, and how each of them went.

    `prepare_timeout_s` bounds the wait for a healthy vehicle.
    """

    def __init__(self, route: Route, prepare_timeout_s: float, now: float) -> None:
        self._route, self._prepare_timeout_s = route, prepare_timeout_s
        self.steps: Final = route.steps
        """All of the agent's."""
        self.step = 0
        """0 is preparation, k is `steps[k - 1]`."""
        self.done = False
        self.started_s = now
        self.paused_s = 0.0
        """How long a policy or a command has held this step up; its time-out waits as long."""
        self._held_s = -math.inf
        """When one held it up last."""
        self.results: list[StepResult] = [StepResult("prepare", StepOutcome.RUNNING, now, None)]

    @property
    def current(self) -> Step | None:
        """The current step; None while preparing."""
        return self.steps[self.step - 1] if self.step else None

    @property
    def group(self) -> GroupPlan:
        """That flies the current step."""
        return self._route.group(self.step)

    @property
    def name(self) -> str:
        """Of the current step."""
        return self._route.step_name(self.step)

    @property
    def lands_in_place(self) -> bool:
        """The current step does."""
        step = self.current
        return step is not None and step.lands_in_place

    @property
    def goes_home(self) -> bool:
        """The current step does."""
        step = self.current
        return step is not None and step.goes_home

    @property
    def goes_down(self) -> bool:
        """The current step does."""
        step = self.current
        return step is not None and step.goes_down

    @property
    def finished(self) -> bool:
        """The last step is done."""
        return self.done and self.step == len(self.steps)

    @property
    def timed_out_at(self) -> float:
        """When the current step has taken too long (the wait for the others included)."""
        step = self.current
        return (
            self.started_s
            + self.paused_s
            + (self._prepare_timeout_s if step is None else step.timeout_s)
        )

    @property
    def goes_on_since_s(self) -> float:
        """Since when the current step has been flown without a break."""
        return max(self.started_s, self._held_s)

    def hold_up(self, now: float, tick_s: float) -> None:
        """A policy or a command holds this step up in this tick."""
        self.paused_s += tick_s
        self._held_s = now

    def finish_step(self, now: float, outcome: StepOutcome = StepOutcome.DONE) -> None:
        """This agent's part of the current step is over."""
        if not self.done:
            self.done = True
            self._close(outcome, now)

    def run_out(self, now: float) -> None:
        """The current step's time is over, as it waits for others; the mission goes on."""
        self._close(StepOutcome.TIMEOUT, now)

    def break_off(self, outcome: StepOutcome, now: float) -> None:
        """The current step ends early, and the mission with it; it ends once, whatever comes after
        that."""
        if not self.done and self.results[-1].end_s is None:
            self._close(outcome, now)

    def advance(self, now: float) -> None:
        """Go on to the next step, because everyone is done with this one."""
        self.step += 1
        self.done = False
        self.started_s = now
        self.paused_s = 0.0
        self.results.append(StepResult(self.name, StepOutcome.RUNNING, now, None))

    def rejoin(self, step: int, now: float) -> None:
        """Start in the middle, at `step`: the peers prove that all steps before it are done."""
        self.step, self.done, self.started_s, self.paused_s = step, False, now, 0.0
        self.results = [
            StepResult(self._route.step_name(k), StepOutcome.DONE, now, None) for k in range(step)
        ]
        self.results.append(StepResult(self.name, StepOutcome.RUNNING, now, None))

    def _close(self, outcome: StepOutcome, now: float) -> None:
        last = self.results[-1]
        self.results[-1] = StepResult(last.name, outcome, last.start_s, now)
