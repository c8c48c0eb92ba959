"""`swarm-ctl keys`: the mesh's table of keys."""

from __future__ import annotations

from swarm_ctl.cli.shared.console import PlainConsole


def keys() -> None:
    """Show what is sent on the mesh, key by key.

    For each key: its payload, sender and receivers, rate and quality of service.

    Example:

    \b
        swarm-ctl keys
    """
    from swarm_ctl.mesh.keys import CHANNELS

    console = PlainConsole()
    for channel in CHANNELS:
        service = "reliable" if channel.qos.reliable else "newest wins"
        urgent = ", urgent" if channel.qos.urgent else ""
        console.say(f"{channel.template}  {channel.payload.__name__}", style="bold")
        console.say(f"    {channel.route}; {channel.rate}; {service}{urgent}")
