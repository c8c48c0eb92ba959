"""The vehicle's failsafe parameters: ours while we fly it, its own again afterwards. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.timing import RETRY_S, Pacer
from swarm_ctl.mavlink.incoming import Heard
from swarm_ctl.mavlink.outgoing import Message

Code = Callable[[float, int], float]
"""A value and its MAV_PARAM_TYPE to the other form (wire or plain)."""


class FailsafeParameters:
    """Reads, sets and puts back `wanted`; only a PARAM_VALUE with the right value counts as
    done."""

    def __init__(
        self, system: int, wanted: Mapping[str, float], decode: Code, encode: Code
    ) -> None:
        self.originals: dict[str, float] = {}
        """The vehicle's own values, as first read."""
        self._system = system
        self._wanted = wanted
        self._decode, self._encode = decode, encode
        self._pacer = Pacer()

    def take(self, heard: Heard, now: float) -> list[Message]:
        """What to send so that ours become valid. Not set on an armed vehicle: somebody may be
        flying it."""
        for name in self._wanted:
            value = self._value(heard, name)
            if value is not None:
                self.originals.setdefault(name, value)
        return self._towards(self._wanted, heard, now)

    def restore(self, heard: Heard, now: float) -> list[Message]:
        """What to send so that the vehicle's own become valid again; nothing while it is armed."""
        return self._towards(self.originals, heard, now)

    def unconfirmed(self, heard: Heard) -> list[str]:
        """The names of those that are not (known to be) ours."""
        return [name for name, value in self._wanted.items() if self._value(heard, name) != value]

    def released(self, heard: Heard) -> bool:
        """The vehicle has its own values, as far as they were ever changed."""
        return all(self._value(heard, name) == value for name, value in self.originals.items())

    def _towards(self, wanted: Mapping[str, float], heard: Heard, now: float) -> list[Message]:
        messages = []
        for name, value in wanted.items():
            known = heard.parameters.get(name)
            if known is None:
                if self._pacer.due(f"read {name}", RETRY_S, now):
                    messages.append(outgoing.read_parameter(self._system, name))
            elif (
                self._value(heard, name) != value
                and not heard.armed
                and self._pacer.due(name, RETRY_S, now)
            ):
                raw = self._encode(value, known.kind)
                messages.append(outgoing.set_parameter(self._system, name, raw, known.kind))
        return messages

    def _value(self, heard: Heard, name: str) -> float | None:
        """Rounded, so that a float's way over the wire (32 bits) changes nothing."""
        known = heard.parameters.get(name)
        return None if known is None else round(self._decode(known.raw, known.kind), 6)
