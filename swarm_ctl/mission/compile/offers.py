"""A plan that a station offers to agents: packed for the mesh, and chosen by name and hash."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.plan_file import PlanFile, plan_from_json, plan_to_json

PACKED_BYTES: Final = 120 * 1024
"""Of an offer on the mesh. The plan of a hundred agents takes 5 KB, and zenoh puts no message
together that is longer than 128 KB."""
_UNPACKED_BYTES: Final = 4_000_000
"""A small offer may hold a text of any length."""
_GZIP: Final = 31
"""What zlib calls gzip, which other tools know."""
SETTLE_S: Final = 2.0
"""Without a hash, an agent listens for so long after the first offer, for another plan."""
_STATIONS: Final = 32
"""That are remembered. Of more, one that has no plan of this name gives its place to the next: no
flood of names keeps the station away that has it."""
_NAMED: Final = re.compile(r"([A-Za-z0-9][A-Za-z0-9_-]{0,39})(?:@([0-9a-f]{12,16}))?")


@dataclass(frozen=True, slots=True)
class PlanName:
    """`hexagon@3fa9c1d2e4f6`: a mission's name, and the first digits of its hash ('': any)."""

    name: str
    digits: str = ""

    def __str__(self) -> str:
        return f"{self.name}@{self.digits}" if self.digits else self.name

    def mistake(self, file: PlanFile) -> str:
        """Why it does not name the plan file, or ''."""
        name, _, digits = file.name.partition("@")
        named = name == self.name and digits.startswith(self.digits)
        return "" if named else f"has {file.name}, not {self}"


def plan_name(text: str) -> PlanName | None:
    """The plan that a word such as `hexagon@3fa9c1d2e4f6` names; None: it is a file's name.

    InputError where what stands after the @ is no hash.
    """
    found = _NAMED.fullmatch(text)
    if found is None and _NAMED.fullmatch(text.partition("@")[0]) and "@" in text:
        raise InputError(
            f"{text}: names no plan; allowed: NAME@HASH with 12 to 16 of the hash's digits (0-9,"
            " a-f), as `swarm-ctl plan` and a station tell them"
        )
    return found and PlanName(found[1], found[2] or "")


def pack(plan: Plan, agents: tuple[FleetAgent, ...], signing: SigningPolicy) -> bytes:
    """An offer: the plan file, compressed; not where the station keeps its keys. No bytes where it
    is too large to be offered."""
    text = plan_to_json(plan, Fleet(agents, None, signing)).encode()
    packing = zlib.compressobj(9, wbits=_GZIP)
    data = packing.compress(text) + packing.flush()
    return data if len(data) <= PACKED_BYTES else b""


def unpack(data: bytes, name: str) -> PlanFile:
    """The plan file of an offer, checked as any plan file; errors (InputError) call it `name`."""
    if not data:
        raise InputError(f"{name}: is too large for the mesh; allowed: a copy of its plan file")
    unpacking = zlib.decompressobj(wbits=_GZIP)
    try:
        text = unpacking.decompress(data, _UNPACKED_BYTES)
    except zlib.error as error:
        raise InputError(f"{name}: is not packed as a plan: {error}") from None
    if not unpacking.eof:
        raise InputError(
            f"{name}: is torn, or longer than {_UNPACKED_BYTES / 1e6:g} MB; allowed: a whole plan"
        )
    found = plan_from_json(text, name)
    if found.trust is not None:
        raise InputError(f"{name}: names a folder of keys; allowed: none")
    return found


class Offers:
    """What stations offer to an agent that waits for a plan.

    An offer that is unreadable, or of another plan, is refused and told; it keeps no other station
    from being heard. With a hash the first plan that has it is the one. Without, all stations that
    are heard in `SETTLE_S` must have the same.
    """

    def __init__(self, wanted: PlanName) -> None:
        self.wanted = wanted
        self._heard: dict[str, bytes] = {}
        self._plans: dict[str, PlanFile] = {}
        self._refused: dict[str, str] = {}
        self._first_s: float | None = None

    def hear(self, station: str, data: bytes, now: float) -> None:
        """A station's offer came at `now` [s]; the same again costs nothing."""
        if self._heard.get(station) == data:
            return
        if station not in self._heard and len(self._heard) >= _STATIONS:
            useless = next((each for each in self._heard if each not in self._plans), None)
            if useless is None:
                return
            del self._heard[useless]
            self._refused.pop(useless, None)
        self._heard[station] = data
        self._plans.pop(station, None)
        try:
            found = unpack(data, f"the plan of station {station}")
        except InputError as error:
            self._refused[station] = str(error)
            return
        if mistake := self.wanted.mistake(found):
            self._refused[station] = f"station {station} {mistake}"
            return
        self._refused.pop(station, None)
        self._plans[station] = found
        self._first_s = now if self._first_s is None else self._first_s

    def chosen(self, now: float) -> PlanFile | None:
        """The plan to fly; None: wait on. InputError where stations have different ones."""
        found = {each.name: each for each in self._plans.values()}
        if len(found) > 1:
            names = "; ".join(self._told())
            raise InputError(
                f"{self.wanted}: stations have different plans: {names}; allowed: name one of them"
                " by its hash"
            )
        settled = self._first_s is not None and now - self._first_s >= SETTLE_S
        return next(iter(found.values()), None) if settled or self.wanted.digits else None

    def _told(self) -> Iterator[str]:
        for station, found in sorted(self._plans.items()):
            yield f"station {station} has {found.name}"

    def refusals(self) -> tuple[str, ...]:
        """What was offered and not taken, for an operator."""
        return tuple(text for _, text in sorted(self._refused.items()))
