"""A simulated vehicle's firmware alone, and whole worlds, on a virtual clock: no sockets, no
waiting."""

from __future__ import annotations

from typing import Any

from swarm_sim.config import SimConfig
from swarm_sim.firmware.ardupilot_persona import ArdupilotPersona
from swarm_sim.firmware.autopilot import AutopilotSetup, Contact
from swarm_sim.firmware.firmware import Firmware
from swarm_sim.firmware.flying.maneuvers import Sensed
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.px4_persona import Px4Persona
from swarm_sim.physics.geodesy import GeodeticPoint, TangentPlane
from swarm_sim.world.world import World

ORIGIN = GeodeticPoint(47.397742, 8.545594, 488.0)
GCS = (255, 190)
ON_GROUND = Sensed((10.0, 5.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, landed=True)
IN_AIR = Sensed((10.0, 5.0, -10.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, landed=False)
LOCAL_ORIGIN = (7.0, -3.0, 1.0)

ARM, TAKEOFF, SET_MODE, LAND_NOW = 400, 22, 176, 21
GUIDED, LAND, RTL, LOITER, BRAKE, AUTO = 4, 9, 6, 5, 17, 3
OFFBOARD, PX4_LAND, PX4_POSCTL = (6, 0), (4, 6), (3, 0)
VELOCITY_ONLY = 3527


def command_fields(command: int, *p: float, target: tuple[int, int] = (1, 1)) -> dict[str, Any]:
    """COMMAND_LONG's fields."""
    numbers = [*p, *[0.0] * (7 - len(p))]
    named = {f"param{i + 1}": float(v) for i, v in enumerate(numbers)}
    return named | {
        "command": command,
        "confirmation": 0,
        "target_system": target[0],
        "target_component": target[1],
    }


def setpoint_fields(
    vx: float, vy: float, vz: float, *, mask: int = VELOCITY_ONLY, frame: int = 1, **more: float
) -> dict[str, Any]:
    """SET_POSITION_TARGET_LOCAL_NED's fields."""
    rest = dict.fromkeys(("x", "y", "z", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    head = {
        "time_boot_ms": 0,
        "target_system": 1,
        "target_component": 1,
        "coordinate_frame": frame,
        "type_mask": mask,
    }
    return head | rest | {"vx": vx, "vy": vy, "vz": vz} | more


class Rig:
    """One firmware whose sensors the test holds in its hand."""

    def __init__(
        self,
        persona: type[ArdupilotPersona | Px4Persona],
        ready_after_s: float = 3.0,
        start: Sensed = ON_GROUND,
    ) -> None:
        self.contacts: list[Contact] = []
        setup = AutopilotSetup(
            1, TangentPlane(ORIGIN), start, LOCAL_ORIGIN, ready_after_s, lambda: self.contacts
        )
        self.firmware: Firmware = persona(setup, 0.0)
        self.now = 0.0
        self.sensed = start
        self.said: list[Message] = []

    def run(self, seconds: float, *, gcs: bool = False) -> None:
        """Lets time pass in steps of 50 ms; with `gcs`, a ground station's heartbeat each of
        them."""
        for _ in range(round(seconds / 0.05)):
            self.now = round(self.now + 0.05, 6)
            if gcs:
                self.tell("HEARTBEAT", type=6)
            self.firmware.run(self.now, self.sensed)
            self._listen()

    def tell(self, name: str, source: tuple[int, int] = GCS, **fields: Any) -> None:
        """Gives the firmware a message."""
        self.firmware.handle(Message(name, fields, source), self.now, self.sensed)
        self._listen()

    def ask(self, command: int, *p: float, target: tuple[int, int] = (1, 1)) -> int | None:
        """The result of a command; None without an answer."""
        self.said.clear()
        self.tell("COMMAND_LONG", **command_fields(command, *p, target=target))
        acks = [
            m.fields
            for m in self.said
            if m.name == "COMMAND_ACK" and m.fields["command"] == command
        ]
        assert len(acks) <= 1
        return acks[0]["result"] if acks else None

    def fly(self, vx: float, vy: float, vz: float, **more: Any) -> None:
        """A velocity setpoint."""
        self.tell("SET_POSITION_TARGET_LOCAL_NED", **setpoint_fields(vx, vy, vz, **more))

    def texts(self) -> list[str]:
        """STATUSTEXTs since the last `ask`."""
        return [m.fields["text"].decode() for m in self.said if m.name == "STATUSTEXT"]

    def heard(self, name: str) -> list[dict[str, Any]]:
        """Fields of all messages of this name since the last `ask`."""
        return [m.fields for m in self.said if m.name == name]

    def move(self, **changes: Any) -> None:
        """Changes what the sensors say."""
        self.sensed = self.sensed._replace(**changes)

    def _listen(self) -> None:
        self.said += [out.message for out in self.firmware.outbox]
        self.firmware.outbox.clear()


def config(
    n: int = 1, persona: str = "ardupilot", spacing_m: float = 10.0, **more: Any
) -> SimConfig:
    """`n` vehicles in a row to the north, ready at once, their estimates exact."""
    exact = {"SIM_GPS_DRIFT": 0.0, "SIM_VEL_NOISE": 0.0}
    more |= {"sim_parameters": exact | more.get("sim_parameters", {})}
    plane = TangentPlane(ORIGIN)
    places = [plane.geodetic_from_ned((spacing_m * i, 0.0, 0.0)) for i in range(n)]
    vehicles = [
        {
            "sysid": i + 1,
            "persona": persona,
            "endpoint": f"udpin:127.0.0.1:{14601 + i}",
            "lat_deg": p.lat_deg,
            "lon_deg": p.lon_deg,
            "alt_m": p.alt_m,
            "ready_after_s": 0.0,
        }
        for i, p in enumerate(places)
    ]
    origin = {"lat_deg": ORIGIN.lat_deg, "lon_deg": ORIGIN.lon_deg, "alt_m": ORIGIN.alt_m}
    return SimConfig.model_validate(
        {"version": 1, "epoch_s": 0.0, "origin": origin, "vehicles": vehicles} | more
    )


class Flight:
    """A world of vehicles that fly."""

    def __init__(self, settings: SimConfig) -> None:
        self.world = World(settings, 0.0)
        self.texts: list[str] = []

    def run(
        self, seconds: float, *, setpoint: dict[str, Any] | None = None, place: int = 0
    ) -> None:
        """Steps the world; with a setpoint, sends it to the vehicle at `place` at 20 Hz."""
        end = self.world.time_s + seconds - 1e-9
        k = 0
        while self.world.time_s < end:
            if setpoint is not None and k % 5 == 0:
                self.tell(
                    place,
                    "SET_POSITION_TARGET_LOCAL_NED",
                    **setpoint | {"target_system": place + 1},
                )
            k += 1
            self.world.step()
            self.collect()

    def tell(self, place: int, name: str, **fields: Any) -> list[Message]:
        """A message to one vehicle, and what it answers at once."""
        self.world.handle(place, Message(name, fields, GCS))
        return self.collect()

    def command(self, place: int, command: int, *p: float) -> int:
        """A command that must be answered."""
        fields = command_fields(command, *p, target=(place + 1, 1))
        answers = self.tell(place, "COMMAND_LONG", **fields)
        (result,) = [m.fields["result"] for m in answers if m.name == "COMMAND_ACK"]
        return int(result)

    def take_off(self, place: int = 0, height_m: float = 10.0) -> None:
        """Mode, arm, climb (without waiting for the height)."""
        if isinstance(self.world.vehicles[place].firmware, ArdupilotPersona):
            assert self.command(place, SET_MODE, 1, GUIDED) == 0
            assert self.command(place, ARM, 1) == 0
            assert self.command(place, TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0
        else:
            assert self.command(place, ARM, 1) == 0
            nan = float("nan")
            assert (
                self.command(place, TAKEOFF, 0, 0, 0, nan, nan, nan, ORIGIN.alt_m + height_m) == 0
            )

    def ned(self, place: int = 0) -> list[float]:
        """True position."""
        return [float(x) for x in self.world.positions()[place]]

    def velocity(self, place: int = 0) -> list[float]:
        """True velocity."""
        return [float(x) for x in self.world.velocities()[place]]

    def collect(self) -> list[Message]:
        """Empties all outboxes; keeps the texts."""
        said = [
            out.message for i in range(len(self.world.vehicles)) for out in self.world.outbox(i)
        ]
        self.texts += [m.fields["text"].decode() for m in said if m.name == "STATUSTEXT"]
        return said
