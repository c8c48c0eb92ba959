"""ArduCopter and PX4 themselves for tests: missions on them, vehicles without agents, and a MAVLink
client beside the agents."""

from __future__ import annotations

import contextlib
import json
import math
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import pytest
import yaml
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.engine.launch.processes import VehiclesChild, wait_all, wait_ready
from swarm_ctl.engine.vehicles.binaries import find
from swarm_ctl.engine.vehicles.order import (
    ORDERS,
    ORDERS_JSON,
    STARTED,
    STARTED_JSON,
    Orders,
    Started,
    VehicleOrder,
)
from swarm_ctl.errors import StartError
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.modes import COPTER_MODES, PX4_MODES
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.wires import open_wire
from tests.system.running import ROOT, Running

MISSIONS = ROOT / "missions"
PAIR = Path(__file__).with_name("pair.yaml")
HERE = Geodetic(-35.363262, 149.165237, 584.0)
GROUND_STATION = 255
"""The system id of QGroundControl and MAVProxy."""
_GROUND_STATIONS_HEARTBEAT = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)


def needed(kinds: str) -> None:
    """Skip the test, with the reason, where an autopilot that `kinds` names is not found."""
    for kind in (VehicleKind.ARDUCOPTER, VehicleKind.PX4):
        if kind in kinds:
            try:
                find(kind)
            except StartError as error:
                pytest.skip(str(error))


class Flight(Running):
    """`swarm-ctl run` with autopilots; `cwd` is empty."""

    def __init__(
        self, mission: str | Path, vehicles: str, *, cwd: Path, speedup: float = 1.0, more: str = ""
    ) -> None:
        needed(vehicles)
        path = MISSIONS / mission if isinstance(mission, str) else mission
        options = ("--headless", "--no-report", "--speedup", str(speedup), *more.split())
        super().__init__("run", path, "--vehicles", vehicles, *options, cwd=cwd)

    @property
    def started(self) -> dict[int, Started]:
        """The autopilots, by agent."""
        path = self.folder / "vehicles" / STARTED
        return {each.agent: each for each in STARTED_JSON.validate_json(path.read_bytes())}

    def wait_for_step(self, step: int) -> None:
        """Until every agent has begun the mission's step of this number."""
        self.wait_for(lambda: f"step {step}/" in self.output, 240.0)

    def client(self, agent: int, system: int = GROUND_STATION) -> Client:
        """A client on the ground-station port of an agent's vehicle."""
        return Client(self.started[agent], system)

    def outcomes(self) -> dict[int, str]:
        """Of each agent."""
        return {each["agent"]: each["outcome"] for each in self.summary()["agents"]}

    def assert_completed(self) -> None:
        """It ends, completed, with nothing left behind."""
        code = self.wait(240.0)
        self.assert_nothing_left()
        assert code == 0, self.output + self._autopilots_words()
        assert set(self.outcomes().values()) == {"completed"}, self.output

    def _autopilots_words(self) -> str:
        """The end of what each autopilot printed: why it did what it did."""
        logs = sorted((self.folder / "vehicles").glob("*/output.log"))
        ends = (log.read_text(errors="replace")[-2000:] for log in logs)
        return "".join(f"\n--- {log}\n{end}" for log, end in zip(logs, ends, strict=True))

    def assert_nothing_left(self, seconds: float = 10.0) -> None:
        super().assert_nothing_left(seconds)
        end = time.monotonic() + seconds  # for init to take the codes of those that were killed
        for each in self.started.values():
            while Path(f"/proc/{each.pid}").exists():
                assert time.monotonic() < end, each
                time.sleep(0.05)
            if each.kind is VehicleKind.PX4:
                assert not Path(f"/tmp/px4-sock-{each.instance}").exists()  # noqa: S108

    def reasons(self) -> dict[int, str]:
        """Why each agent ended as it did."""
        return {each["agent"]: each["reason"] or "" for each in self.summary()["agents"]}

    def events(self) -> list[dict[str, Any]]:
        """All events of the run."""
        lines = (self.folder / "events.jsonl").read_text().splitlines()
        return [json.loads(line) for line in lines]


@contextlib.contextmanager
def standing(
    kinds: Sequence[VehicleKind],
    folder: Path,
    speedup: float = 1.0,
    origin: Geodetic = HERE,
    sysids: Sequence[int] = range(1, 256),
) -> Iterator[dict[int, Started]]:
    """Autopilots without agents, ready to arm, ten metres apart to the east. They end with the
    block."""
    needed(" ".join(kinds))
    places = [geodetic_from_ned((0.0, 10.0 * k, 0.0), origin) for k in range(len(kinds))]
    orders = tuple(
        VehicleOrder(k + 1, sysids[k], kind, find(kind), place)
        for k, (kind, place) in enumerate(zip(kinds, places, strict=True))
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ORDERS).write_bytes(ORDERS_JSON.dump_json(Orders(speedup, orders)))
    child = VehiclesChild(folder, folder / "vehicles.log")
    try:
        assert not wait_ready([child], 180.0), (folder / "vehicles.log").read_text()
        yield {each.agent: each for each in child.started()}
    finally:
        child.kill()
        wait_all([child], 10.0)


def alone(folder: Path, vehicle: Started, endpoint: str = "") -> Path:
    """A mission of one agent for a standing vehicle, over its own endpoint or another."""
    mission = yaml.safe_load(PAIR.read_text()) | {"prepare_timeout_s": 20}
    del mission["agents"][1]
    entry = {"id": 1, "sysid": vehicle.sysid, "autopilot": vehicle.kind.autopilot}
    mission["fleet"] = {"agents": [entry | {"endpoint": endpoint or vehicle.endpoint}]}
    path = folder / "alone.yaml"
    path.write_text(yaml.safe_dump(mission))
    return path


class Client:
    """A MAVLink client, such as a ground station, beside an agent. A thread listens, and sends a
    heartbeat a second once `beat` has been called."""

    def __init__(self, vehicle: Started, system: int = GROUND_STATION) -> None:
        self.sysid = vehicle.sysid
        copter = vehicle.kind is VehicleKind.ARDUCOPTER
        self.modes = COPTER_MODES if copter else PX4_MODES
        self.armed: bool | None = None
        self.mode = ""
        self.height_m: float | None = None
        self.speed_mps = 0.0
        """Horizontal."""
        self.texts: list[str] = []
        self.parameters: dict[str, tuple[float, int]] = {}
        """Values as sent, and MAV_PARAM_TYPE."""
        self._px4 = not copter
        self._wire = open_wire(vehicle.ground_station)
        self._codec = dialect.MAVLink(None, system, dialect.MAV_COMP_ID_MISSIONPLANNER)
        self._lock = threading.Lock()
        self._beats = self._ended = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        # A first frame makes its port known to PX4; positions are asked for until they come.
        self.wait_for(lambda: None not in (self.armed, self.height_m), self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()
        self._wire.close()

    def beat(self, on: bool = True) -> None:
        """Send heartbeats from now on, or no more."""
        self._beats = on

    def send(self, message: Any) -> None:
        with self._lock, contextlib.suppress(OSError):
            data = message.pack(self._codec)
            self._codec.seq = (self._codec.seq + 1) & 0xFF
            self._wire.write(data, time.monotonic())

    def command(self, number: int, *parameters: float) -> None:
        """COMMAND_LONG to the autopilot."""
        self.send(outgoing.command(self.sysid, number, *parameters))

    def take_mode(self, mode: str) -> None:
        """Bring the vehicle into a mode, as a pilot's ground station does."""
        self.wait_for(
            lambda: self.mode == mode, lambda: self.send(self.modes.command(self.sysid, mode))
        )

    def get(self, name: str) -> float:
        """A parameter's value now."""
        self.parameters.pop(name, None)
        self.wait_for(
            lambda: name in self.parameters,
            lambda: self.send(outgoing.read_parameter(self.sysid, name)),
        )
        value, kind = self.parameters[name]
        if self._px4 and kind != dialect.MAV_PARAM_TYPE_REAL32:
            return float(struct.unpack("<i", struct.pack("<f", value))[0])
        return value

    def set(self, name: str, value: float) -> None:
        """Set a parameter, and see it confirmed."""
        self.get(name)
        kind = self.parameters[name][1]
        if self._px4 and kind != dialect.MAV_PARAM_TYPE_REAL32:
            (wire,) = struct.unpack("<f", struct.pack("<i", int(value)))
        else:
            wire = value
        message = outgoing.set_parameter(self.sysid, name, wire, kind)
        self.wait_for(lambda: self.get(name) == pytest.approx(value), lambda: self.send(message))

    def wait_for(
        self,
        condition: Callable[[], bool],
        again: Callable[[], None] = lambda: None,
        seconds: float = 20.0,
    ) -> float:
        """Wait, and do `again` each half second; the wall seconds that it took."""
        begun = time.monotonic()
        due = begun
        while not condition():
            now = time.monotonic()
            assert now < begun + seconds, (self.mode, self.armed, self.height_m, self.texts[-5:])
            if now >= due:
                due = now + 0.5
                again()
            time.sleep(0.02)
        return time.monotonic() - begun

    def hear_often(self) -> None:
        """Five heartbeats a second, so that a mode is seen soon."""
        self.send(outgoing.interval(self.sysid, dialect.MAVLINK_MSG_ID_HEARTBEAT, 5.0))

    def _ask(self) -> None:
        self.send(outgoing.interval(self.sysid, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 5.0))

    def _listen(self) -> None:
        framer, due = Framer(), 0.0
        while not self._ended:
            now = time.monotonic()
            with contextlib.suppress(OSError):
                while (chunk := self._wire.read(now)) is not None:
                    for frame in framer.feed(chunk):
                        if (frame.system, frame.component) == (self.sysid, 1):
                            self._take(dialect.MAVLink(None).decode(bytearray(frame.raw)))
            if self._beats and now >= due:
                due = now + 1.0
                self.send(_GROUND_STATIONS_HEARTBEAT)
            time.sleep(0.01)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            self.mode = self.modes.name(message.custom_mode)
        elif kind == "LOCAL_POSITION_NED":
            self.height_m = -message.z
            self.speed_mps = math.hypot(message.vx, message.vy)
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "PARAM_VALUE":
            self.parameters[message.param_id] = (message.param_value, message.param_type)
