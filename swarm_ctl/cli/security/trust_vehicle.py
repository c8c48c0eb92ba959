"""`swarm-ctl trust vehicle`: the signing key of a vehicle, from its trust folder into it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm_ctl.cli.shared.options import endpoint_option, option, switch
from swarm_ctl.cli.shared.trust_folder import fleet_of, say, trust_folder
from swarm_ctl.errors import InputError
from swarm_ctl.trust.names import KeyHolder, Role

if TYPE_CHECKING:
    from swarm_ctl.mavlink.key_setup import KeyReport


def vehicle(
    agent: Annotated[int, option("ID", "The agent whose vehicle it is.", "--id")],
    endpoint: Annotated[
        str | None,
        endpoint_option("Where it is, e.g. serial:/dev/ttyACM0.  [default: as in the fleet]"),
    ] = None,
    fleet: Annotated[Path | None, option("FILE", "A fleet file, or a mission.")] = None,
    folder: Annotated[
        Path | None, option("FOLDER", "The trust folder.  [default: the fleet's, or the only one]")
    ] = None,
    sysid: Annotated[
        int | None, option("SYSID", "Its system id.  [default: the fleet's, or the agent's id]")
    ] = None,
    clear: Annotated[bool, switch("--clear", "Take the key off again.")] = False,
    over_network: Annotated[
        bool, switch("--over-network", "Send the key over a network, readable to all there.")
    ] = False,
) -> None:
    """Give a vehicle its MAVLink signing key, on the bench.

    It then checks that the vehicle takes no frame that is not signed with it. The key goes over the
    link as it is: use USB, or another cable. The vehicle must be disarmed. An ArduPilot takes
    unsigned frames on its first port, USB, all the same: connect the agent to another one.

    Exit codes: 0 set up, 1 the vehicle did not do it, 2 bad input, 3 no link.

    Examples:

    \b
        swarm-ctl trust vehicle --id 3 --endpoint serial:/dev/ttyACM0
        swarm-ctl trust vehicle --id 3 --fleet outdoors.yaml
        swarm-ctl trust vehicle --id 3 --endpoint serial:/dev/ttyACM0 --clear
    """
    from swarm_ctl.engine.vehicle_key import refuse_network, set_up

    entries = fleet_of(fleet).agents if fleet else ()
    entry = next((each for each in entries if each.id == agent), None)
    if fleet and entry is None:
        raise InputError(f"--id {agent}: {fleet} has {[each.id for each in entries]}")
    where = endpoint or (entry.endpoint if entry else None)
    if where is None:
        raise InputError(f"vehicle {agent} has no endpoint; allowed: --endpoint URL")
    if not over_network:
        refuse_network(where)
    number = sysid or (entry.sysid if entry else agent)
    keys = trust_folder(folder, fleet) / KeyHolder(Role.AGENT, str(agent)).folder
    report = set_up(where, number, keys, clear=clear)
    _show(report, number, clear=clear)
    raise typer.Exit(1 if report.trouble or (report.px4 and report.takes_unsigned) else 0)


def _show(report: KeyReport, sysid: int, *, clear: bool) -> None:
    if report.trouble:
        say(report.trouble)
    elif clear:
        say(f"vehicle {sysid}: {report.signs}, and takes frames of all")
    else:
        say(f"vehicle {sysid}: {report.signs}, and answers frames that are signed with it")
    if report.takes_unsigned:
        say(
            "on this port it takes unsigned frames, too, as an ArduPilot does on its first one"
            " (SERIAL0, USB): give the agent another port"
        )
    elif not clear and not report.trouble:
        say("an unsigned frame was ignored")
