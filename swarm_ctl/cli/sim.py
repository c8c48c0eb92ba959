"""`swarm-ctl sim`: simulated MAVLink vehicles on their own, for any client."""

from __future__ import annotations

import itertools
import json
import math
import signal
import subprocess
import sys
import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.launch.sim_config import place, simulator_config, vehicle_config

MAX_VEHICLES = 250
"""MAVLink's system ids end at 255; ground stations and companions need some."""


class Persona(StrEnum):
    """The firmware a vehicle plays."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


def sim(
    count: Annotated[int, typer.Option(min=1, max=MAX_VEHICLES, help="How many vehicles.")] = 1,
    persona: Annotated[Persona, typer.Option(help="The firmware they play.")] = Persona.ARDUPILOT,
    base_port: Annotated[
        int, typer.Option(min=1, max=65000, help="Vehicle i is on this port + i of 127.0.0.1.")
    ] = 14600,
    tcp: Annotated[bool, typer.Option("--tcp", help="TCP servers instead of UDP.")] = False,
    endpoint: Annotated[
        list[str] | None,
        typer.Option(
            help="udpin:, udpout: or tcpin:HOST:PORT of one vehicle; repeat it, in the vehicles' order."
        ),
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(
            help="Take vehicles, origin, starts, weather and faults from this mission file."
        ),
    ] = None,
    home: Annotated[
        str, typer.Option(help="LAT,LON,ALT of the first vehicle (degrees, metres).")
    ] = ("47.397742,8.545594,488"),
    spacing: Annotated[
        float, typer.Option(min=0.5, help="Metres between vehicles of the grid.")
    ] = 5.0,
    speedup: Annotated[
        float, typer.Option(min=0.1, max=100.0, help="Simulated seconds per second.")
    ] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 1,
    parameter: Annotated[
        list[str] | None,
        typer.Option(help="NAME=VALUE of a SIM_* parameter of all vehicles; repeat it."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="Write what truly happens there, a JSON object a line.")
    ] = None,
) -> None:
    """Run simulated ArduCopter or PX4 vehicles until Ctrl-C. Whoever writes to a vehicle's port is
    answered.

    Examples:

        swarm-ctl sim --count 3 --persona px4

        swarm-ctl sim --mission missions/hexagon.yaml --parameter SIM_WIND_SPD=4

        mavproxy.py --master udpout:127.0.0.1:14601
    """
    scheme = "tcpin" if tcp else "udpin"
    settings = (
        _in_grid(count, persona, _origin(home), spacing)
        if mission is None
        else _from_mission(mission)
    )
    vehicles = settings["vehicles"]
    if len(endpoint or []) > len(vehicles):
        raise InputError(
            f"--endpoint: {len(endpoint or [])} given for {len(vehicles)} vehicles; allowed: one a vehicle"
        )
    for vehicle, given in itertools.zip_longest(vehicles, endpoint or []):
        vehicle["endpoint"] = given or f"{scheme}:127.0.0.1:{base_port + vehicle['sysid']}"
    settings["sim_parameters"] |= dict(_parameter(text) for text in parameter or [])
    settings |= {"speedup": speedup, "epoch_s": Clock.starting_now(speedup).epoch_s, "seed": seed}
    settings["truth_path"] = None if truth is None else str(truth)
    _serve(settings, Console(highlight=False))


def _serve(settings: dict[str, Any], console: Console) -> None:
    """Starts the simulator, shows what listens where, and ends it at Ctrl-C."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sim.json"
        path.write_text(json.dumps(settings))
        command = [sys.executable, "-m", "sim", "--config", str(path)]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as child:
            stop = _Stop(child)
            ready = child.stdout.readline() if child.stdout is not None else ""
            if ready:
                _show(settings, console)
            code = child.wait()
            stop.restore()
    if code != 0 and not stop.asked:
        error = InputError if code == 2 else StartError
        raise error(f"the simulator ended with code {code}; its reason stands above")
    if stop.asked:
        console.print("ended")


class _Stop:
    """Ctrl-C and SIGTERM end the simulator, which finishes its truth file first."""

    def __init__(self, child: subprocess.Popen[str]) -> None:
        self.asked = False
        self._child = child
        self._before = {n: signal.signal(n, self._take) for n in (signal.SIGINT, signal.SIGTERM)}

    def _take(self, *_: object) -> None:
        self.asked = True
        self._child.terminate()

    def restore(self) -> None:
        """Puts the handlers back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)


def _show(settings: dict[str, Any], console: Console) -> None:
    table = Table(
        "vehicle", "persona", "endpoint", "a client connects to", box=None, pad_edge=False
    )
    for vehicle in settings["vehicles"]:
        kind, _, address = vehicle["endpoint"].partition(":")
        client = {"udpin": "udpout", "udpout": "udpin", "tcpin": "tcp"}[kind]
        table.add_row(
            str(vehicle["sysid"]), vehicle["persona"], vehicle["endpoint"], f"{client}:{address}"
        )
    console.print(table)
    console.print(
        f"{len(settings['vehicles'])} vehicles, speed-up {settings['speedup']:g}; Ctrl-C ends them"
    )


def _origin(home: str) -> Geodetic:
    try:
        lat, lon, alt = (float(part) for part in home.split(","))
    except ValueError:
        raise InputError(
            f"--home {home!r}: not a place; allowed: LAT,LON,ALT in degrees and metres"
        ) from None
    return Geodetic(lat, lon, alt)


def _in_grid(count: int, persona: Persona, origin: Geodetic, spacing_m: float) -> dict[str, Any]:
    vehicles = [
        vehicle_config(sysid, persona.value, "", start, origin)
        for sysid, start in enumerate(_grid(count, spacing_m), start=1)
    ]
    return {"version": 1, "origin": place(origin), "sim_parameters": {}, "vehicles": vehicles}


def _grid(count: int, spacing_m: float) -> list[tuple[float, float]]:
    """North and east of `count` places in a square."""
    side = math.isqrt(count - 1) + 1
    return [(i // side * spacing_m, i % side * spacing_m) for i in range(count)]


def _from_mission(path: Path) -> dict[str, Any]:
    """Settings of a mission's vehicles, all of them, those with an endpoint of their own too."""
    loaded = load(path)
    return simulator_config(loaded.plan, loaded.fleet.agents, loaded.file.simulation)


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--parameter {text!r}: not a setting; allowed: NAME=NUMBER") from None
