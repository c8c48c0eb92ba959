"""`swarm-ctl sim`: simulated MAVLink vehicles on their own, for any client."""

from __future__ import annotations

import itertools
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import OpenMesh, Seed, Speedup, mission_option, option, switch
from swarm_ctl.core.model.fleet import SigningPolicy
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

_MOST_VEHICLES: Final = 250
"""MAVLink's system ids end at 255; ground stations and companions need some."""


class Persona(StrEnum):
    """The firmware a vehicle plays."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


def sim(
    count: Annotated[int, option("NUMBER", "How many vehicles.", min=1, max=_MOST_VEHICLES)] = 1,
    persona: Annotated[Persona, typer.Option(help="The firmware they play.")] = Persona.ARDUPILOT,
    base_port: Annotated[
        int, option("PORT", "Vehicle i listens on PORT + i of 127.0.0.1.", min=1, max=65000)
    ] = 14600,
    tcp: Annotated[bool, switch("--tcp", "TCP servers instead of UDP.")] = False,
    endpoint: Annotated[
        list[str] | None,
        option("KIND:HOST:PORT", "Of one vehicle: udpin, udpout or tcpin. Repeat it for the next."),
    ] = None,
    mission: Annotated[
        Path | None, mission_option("Take vehicles, starts, weather and faults from this mission.")
    ] = None,
    fleet: Annotated[
        Path | None,
        option("FILE", "With --mission: a fleet file instead of its own, with its signing keys."),
    ] = None,
    home: Annotated[
        str, option("LAT,LON,ALT", "Of the first vehicle: degrees, degrees, metres.")
    ] = "47.397742,8.545594,488",
    spacing: Annotated[float, option("METRES", "Between neighbours on the grid.", min=0.5)] = 5.0,
    speedup: Speedup = 1.0,
    seed: Seed = 1,
    parameter: Annotated[
        list[str] | None, option("NAME=VALUE", "A SIM_* parameter of all vehicles; repeat it.")
    ] = None,
    truth: Annotated[
        Path | None, option("FILE", "Write the true positions: a JSON object a line.")
    ] = None,
    once: Annotated[
        bool, switch("--once", "End when vehicles have flown and all stand disarmed for 10 s.")
    ] = False,
    open_mesh: OpenMesh = False,
) -> None:
    """Run simulated ArduCopter or PX4 vehicles until Ctrl-C.

    A vehicle answers any MAVLink client that writes to its port.

    Examples:

    \b
        swarm-ctl sim --count 3 --persona px4
        swarm-ctl sim --mission missions/hexagon.yaml --parameter SIM_WIND_SPD=4
        mavproxy.py --master udpout:127.0.0.1:14601
    """
    from swarm_ctl.engine.clock import Clock
    from swarm_ctl.engine.launch.sim_config import grid_config, serve
    from swarm_ctl.mission.fleet.exposure import listens_wide

    if fleet is not None and mission is None:
        raise InputError(f"--fleet {fleet} without a mission; allowed: with --mission FILE")
    settings = (
        grid_config(count, persona.value, _origin(home), spacing)
        if mission is None
        else _from_mission(mission, fleet)
    )
    vehicles, endpoints = settings["vehicles"], endpoint or []
    if len(endpoints) > len(vehicles):
        raise InputError(
            f"--endpoint: {len(endpoints)} for {len(vehicles)} vehicles; allowed: one a vehicle"
        )
    scheme = "tcpin" if tcp else "udpin"
    for vehicle, given in itertools.zip_longest(vehicles, endpoints):
        vehicle["endpoint"] = given or f"{scheme}:127.0.0.1:{base_port + vehicle['sysid']}"
        if listens_wide(vehicle["endpoint"]) and not open_mesh:
            raise InputError(
                f"--endpoint {given}: any computer could command vehicle {vehicle['sysid']};"
                " allowed: loopback addresses, or --open-mesh"
            )
    settings["sim_parameters"] |= dict(_parameter(text) for text in parameter or [])
    settings |= {"speedup": speedup, "epoch_s": Clock.starting_now(speedup).epoch_s, "seed": seed}
    settings |= {"truth_path": None if truth is None else str(truth), "once": once}
    console = PlainConsole()
    serve(settings, ready=lambda: _show(settings, console))
    console.say("ended")


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


def _from_mission(path: Path, fleet: Path | None) -> dict[str, Any]:
    """Settings for all vehicles of a mission, those with an endpoint of their own too; with their
    keys where the fleet wants frames signed."""
    require("ground", "a mission file")
    from swarm_ctl.engine.launch.sim_config import simulator_config
    from swarm_ctl.engine.protection import agent_identity_folder
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.trust.identity import MAVLINK_KEY

    loaded = load(path, fleet=fleet)
    agents, trust = loaded.fleet.agents, loaded.fleet.trust
    settings = simulator_config(loaded.plan, agents, loaded.file.simulation)
    if loaded.fleet.signing is SigningPolicy.REQUIRED:
        for agent, vehicle in zip(agents, settings["vehicles"], strict=True):
            keys = agent_identity_folder(trust, agent.id)
            vehicle["signing_key_path"] = None if keys is None else str(keys / MAVLINK_KEY)
    return settings


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--parameter {text!r}: not a setting; allowed: NAME=NUMBER") from None
