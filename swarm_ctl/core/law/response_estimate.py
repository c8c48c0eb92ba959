"""How late the own vehicle answers, estimated in flight, and its stop point with that.

The model (`core/law/stop_point.py`) is flown beside the vehicle by the same setpoints. A vehicle
that answers `late_s` later than the model falls behind it by `late_s` times its velocity. So
`late_s` is a regression of the one on the other, with what is slow (wind, a position that wanders)
taken out of both:

    late_s = sum(behind . v) / (sum(|v|^2) + 0.1 m^2/s), behind = x_model - x

It counts as dead time: the vehicle has yet to fly setpoints that the model takes for flown, and
comes to rest after all of these, its limit of acceleration counted. Where that would be less than
no dead time, the rest is taken from the lag. A dead time is found to 0.1 s. A lag that differs from
the model's is found only as far as it acts like a dead time, in long legs.

`doubt_s` is by how much the response may still be off. It starts with the model's own doubt and
falls as the vehicle moves, so an agent that has not flown yet is careful near others
(`core/kernel/constraints.py`).

Written once for one vehicle and for arrays of them (`core/model/arrays.py`); metres, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from swarm_ctl.core.law.stop_point import Coast, pending
from swarm_ctl.core.model.arrays import ONE, Arithmetic
from swarm_ctl.core.model.plan import Response

LATEST_S: Final = 1.0
"""A vehicle that answers later than its model by more than this is not compensated for more."""
SLOW_S: Final = 1.0
"""Changes that take longer than this are not the response's. At 3 s, a real PX4 whose integrator
creeps for seconds was taken for 1 s late in a long leg."""
_UNTRUSTED_M2PS: Final = 0.1
"""So much motion [m^2/s] halves the doubt: 1 m/s for a tenth of a second. With 0.5, two that flew
at each other and answered 0.5 s late were too near before either knew (`studies/late-pair.yaml`:
0.38 units instead of 0.60)."""
_KEPT_M2PS: Final = 30.0
"""Older motion than this is forgotten in its favour."""
_LEAST_DOUBT_S: Final = 0.05
_JUMP_M: Final = 1.0
"""A position that moves so far in one tick was corrected, not flown."""


class ResponseEstimate:
    """Of one vehicle, or of arrays of them.

    Args:
        model: what is believed at first.
        tick_s: between two setpoints.
        blank: zero of the right shape: `0j`, or an array.
        of: `MANY` for arrays.
    """

    def __init__(
        self, model: Response, tick_s: float, blank: Any = 0j, of: Arithmetic = ONE
    ) -> None:
        self._model, self._tick_s, self._of = model, tick_s, of
        self._blank = blank
        self._coast = Coast(model, tick_s, of.most)
        self._pending = pending(model, tick_s)
        self._history = max(self._pending, math.ceil((model.dead_time_s + LATEST_S) / tick_s)) + 1
        self._moved = self._agreed = abs(blank)
        self.late_s = abs(blank)
        """The vehicle answers later than the model by this; less than 0: earlier."""
        self.doubt_s = abs(blank) + model.doubt_s
        """By how much model and `late_s` may still be off."""
        self.restart()

    @property
    def response_s(self) -> Any:
        """From a setpoint to the flown velocity: dead time and lag together."""
        return self._model.dead_time_s + self._model.lag_s + self.late_s

    def restart(self) -> None:
        """The vehicle stands still or flies on its own: no setpoint is under way. The estimate
        stays."""
        self._sent = [self._blank] * self._history
        """The newest setpoints, oldest first."""
        self._begin_afresh()

    def rest(self) -> None:
        """In this tick no setpoint of ours steers the vehicle; those under way still act."""
        self._begin_afresh()
        self.sent(self._blank)

    def _begin_afresh(self) -> None:
        """The model flies from where the vehicle is at the next look."""
        self._place: Any = None
        """Of the vehicle that flies as the model does; None: not begun."""
        self._velocity = self._slow_velocity = self._blank
        self._behind = self._slow_behind = self._blank

    def sent(self, setpoint: Any) -> None:
        """A setpoint [m/s] was sent: the model flies one tick."""
        del self._sent[0]
        self._sent.append(setpoint)
        acting = self._sent[-1 - self._pending]
        if self._place is not None:
            self._place, self._velocity = self._coast.tick(self._place, self._velocity, acting)

    def stop_point(self, position: Any, velocity: Any) -> Any:
        """Where the vehicle would come to rest [m], from where it is now [m], [m/s].

        Takes the tick into the estimate, so call it once a tick.
        """
        self._compare(position, velocity)
        late_s = self.late_s + self._model.dead_time_s
        dead_s = self._of.most(0.0, late_s)
        x, v = position, velocity
        for acting, part in self._yet_to_act(dead_s / self._tick_s):
            x, v = self._coast.tick(x, v, acting, part)
        quicker_s = late_s - dead_s
        return self._coast.rest(x, v) + quicker_s * velocity

    def _yet_to_act(self, ticks: Any) -> Iterator[tuple[Any, Any]]:
        """The setpoints of the last `ticks`, oldest first, and which part of its tick each has yet
        to act: of a number with a fraction, the oldest acts for that."""
        if isinstance(ticks, np.ndarray):
            most, least = ticks.max(), ticks.min()
        else:
            most = least = ticks
        for ago in range(math.ceil(most), 0, -1):
            part = 1.0
            if ago > least:
                part = self._of.most(0.0, self._of.least(1.0, ticks - (ago - 1)))
            yield self._sent[-ago], part

    def _compare(self, position: Any, velocity: Any) -> None:
        """Take one tick into the estimate."""
        if self._place is None:
            self._place, self._velocity = position, velocity
            self._slow_velocity = velocity
        before, self._behind = self._behind, self._place - position
        moving = 0.5 * (velocity + self._velocity)
        # a jump moves the level that it starts from as well
        jumped = abs(self._behind - before) > _JUMP_M
        self._slow_behind = self._slow_behind + self._of.where(jumped, self._behind - before, 0j)
        behind, moves = self._behind - self._slow_behind, moving - self._slow_velocity
        share = self._tick_s / SLOW_S
        self._slow_behind = self._slow_behind + behind * share
        self._slow_velocity = self._slow_velocity + moves * share
        moved = self._moved + (moves * moves.conjugate()).real * self._tick_s
        agreed = self._agreed + (behind * moves.conjugate()).real * self._tick_s
        kept = _KEPT_M2PS / self._of.most(moved, _KEPT_M2PS)
        self._moved, self._agreed = moved * kept, agreed * kept
        sure = 1.0 / (self._moved + _UNTRUSTED_M2PS)
        self.late_s = self._of.least(LATEST_S, self._of.most(-LATEST_S, self._agreed * sure))
        least = min(_LEAST_DOUBT_S, self._model.doubt_s)
        self.doubt_s = least + (self._model.doubt_s - least) * _UNTRUSTED_M2PS * sure

    def only(self, missions: Any) -> None:
        """Go on with some of the missions, the first axis of arrays."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                setattr(self, name, np.ascontiguousarray(value[missions]))
        self._sent = [np.ascontiguousarray(setpoint[missions]) for setpoint in self._sent]
