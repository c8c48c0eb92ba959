"""The vehicle's failsafe parameters: ours while we fly it, afterwards its own again. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.timing import RETRY_S, Pacer
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.vehicle_telemetry import Telemetry

Code = Callable[[float, int], float]
"""A value and its MAV_PARAM_TYPE to the other form (wire or plain)."""


class FailsafeParameters:
    """Reads, sets and restores `wanted`; only a PARAM_VALUE with the right value is a
    confirmation."""

    def __init__(
        self, system: int, wanted: Mapping[str, float], decode: Code, encode: Code
    ) -> None:
        self.originals: dict[str, float] = {}
        """The vehicle's own values, as first read."""
        self._system = system
        self._wanted = wanted
        self._decode, self._encode = decode, encode
        self._pacer = Pacer()

    def take(self, heard: Telemetry, now: float) -> list[Message]:
        """Read and set our values. On an armed vehicle none is set: a pilot may be flying it."""
        for name in self._wanted:
            value = self._value(heard, name)
            if value is not None:
                self.originals.setdefault(name, value)
        return self._towards(self._wanted, heard, now)

    def restore(self, heard: Telemetry, now: float) -> list[Message]:
        """Set the vehicle's own values again; none while it is armed."""
        return self._towards(self.originals, heard, now)

    def unconfirmed(self, heard: Telemetry) -> list[str]:
        """The names of the parameters that are not known to have our value."""
        return [name for name, value in self._wanted.items() if self._value(heard, name) != value]

    def released(self, heard: Telemetry) -> bool:
        """Every parameter that was read has the vehicle's own value."""
        return all(self._value(heard, name) == value for name, value in self.originals.items())

    def _towards(self, wanted: Mapping[str, float], heard: Telemetry, now: float) -> list[Message]:
        """PARAM_REQUEST_READ for unknown values, PARAM_SET for other values than `wanted`."""
        messages = []
        for name, value in wanted.items():
            known = heard.parameters.get(name)
            if known is None:
                if self._pacer.due(f"read {name}", RETRY_S, now):
                    messages.append(outgoing.read_parameter(self._system, name))
                continue
            wrong = self._value(heard, name) != value
            if wrong and not heard.armed and self._pacer.due(name, RETRY_S, now):
                raw = self._encode(value, known.kind)
                messages.append(outgoing.set_parameter(self._system, name, raw, known.kind))
        return messages

    def _value(self, heard: Telemetry, name: str) -> float | None:
        """Rounded, because the wire carries 32-bit floats."""
        known = heard.parameters.get(name)
        return None if known is None else round(self._decode(known.raw, known.kind), 6)
