"""`swarm-ctl keys`: the mesh's table of keys."""

from __future__ import annotations

from swarm_ctl.cli.shared.console import PlainConsole


def keys() -> None:
    """Show what is sent on the mesh, key by key.

    For each key: its payload, sender and receivers, rate, quality of service and encoding. Then the
    liveliness tokens, and what a station answers.

    Example:

    \b
        swarm-ctl keys
    """
    from swarm_ctl.mesh.keys import CHANNELS, alive_key, plan_key
    from swarm_ctl.mesh.payloads import is_json

    console = PlainConsole()
    for channel in CHANNELS:
        service = "reliable" if channel.qos.reliable else "newest wins"
        urgent = ", urgent" if channel.qos.urgent else ""
        encoding = "application/json" if is_json(channel.payload) else "zenoh/bytes"
        console.say(f"{channel.template}  {channel.payload.__name__}", style="bold")
        console.say(f"    {channel.route}; {channel.rate}; {service}{urgent}; {encoding}")
    for kind in ("agent", "station", "router"):
        console.say(f"{alive_key('{swarm}', kind, '{id}')}  liveliness token", style="bold")
        console.say(f"    {kind} -> other tools; while its process is on the mesh")
    console.say(f"{plan_key('{swarm}', '{id}')}  queryable", style="bold")
    console.say(
        "    station -> agents that fetch their plan; when asked; application/gzip, of JSON"
    )
