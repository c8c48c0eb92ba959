"""systemd's units of a host's agents and router: they do what a daemon of our own would have to.

They are units of the user who logs in over SSH, so nothing runs as root. None is started when the
host boots: a drone that is switched on does not fly before an operator has said so.
"""

from __future__ import annotations

from typing import Final

from swarm_ctl.runtime.deploy.manifest import ROOT, Manifest

AGENT_UNIT: Final = "swarm-ctl-agent@.service"
ROUTER_UNIT: Final = "swarm-ctl-router.service"
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


def agent_unit(manifest: Manifest) -> str:
    """The template of the host's agents; `%i` is the agent's id."""
    after = f"After={ROUTER_UNIT}\nWants={ROUTER_UNIT}\n" if manifest.router else ""
    command = " ".join(manifest.agent_words(_HOME, "%i"))
    return _AGENT.format(swarm=manifest.swarm, after=after, command=command, home=_HOME)


def router_unit(manifest: Manifest) -> str:
    """The unit of the host's router."""
    command = " ".join(manifest.router_words(_HOME))
    return _ROUTER.format(swarm=manifest.swarm, command=command, home=_HOME)
