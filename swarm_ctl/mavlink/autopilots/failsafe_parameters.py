"""The vehicle's failsafe parameters: ours while we fly it, afterwards its own again. Pure.

An agent that dies leaves our values behind. Where `remembers` is set, nothing is set before
`recall` has told what an earlier flight remembered, and `kept` that the vehicle's own values are
stored outside this process.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from swarm_ctl.core.model.timeouts import PARAMETER_READ_S
from swarm_ctl.core.model.vehicle import Found, OwnValue, ParameterNote, Remembered, own_value
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.timing import RETRY_S, Pacer
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import ParameterValue, Telemetry

Code = Callable[[float, int], float]
"""A value and its MAV_PARAM_TYPE to the other form (wire or plain)."""

_NOTES = {
    Found.OURS: "it still has our failsafe parameters of {flight}: its own are {own};"
    " they are put back at the end of this flight",
    Found.CHANGED: "{own} was changed since our flight {flight}, which did not end in order:"
    " that is what it gets back",
    Found.UNKNOWN: "{own} is what agents set, and no flight is remembered that left it:"
    " taken for its own",
}
"""What is said of the parameters that were found so; of its own values nothing."""

_UNSAFE_KEPT_S = 10.0
"""A change in flight is told for so long after it was set right."""


class FailsafeParameters:
    """Reads what the `rules` name, sets and restores it; only a PARAM_VALUE with the right value
    is a confirmation."""

    def __init__(
        self, system: int, rules: Sequence[ParameterRule], decode: Code, encode: Code
    ) -> None:
        self.own: Mapping[str, OwnValue] = {}
        """What the vehicle gets back, as known so far; replaced, never changed."""
        self.given_back = False
        """The vehicle has confirmed its own values after `restore`."""
        self.obstacle = ""
        """Why nothing is set: the own values can't be stored; ''."""
        self.notes: list[ParameterNote] = []
        """What the operator should know; the caller takes them out."""
        self._system = system
        self._rules = {rule.name: rule for rule in rules}
        self._wanted = {rule.name: rule.value for rule in rules}
        """Without those that the vehicle does not have."""
        self._asked: Counter[str] = Counter()
        self._decode, self._encode = decode, encode
        self._pacer = Pacer()
        self._remembered: Remembered | None = None
        self._recalled = True
        self._kept: Mapping[str, OwnValue] | None = None
        self._findings: dict[str, Found] = {}
        self._stale: dict[str, ParameterValue | None] = {}
        """What was known when a parameter was last set: no confirmation of that."""
        self._changed: set[str] = set()
        """Set to our value, and not yet to the vehicle's own after it."""
        self._seen: object = None
        """`parameter_news` of what was compared last; so with `_learnt` and `_watched`."""
        self._learnt: object = None
        self._watched: object = None
        self._wrong: dict[str, float] = {}
        """The values that are not what is wanted, as watched last."""
        self._unconfirmed: list[str] = []
        self._released = False
        self._unsafe, self._unsafe_s = "", -math.inf
        self._reads = 0

    # --- memory ---

    def remember(self) -> None:
        """Set nothing before `recall` and `kept`."""
        self._recalled, self._kept = False, {}

    def recall(self, remembered: Remembered | None) -> None:
        """What an earlier flight that did not give it back remembered of this vehicle."""
        self._recalled, self._remembered = True, remembered
        self._seen = self._learnt = None

    @property
    def remembers(self) -> bool:
        """The own values are stored outside this process."""
        return self._kept is not None

    @property
    def recalled(self) -> bool:
        """`recall` was called, or is not needed."""
        return self._recalled

    def kept(self, values: Mapping[str, OwnValue]) -> None:
        """These own values are stored outside this process."""
        self._kept, self.obstacle = values, ""
        self._tell({name: self._findings.pop(name) for name in values if name in self._findings})

    def _tell(self, findings: Mapping[str, Found]) -> None:
        flight = self._remembered.flight if self._remembered else ""
        for found, sentence in _NOTES.items():
            names = [name for name, each in findings.items() if each is found]
            if names:
                own = ", ".join(f"{name} {self.own[name].own:g}" for name in names)
                text = sentence.format(own=own, flight=flight)
                self.notes.append(ParameterNote(found, text))

    # --- the vehicle ---

    @property
    def names(self) -> frozenset[str]:
        """Of all rules."""
        return frozenset(self._rules)

    @property
    def wanted(self) -> Mapping[str, float]:
        """Our values."""
        return self._wanted

    @property
    def telling(self) -> frozenset[str]:
        """The names of those whose value of ours shows that an agent was there."""
        return frozenset(name for name, rule in self._rules.items() if rule.telling)

    def read(self, names: Iterable[str], heard: Telemetry, now: float) -> list[Message]:
        """PARAM_REQUEST_READ for those that are not known."""
        self._seen = None
        self._settle(heard, now)
        return self._read(names, heard, now)

    def values(self, heard: Telemetry) -> dict[str, float]:
        """All that are known."""
        known = {name: self._value(heard, name) for name in heard.parameters}
        return {name: value for name, value in known.items() if value is not None}

    def take(self, heard: Telemetry, now: float) -> list[Message]:
        """Read and set our values. On an armed vehicle none is set: a pilot may be flying it."""
        self.given_back, self._seen, self._learnt = False, None, None
        self._settle(heard, now)
        return self._look(heard, now) + self._towards(self._wanted, heard, now)

    def restore(self, heard: Telemetry, now: float) -> list[Message]:
        """Set the vehicle's own values again; none while it is armed."""
        own = {name: value.own for name, value in self.own.items()}
        messages = self._look(heard, now) + self._towards(own, heard, now, back=True)
        self._seen = None
        self.given_back = bool(self.own) and self.released(heard)
        return messages

    def watch(self, heard: Telemetry, now: float) -> list[Message]:
        """In flight: set again what another has changed, and read them all again, one after the
        other: a vehicle need not tell each link of a change."""
        self._learn(heard)
        messages = []
        if self._watched is not heard.parameter_news:
            self._watched, self._wrong = heard.parameter_news, self._unwanted(heard)
        wrong = self._wrong
        for name, value in wrong.items():
            if self._may_set(name) and self._pacer.due(f"again {name}", RETRY_S, now):
                known = heard.parameters[name]
                raw = self._encode(self._rules[name].wanted(value), known.kind)
                messages.append(outgoing.set_parameter(self._system, name, raw, known.kind))
                self._stale[name] = known
                self._changed.add(name)
        if wrong:
            found = ", ".join(
                f"{name} is {value:g}, allowed: {self._rules[name].wanted(value):g}"
                for name, value in wrong.items()
            )
            if found != self._unsafe or now - self._unsafe_s > _UNSAFE_KEPT_S:
                heard.texts.add(f"changed in flight: {found}; set again")
            self._unsafe, self._unsafe_s = found, now
        return messages + self._read_again(heard, now)

    def _unwanted(self, heard: Telemetry) -> dict[str, float]:
        """The values, by name, that are not what is wanted."""
        values = {name: self._value(heard, name) for name in self._rules}
        return {
            name: value
            for name, value in values.items()
            if value is not None and self._rules[name].wanted(value) != value
        }

    def _read_again(self, heard: Telemetry, now: float) -> list[Message]:
        """The next of those that the vehicle has, and of those that it must have."""
        if not self._pacer.due("watch", PARAMETER_READ_S, now):
            return []
        names = [n for n, rule in self._rules.items() if n in heard.parameters or not rule.optional]
        self._reads += 1
        return [outgoing.read_parameter(self._system, names[self._reads % len(names)])]

    def unsafe(self, now: float) -> str:
        """What was changed in flight of late, or ''."""
        return self._unsafe if now - self._unsafe_s <= _UNSAFE_KEPT_S else ""

    def unconfirmed(self, heard: Telemetry) -> list[str]:
        """The names of the parameters that are not known to have our value."""
        self._compare(heard)
        return self._unconfirmed

    def released(self, heard: Telemetry) -> bool:
        """Every parameter that was read, or is remembered, has the vehicle's own value."""
        self._compare(heard)
        return self._released

    def _compare(self, heard: Telemetry) -> None:
        """Work both out, where a parameter or what is wanted has changed: they are asked for every
        tick."""
        if self._seen is heard.parameter_news:
            return
        self._seen = heard.parameter_news
        wanted = self._wanted.items()
        self._unconfirmed = [name for name, value in wanted if self._value(heard, name) != value]
        self._released = self._left.keys() <= self.own.keys() and all(
            name not in self._changed and self._confirmed(heard, name, value.own)
            for name, value in self.own.items()
        )

    @property
    def _left(self) -> Mapping[str, OwnValue]:
        """What an earlier flight has not given back."""
        return self._remembered.values if self._remembered else {}

    def _look(self, heard: Telemetry, now: float) -> list[Message]:
        """Note whose values the parameters have; ask for the remembered ones not read yet."""
        self._learn(heard)
        return self._read(self._left, heard, now)

    def _learn(self, heard: Telemetry) -> None:
        """Note whose value a parameter has that was read for the first time."""
        if not self._recalled or self._learnt is heard.parameter_news:
            return
        self._learnt = heard.parameter_news
        for name in {**self._wanted, **self._left}:
            value = self._value(heard, name)
            if value is not None and name not in self.own:
                rule, left = self._rules.get(name), self._left.get(name)
                own, found = own_value(value, rule.value if rule else value, left)
                nothing_new = rule is not None and not rule.telling and left is None
                self._findings[name] = Found.OWN if nothing_new else found
                self.own = {**self.own, name: own}

    def _settle(self, heard: Telemetry, now: float) -> None:
        """What is wanted, by the values that are known and the parameters that do not exist."""
        for rule in self._rules.values():
            value = self._value(heard, rule.name)
            if value is not None:
                self._wanted[rule.name] = rule.wanted(value)
            elif self._absent(rule, heard, now):
                self._wanted.pop(rule.name, None)

    def _absent(self, rule: ParameterRule, heard: Telemetry, now: float) -> bool:
        """The vehicle has not answered for this optional parameter, and has another of its
        group."""
        others = [r.name for r in self._rules.values() if r.group == rule.group and r != rule]
        needed = rule.group and not any(other in heard.parameters for other in others)
        if needed or not rule.optional:
            return False
        answered = not self._pacer.recent(f"read {rule.name}", OPTIONAL_ANSWER_S, now)
        return self._asked[rule.name] >= OPTIONAL_ASKS and answered

    def _towards(
        self, wanted: Mapping[str, float], heard: Telemetry, now: float, *, back: bool = False
    ) -> list[Message]:
        """PARAM_REQUEST_READ for unknown values, PARAM_SET for other values than `wanted`, and
        (`back`) for all that we have changed: a value on its way to us may be older than that."""
        messages = self._read(wanted, heard, now)
        for name, value in wanted.items():
            known = heard.parameters.get(name)
            if known is None or heard.armed or not self._may_set(name):
                continue
            done = self._confirmed(heard, name, value) and not (back and name in self._changed)
            if not done and self._pacer.due(name, RETRY_S, now):
                raw = self._encode(value, known.kind)
                messages.append(outgoing.set_parameter(self._system, name, raw, known.kind))
                self._stale[name] = known
                (self._changed.discard if back else self._changed.add)(name)
        return messages

    def _read(self, names: Iterable[str], heard: Telemetry, now: float) -> list[Message]:
        return [
            outgoing.read_parameter(self._system, name)
            for name in names
            if name not in heard.parameters and self._ask(name, heard, now)
        ]

    def _ask(self, name: str, heard: Telemetry, now: float) -> bool:
        """Whether to ask now; for an optional one often, and not before the others were answered,
        so that its silence means something."""
        rule, every_s = self._rules.get(name), RETRY_S
        if rule is not None and rule.optional:
            others = (other.name for other in self._rules.values() if not other.optional)
            if not all(other in heard.parameters for other in others):
                return False
            every_s = OPTIONAL_RETRY_S if self._asked[name] < OPTIONAL_ASKS else RETRY_S
        due = self._pacer.due(f"read {name}", every_s, now)
        self._asked[name] += due
        return due

    def _may_set(self, name: str) -> bool:
        """Its own value is known, and stored where that is needed."""
        own = self.own.get(name)
        return own is not None and (self._kept is None or self._kept.get(name) == own)

    def _confirmed(self, heard: Telemetry, name: str, value: float) -> bool:
        """The vehicle has said so since the parameter was last set."""
        fresh = heard.parameters.get(name) is not self._stale.get(name)
        return fresh and self._value(heard, name) == value

    def _value(self, heard: Telemetry, name: str) -> float | None:
        """Rounded, because the wire carries 32-bit floats."""
        known = heard.parameters.get(name)
        return None if known is None else round(self._decode(known.raw, known.kind), 6)


OPTIONAL_RETRY_S = 0.15
"""Vehicles do not answer for a parameter that they do not have. A short interval: all that is to be
asked before the flight waits for the last of these."""
OPTIONAL_ASKS = 8
"""Lost in a row only once in 200 times even where every third frame is lost."""
OPTIONAL_ANSWER_S = 0.5
"""For the answer to the last one."""


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """What one parameter has to be while we fly the vehicle."""

    name: str
    value: float
    at_most: bool = False
    """The vehicle's own value stays where it is smaller."""
    as_delivered: bool = False
    """A new vehicle has this value, too: to find it tells nothing of an earlier flight."""
    optional: bool = False
    """Not every version of the firmware has it."""
    group: str = ""
    """Of the optional parameters of one group, each version has one."""

    @property
    def telling(self) -> bool:
        """A vehicle that has this value has had an agent."""
        return not (self.at_most or self.as_delivered)

    def wanted(self, own: float) -> float:
        """What it shall be, where the vehicle has `own`."""
        return min(own, self.value) if self.at_most else self.value
