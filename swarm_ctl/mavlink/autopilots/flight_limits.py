"""How fast a vehicle lets itself be flown: the parameters that limit how it follows velocity
setpoints. They are read, never set. Pure.

docs/understand/figures.md#real-autopilots has what each of them does on the real ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.vehicle import FlightLimit, LimitKind
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.timing import RETRY_S, Pacer
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry

_GRAVITY_MPS2: Final = 9.81


@dataclass(frozen=True, slots=True)
class LimitSource:
    """One limit, and the parameter that holds it, whose name differs from version to version."""

    kind: LimitKind
    names: Mapping[str, float]
    """By name: the factor to m/s, m/s2 or degrees."""
    lean: bool = False
    """A lean angle, which bounds the acceleration."""
    optional: bool = False
    """Versions without it exist; 0 is no limit."""

    def limit(self, name: str, value: float) -> FlightLimit:
        """The limit that a parameter of this value is."""
        allowed = value * self.names[name]
        if self.lean:
            allowed = _GRAVITY_MPS2 * math.tan(math.radians(min(allowed, 80.0)))
        return FlightLimit(self.kind, allowed, f"{name} {value:g}")


class FlightLimits:
    """Reads the parameters of `sources`. A value that changes later is known by the PARAM_VALUE
    that the vehicle then sends."""

    def __init__(
        self, system: int, sources: Sequence[LimitSource], decode: Callable[[float, int], float]
    ) -> None:
        self._system, self._sources, self._decode = system, sources, decode
        self._pacer = Pacer()
        self.names = frozenset(name for source in sources for name in source.names)
        self._seen: object = None
        self._limits: tuple[FlightLimit, ...] = ()
        self._unread: tuple[str, ...] = ()

    def read(self, heard: Telemetry, now: float) -> list[Message]:
        """PARAM_REQUEST_READ for what is unknown, by all names, again after `RETRY_S`."""
        return [
            outgoing.read_parameter(self._system, name)
            for source in self._sources
            if not self._known(heard, source)
            for name in source.names
            if self._pacer.due(name, RETRY_S, now)
        ]

    def unread(self, heard: Telemetry) -> tuple[str, ...]:
        """The parameters without which the limits are not known; of several names `A or B`."""
        self._look(heard)
        return self._unread

    def limits(self, heard: Telemetry) -> tuple[FlightLimit, ...]:
        """As far as they are known."""
        self._look(heard)
        return self._limits

    def _look(self, heard: Telemetry) -> None:
        """Work both out, where a parameter has changed: they are asked for every tick."""
        if heard.parameter_news is self._seen:
            return
        self._seen = heard.parameter_news
        missing = (s for s in self._sources if not s.optional and not self._known(heard, s))
        self._unread = tuple(" or ".join(source.names) for source in missing)
        self._limits = tuple(self._found(heard))

    def _found(self, heard: Telemetry) -> Iterator[FlightLimit]:
        for source in self._sources:
            for name in self._known(heard, source):
                known = heard.parameters[name]
                value = round(self._decode(known.raw, known.kind), 4)
                if value > 0.0 or not source.optional:
                    yield source.limit(name, value)

    @staticmethod
    def _known(heard: Telemetry, source: LimitSource) -> list[str]:
        return [name for name in source.names if name in heard.parameters]
