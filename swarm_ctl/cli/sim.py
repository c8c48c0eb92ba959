"""`swarm-ctl sim`: simulated MAVLink vehicles on their own, for any client."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from swarm_ctl.cli.console import PlainConsole
from swarm_ctl.cli.extras import require
from swarm_ctl.cli.options import Seed, Speedup
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.errors import InputError, StartError

_MOST_VEHICLES: Final = 250
"""MAVLink's system ids end at 255; ground stations and companions need some."""
_POLL_WALL_S: Final = 0.05


class Persona(StrEnum):
    """The firmware a vehicle plays."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


def sim(
    count: Annotated[int, typer.Option(min=1, max=_MOST_VEHICLES, help="How many vehicles.")] = 1,
    persona: Annotated[Persona, typer.Option(help="The firmware they play.")] = Persona.ARDUPILOT,
    base_port: Annotated[
        int,
        typer.Option(
            metavar="PORT", min=1, max=65000, help="Vehicle i listens on PORT + i of 127.0.0.1."
        ),
    ] = 14600,
    tcp: Annotated[bool, typer.Option("--tcp", help="TCP servers instead of UDP.")] = False,
    endpoint: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:HOST:PORT",
            help="Of one vehicle; KIND is udpin, udpout or tcpin. Repeat it for the next vehicle.",
        ),
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Take vehicles, starts, weather and faults from this mission."
        ),
    ] = None,
    home: Annotated[
        str,
        typer.Option(metavar="LAT,LON,ALT", help="Of the first vehicle: degrees, degrees, metres."),
    ] = "47.397742,8.545594,488",
    spacing: Annotated[
        float, typer.Option(metavar="METRES", min=0.5, help="Between neighbours on the grid.")
    ] = 5.0,
    speedup: Speedup = 1.0,
    seed: Seed = 1,
    parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="A SIM_* parameter of all vehicles; repeat it."),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the true positions: a JSON object a line."),
    ] = None,
) -> None:
    """Run simulated ArduCopter or PX4 vehicles until Ctrl-C.

    A vehicle answers any MAVLink client that writes to its port.

    Examples:

    \b
        swarm-ctl sim --count 3 --persona px4
        swarm-ctl sim --mission missions/hexagon.yaml --parameter SIM_WIND_SPD=4
        mavproxy.py --master udpout:127.0.0.1:14601
    """
    from swarm_ctl.runtime.clock import Clock
    from swarm_ctl.runtime.launch.sim_config import grid_config

    settings = (
        grid_config(count, persona.value, _origin(home), spacing)
        if mission is None
        else _from_mission(mission)
    )
    vehicles, endpoints = settings["vehicles"], endpoint or []
    if len(endpoints) > len(vehicles):
        raise InputError(
            f"--endpoint: {len(endpoints)} for {len(vehicles)} vehicles; allowed: one a vehicle"
        )
    scheme = "tcpin" if tcp else "udpin"
    for vehicle, given in itertools.zip_longest(vehicles, endpoints):
        vehicle["endpoint"] = given or f"{scheme}:127.0.0.1:{base_port + vehicle['sysid']}"
    settings["sim_parameters"] |= dict(_parameter(text) for text in parameter or [])
    settings |= {"speedup": speedup, "epoch_s": Clock.starting_now(speedup).epoch_s, "seed": seed}
    settings["truth_path"] = None if truth is None else str(truth)
    _serve(settings, PlainConsole())


def _serve(settings: dict[str, Any], console: PlainConsole) -> None:
    """Start the simulator, show where its vehicles listen, and end it at Ctrl-C."""
    from swarm_ctl.runtime.clock import pause
    from swarm_ctl.runtime.launch.interrupts import Interrupts

    with tempfile.TemporaryDirectory() as folder, Interrupts() as ctrl_c:
        path = Path(folder) / "sim.json"
        path.write_text(json.dumps(settings))
        command = [sys.executable, "-m", "sim", "--config", str(path)]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as child:
            if child.stdout is not None and child.stdout.readline():
                _show(settings, console)
            passed_on = 0
            while (code := child.poll()) is None:
                if ctrl_c.count > passed_on:
                    passed_on = ctrl_c.count
                    child.terminate()  # once a signal: it still has to finish its truth file
                pause(_POLL_WALL_S)
    if ctrl_c.count:
        console.say("ended")
    elif code != 0:
        error = InputError if code == 2 else StartError
        raise error(f"the simulator ended with code {code}; its reason stands above")


def _show(settings: dict[str, Any], console: PlainConsole) -> None:
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
    vehicles, factor = len(settings["vehicles"]), settings["speedup"]
    console.say(f"{vehicles} vehicles, speed-up {factor:g}; Ctrl-C ends them")


def _origin(home: str) -> Geodetic:
    try:
        lat, lon, alt = (float(part) for part in home.split(","))
    except ValueError:
        raise InputError(
            f"--home {home!r}: not a place; allowed: LAT,LON,ALT in degrees and metres"
        ) from None
    return Geodetic(lat, lon, alt)


def _from_mission(path: Path) -> dict[str, Any]:
    """Settings for all vehicles of a mission, those with an endpoint of their own too."""
    require("ground", "a mission file")
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.runtime.launch.sim_config import simulator_config

    loaded = load(path)
    return simulator_config(loaded.plan, loaded.fleet.agents, loaded.file.simulation)


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--parameter {text!r}: not a setting; allowed: NAME=NUMBER") from None
