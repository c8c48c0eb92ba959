"""`swarm-ctl keys`: the mesh's table of keys."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from swarm_ctl.mesh.keys import CHANNELS


def keys() -> None:
    """Show what goes over the mesh: key, payload, rate, quality of service, who."""
    table = Table("key", "payload", "rate", "reliable", "urgent", "who")
    for channel in CHANNELS:
        qos = channel.qos
        table.add_row(
            channel.template,
            channel.payload.__name__,
            channel.rate,
            "yes" if qos.reliable else "no",
            "yes" if qos.urgent else "no",
            channel.who,
        )
    Console(highlight=False).print(table)
