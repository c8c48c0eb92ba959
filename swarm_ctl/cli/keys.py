"""`swarm-ctl keys`: the mesh's table of keys."""

from __future__ import annotations

from rich.console import Console

from swarm_ctl.mesh.keys import CHANNELS


def keys() -> None:
    """Show what goes over the mesh: key, payload, rate, quality of service, who."""
    console = Console(highlight=False)
    for channel in CHANNELS:
        qos = channel.qos
        service = ("reliable" if qos.reliable else "newest wins") + (
            ", urgent" if qos.urgent else ""
        )
        console.print(
            f"[bold]{channel.template}[/bold]  {channel.payload.__name__}", soft_wrap=True
        )
        console.print(f"    {channel.who}; {channel.rate}; {service}", soft_wrap=True)
