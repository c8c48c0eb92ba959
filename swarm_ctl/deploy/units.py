"""systemd's units of a host's agents and router: they do what a daemon of our own would have to.

The host itself makes them, of a bundle's manifest: a bundle is data and brings none.

They are units of the user who logs in over SSH, so nothing runs as root. None is started when the
host boots: a drone that is switched on does not fly before an operator has said so.
"""

from __future__ import annotations

from typing import Final

from swarm_ctl.deploy.manifest import ROOT, BundleManifest

_AGENT_UNIT: Final = "swarm-ctl-agent@.service"
_ROUTER_UNIT: Final = "swarm-ctl-router.service"
_HOME: Final = f"%h/{ROOT}"
"""systemd puts the user's home in."""

_AGENT: Final = """\
# Written by swarm-ctl deploy, which overwrites what is changed here.
[Unit]
Description=swarm-ctl: agent %i of {swarm}
{after}# Ended so three times in a minute, an agent is left alone: its vehicle lands by itself.
StartLimitIntervalSec=60
StartLimitBurst=3

[Service]
ExecStart={command}
# SIGINT lands the vehicle. An agent in the air is never killed, however long it needs.
KillSignal=SIGINT
SendSIGKILL=no
TimeoutStopSec=infinity
# One that a signal has ended (out of memory, a fault of a library) starts again at once and takes
# its vehicle over, if it stands in the air as it was left. One that has ended by its own word, or
# by an error in its code, which would come again, does not fly again: its vehicle lands.
Restart=on-abnormal
RestartSec=200ms
StandardOutput=append:{home}/flight/agent-%i.log
StandardError=inherit
"""

_ROUTER: Final = """\
# Written by swarm-ctl deploy, which overwrites what is changed here.
[Unit]
Description=swarm-ctl: router of {swarm} on this host
StartLimitIntervalSec=0

[Service]
ExecStart={command}
# It ends with its last client, after five minutes at most.
KillSignal=SIGINT
TimeoutStopSec=330
Restart=always
RestartSec=200ms
StandardOutput=append:{home}/flight/router.log
StandardError=inherit
"""


def units_of(manifest: BundleManifest) -> dict[str, str]:
    """The unit files of a host by name: the template of its agents, in which `%i` is the agent's
    id, and its router's, if it has one."""
    after = f"After={_ROUTER_UNIT}\nWants={_ROUTER_UNIT}\n" if manifest.router else ""
    words, swarm = " ".join(manifest.agent_words(_HOME, "%i")), manifest.swarm
    units = {_AGENT_UNIT: _AGENT.format(swarm=swarm, after=after, command=words, home=_HOME)}
    if manifest.router:
        words = " ".join(manifest.router_words(_HOME))
        units[_ROUTER_UNIT] = _ROUTER.format(swarm=swarm, command=words, home=_HOME)
    return units
