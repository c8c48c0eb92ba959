"""The flights of golden traces: their hashes, and what each tick of them had."""

from __future__ import annotations

import contextlib
import dataclasses
import gzip
import hashlib
import json
import multiprocessing
import platform
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.cores import cores
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.virtual.scenario import load_scenario, scenario_of
from swarm_ctl.virtual.scenario_flight import FlownScenario, ScenarioFlight

HERE: Final = Path(__file__).parent
MISSIONS: Final = HERE.parents[1] / "missions"
HASHES: Final = HERE / "hashes.json"
_NOTHING: Final = (b',"zones":null', b',"opens_m":null', b',"ups_m":[]')
SUFFIX: Final = ".jsonl.gz"
"""Of a trace's file."""
CUT_S: Final = {"thirtytwo": 30.0, "hundred": 8.0}
"""Of large swarms the first seconds alone: a hundred agents take ten minutes for a flight."""
_CHANNELS: Final[tuple[keys.Channel[Any], ...]] = (
    keys.STATE,
    keys.FAR,
    keys.CLOCK,
    keys.LAW,
    keys.BEACON,
    keys.ACK,
    keys.EVENT,
    keys.SIGMA,
    keys.STATUS,
    keys.COMMAND,
)


def rows() -> dict[str, Path]:
    """The file of each flight, by name: missions by theirs, scenarios by number."""
    found = {path.stem: path for path in MISSIONS.glob("*.yaml")}
    return found | {path.stem: path for path in (HERE / "scenarios").glob("*.yaml")}


@dataclasses.dataclass(frozen=True, slots=True)
class Golden:
    """Hashes by row, and what they were made with."""

    made_with: dict[str, str]
    hashes: dict[str, str]

    @classmethod
    def here(cls, hashes: Mapping[str, str]) -> Golden:
        """Made now."""
        return cls(_here(), dict(sorted(hashes.items())))

    def is_of_here(self) -> bool:
        """They hold on this machine."""
        return self.made_with == _here()

    def write(self) -> None:
        """To `HASHES`."""
        HASHES.write_text(json.dumps(dataclasses.asdict(self), indent=1) + "\n", encoding="utf-8")


def read() -> Golden:
    """Those in `HASHES`."""
    return Golden(**json.loads(HASHES.read_text(encoding="utf-8")))


def _here() -> dict[str, str]:
    known: Any = np.show_config(mode="dicts")
    simd = known["SIMD Extensions"]
    return {
        "python": ".".join(platform.python_version_tuple()[:2]),
        "numpy": np.__version__,
        "machine": platform.machine(),
        "simd": " ".join(simd.get("found", [])),
    }


def differences(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """The rows of `other` that have another hash in `one`, or none."""
    return sorted(name for name, digest in other.items() if one.get(name) != digest)


def fly(
    names: Iterable[str], processes: int | None = None, folder: Path | None = None
) -> dict[str, str]:
    """The hash of each row's flight; with a folder its trace is written there."""
    # the longest first, so that none begins last
    ordered = sorted(names, key=lambda name: (name not in CUT_S, name.isdigit(), name))
    workers = min(processes or cores(), len(ordered))
    one = partial(_row, folder=folder)
    if workers == 1:
        return dict(map(one, ordered))
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        return dict(pool.imap_unordered(one, ordered))


def _row(name: str, folder: Path | None) -> tuple[str, str]:
    path = rows()[name]
    if path.parent == MISSIONS:
        scenario, mission = scenario_of(f"version: 1\nmission: {path}\n")
    else:
        scenario, mission = load_scenario(path)
        may = [each.model_copy(update={"may_be_refused": True}) for each in scenario.happens]
        scenario = scenario.model_copy(update={"happens": tuple(may)})
    flight = ScenarioFlight(scenario, mission)
    flight.swarm.mesh.tap = _without_hash(flight)
    with contextlib.ExitStack() as stack:
        watch, trace = _unwatched, None
        if folder is not None:
            file = stack.enter_context(gzip.open(folder / f"{name}{SUFFIX}", "wt"))
            trace = _Trace(flight)
            watch = lambda _: file.write(trace.line())  # noqa: E731
        until_s = CUT_S.get(name)
        if until_s is None:
            flown = flight.fly(watch)
            if trace is not None:
                file.write(trace.end(flown))
            return name, _hash(flown)
        while flight.swarm.now < until_s:
            flight.turn()
            watch(flight)
        return name, flight.account.digest()


def _without_hash(flight: ScenarioFlight) -> Callable[[str, bytes], None]:
    """What hears the mesh for the flight's digest, but for the plan's hash, and fields that say
    nothing: a plan, or a message, may have more, and be flown the same."""
    number, tap = flight.plan.hash(), flight.swarm.mesh.tap
    told = (struct.pack("<Q", number), b"%d" % number, b"%016x" % number, *_NOTHING)

    def hear(key: str, data: bytes) -> None:
        for each in told:
            data = data.replace(each, b"")
        if tap is not None:
            tap(key, data)

    return hear


def _unwatched(_: ScenarioFlight) -> None:
    return


def _refused(flown: FlownScenario) -> list[list[Any]]:
    """The orders that the station did not send: no message has them."""
    return [[order.at_s, order.line, order.refused] for order in flown.orders if order.refused]


def _hash(flown: FlownScenario) -> str:
    refused = _refused(flown)
    if not refused:
        return flown.digest
    return hashlib.sha256(f"{flown.digest} {refused}".encode()).hexdigest()


class _Trace:
    """What each tick had, as lines of JSON."""

    def __init__(self, flight: ScenarioFlight) -> None:
        self._swarm = flight.swarm
        self._node = Node(MemoryTransport(flight.swarm.mesh), "test", "golden")
        self._node.listen(*_CHANNELS, agents=[agent.id for agent in flight.plan.agents])
        self._framers = [Framer() for _ in flight.plan.agents]
        self._told: list[list[Any]] = [[] for _ in self._framers]
        self._tell = flight.account.told
        flight.account.told = self._take  # type: ignore[method-assign]

    def _take(self, place: int, data: bytes) -> None:
        """Keep what an agent sends its vehicle."""
        self._tell(place, data)
        for frame in self._framers[place].feed(data):
            message = dialect.MAVLink(None).decode(bytearray(frame.raw))
            fields = message.to_dict() | {"seq": frame.seq}
            self._told[place].append({fields.pop("mavpackettype"): fields})

    def line(self) -> str:
        """Of the tick that was."""
        swarm = self._swarm
        places = np.asarray(swarm.hub.world.positions()).tolist()
        agents: dict[str, Any] = {}
        for planned, place, told in zip(swarm.plan.agents, places, self._told, strict=True):
            goal = swarm.members[planned.id].goals[-1:]
            # what is told comes first, and what it does second
            agents[f"agent {planned.id}"] = {"goal": goal, "link": [*told], "vehicle": place}
            told.clear()
        for channel in _CHANNELS:
            for payload, _ in self._node.take(channel):
                said = f"agent {payload.agent}" if hasattr(payload, "agent") else "station"
                of = agents.setdefault(said, {})
                fields = dataclasses.asdict(payload)
                fields.pop("plan_hash", None)
                gains = (fields.get("tuning") or fields).get("gains")
                if gains and not gains["own"]:
                    gains.pop("own")  # the paper's law is flown: none of another has numbers
                of.setdefault(channel.name, []).append(fields)
        return _line({"now_s": swarm.now} | agents)

    def end(self, flown: FlownScenario) -> str:
        """Of the flight: how it ended."""
        summary = flown.summary
        verdict = {"outcome": summary.outcome, "cause": summary.cause, "reason": summary.reason}
        refused = {"refused orders": _refused(flown), "digest": flown.digest}
        return _line({"now_s": flown.end_s, "verdict": verdict} | refused)


def _line(data: dict[str, Any]) -> str:
    return json.dumps(data, separators=(",", ":"), default=str) + "\n"


def first_difference(one: Path, other: Path) -> str:
    """`at 12.3 s: agent 2, state, setpoint_mps: [1, 0] and [1.1, 0]`, or ''."""
    with gzip.open(one, "rt") as left, gzip.open(other, "rt") as right:
        for a, b in zip_longest(left, right):
            if a == b:
                continue
            was, is_now = _read(a or b), _read(b or a)
            if a is None or b is None:
                return f"one ends before {float(was['now_s']):g} s, the other goes on"
            where, before, after = next(_differ(was, is_now, ()), (("order",), a, b))
            values = f"{before} and {after}".replace("'", "")  # numbers are words here
            return f"at {float(was['now_s']):g} s: {', '.join(where)}: {values}"
    return ""


def _read(line: str) -> Any:
    """Numbers stay words: NaN is the same as NaN, and -0.0 is not 0.0."""
    return json.loads(line, parse_float=str, parse_int=str, parse_constant=str)


def _differ(
    one: Any, other: Any, where: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    if isinstance(one, dict) and isinstance(other, dict):
        for name in (*one, *(name for name in other if name not in one)):
            if one.get(name) != other.get(name):
                yield from _differ(one.get(name), other.get(name), (*where, name))
    elif (
        isinstance(one, list) and isinstance(other, list) and any(isinstance(x, dict) for x in one)
    ):
        for a, b in zip_longest(one, other):
            if a != b:
                yield from _differ(a, b, where)
    else:
        yield where, one, other
