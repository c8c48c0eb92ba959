"""`swarm-ctl link`: one radio, shared by the agents of all vehicles behind it."""

from __future__ import annotations

import dataclasses
import json
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from swarm_ctl.cli.flight.agent import plan_and_fleet
from swarm_ctl.cli.shared.options import FleetFile, option, switch
from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.errors import InputError

if TYPE_CHECKING:
    from swarm_ctl.engine.radio.load import RadioLoad, VehicleLoad

_RADIO: Final = "Which radio: an endpoint that agents of the fleet share.  [default: the only one]"
_BYTES: Final = (
    "What the radio carries, both directions together.  [default: the fleet's, a tenth of the baud"
    " rate]"
)
_FRESH_S: Final = 1.0
_COLUMNS: Final = (
    "agent",
    "sysid",
    "up/s",
    "setpoints",
    "down/s",
    "bytes/s",
    "share",
    "thinned",
    "dropped",
    "late",
    "newest",
)


def link(
    file: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan file, or a mission file (needs ground).")
    ],
    radio: Annotated[str | None, option("URL", _RADIO)] = None,
    fleet: FleetFile = None,
    bytes_per_s: Annotated[
        int | None, typer.Option(metavar="N", help=_BYTES, min=200, max=10_000_000)
    ] = None,
    headless: Annotated[bool, switch("--headless", "A line every ten seconds; no table.")] = False,
    as_json: Annotated[bool, switch("--json", "A JSON line each half second; no table.")] = False,
) -> None:
    """Share one telemetry radio between several agents.

    Several agents of the fleet have the same endpoint: the radio's. This process alone opens it,
    and passes frames by MAVLink system id. It keeps within what the radio carries: setpoints
    first, newest alone, then heartbeats, then requests. `run` starts its own; for agents that are
    started by hand, start this first. When it ends, the vehicles' own failsafes act. Ctrl-C ends
    it once no agent speaks; a second one at once.

    Examples:

    \b
        swarm-ctl link plan.json
        swarm-ctl link triangle.yaml --fleet outdoors.yaml --bytes-per-s 4000
        swarm-ctl link plan.json --radio serial:/dev/ttyUSB0:57600 --json
    """
    from swarm_ctl.engine.lifeline import SignalLifeline
    from swarm_ctl.engine.radio.link_process import LinkConfig, run_link, told
    from swarm_ctl.mission.fleet.exposure import exposed_links, refuse_exposed
    from swarm_ctl.signals import ENDED_CODE

    _, entries = plan_and_fleet(file, fleet)
    agents = _behind(entries, radio)
    refuse_exposed(exposed_links(Fleet(agents, None, entries.signing)), str(fleet or file), "")
    config = LinkConfig(agents, entries.signing is SigningPolicy.REQUIRED, bytes_per_s)

    class Lifeline(SignalLifeline):
        """A second Ctrl-C does not wait."""

        def _signalled(self, number: int, frame: object) -> None:
            if self._cut and number == signal.SIGINT:
                raise SystemExit(ENDED_CODE)
            super()._signalled(number, frame)
            told("ends when no agent speaks; Ctrl-C again: at once")

        def tell(self, text: str) -> None:
            told(text)

    with ExitStack() as opened:
        show = _json_line if as_json else _Lines() if headless else _table(opened)
        raise typer.Exit(run_link(config, Lifeline(), show))


def _behind(fleet: Fleet, radio: str | None) -> tuple[FleetAgent, ...]:
    """The agents of one radio."""
    radios = fleet.radios()
    if not radios:
        raise InputError(
            "no endpoint of the fleet is shared, so no agent needs a link; allowed: several agents"
            " with the same endpoint (serial:/dev/ttyUSB0:57600)"
        )
    name = radio if radio is not None or len(radios) > 1 else next(iter(radios))
    if name not in radios:
        what = "which radio?" if name is None else f"--radio {name}: no agents share it"
        raise InputError(f"{what}; allowed: --radio with one of {', '.join(radios)}")
    return radios[name]


def _json_line(load: RadioLoad) -> None:
    sys.stdout.write(json.dumps(dataclasses.asdict(load)) + "\n")
    sys.stdout.flush()


class _Lines:
    """A line now and then, for a log."""

    _EVERY: Final = 20

    def __init__(self) -> None:
        self._count = 0

    def __call__(self, load: RadioLoad) -> None:
        if self._count % self._EVERY == 0:
            heard = [v for v in load.vehicles if v.age_s is not None and v.age_s < _FRESH_S]
            setpoints = "/".join(str(vehicle.setpoints_per_s) for vehicle in load.vehicles)
            sys.stdout.write(
                f"{load.radio}: {_used(load)}; {len(heard)} of {len(load.vehicles)} vehicles"
                f" heard; setpoints/s {setpoints}\n"
            )
            sys.stdout.flush()
        self._count += 1


def _table(opened: ExitStack) -> Callable[[RadioLoad], None]:
    """A table that stays in its place on the terminal."""
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table

    live = opened.enter_context(Live(console=Console(), auto_refresh=False, screen=False))

    def show(load: RadioLoad) -> None:
        table = Table(
            title=f"{load.radio}: {_used(load)}", caption=_caption(load), box=None, pad_edge=False
        )
        table.padding = 0, 1, 0, 0
        for column in _COLUMNS:
            table.add_column(column, justify="right", no_wrap=True)
        for vehicle in load.vehicles:
            old = vehicle.age_s is None or vehicle.age_s >= _FRESH_S
            table.add_row(*_cells(vehicle, load), style="red" if old else "")
        live.update(table, refresh=True)

    return show


def _cells(vehicle: VehicleLoad, load: RadioLoad) -> list[str]:
    counted: list[Any] = [
        vehicle.agent,
        vehicle.sysid,
        vehicle.up_frames_per_s,
        vehicle.setpoints_per_s,
        vehicle.down_frames_per_s,
        vehicle.bytes_per_s,
        f"{100 * vehicle.bytes_per_s / load.bytes_per_s:.0f} %",
        vehicle.thinned,
        vehicle.dropped,
        vehicle.late,
        "-" if vehicle.age_s is None else f"{vehicle.age_s:.2f} s",
    ]
    return list(map(str, counted))


def _used(load: RadioLoad) -> str:
    share = 100 * load.used_bytes_per_s / load.bytes_per_s
    return f"{load.used_bytes_per_s} of {load.bytes_per_s} bytes/s, {share:.0f} %"


def _caption(load: RadioLoad) -> str:
    words = [f"{load.foreign} frames of other systems, {load.bad} runs of bytes that are no frame"]
    return "; ".join([load.trouble, *words] if load.trouble else words)
