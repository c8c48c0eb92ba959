"""What `run` writes for its processes is what they read, to the last field."""

from __future__ import annotations

from pathlib import Path

from swarm_ctl.engine.gcs.config import GcsAddress, RelayConfig, RelayVehicle
from swarm_ctl.engine.launch_file import LAUNCH, Launch, read_launch, write_launch
from swarm_ctl.engine.lockstep.keeper import Rules
from swarm_ctl.engine.script import (
    AgentScript,
    Deed,
    Due,
    RunScript,
    ScriptedOrder,
    StationScript,
    Untruth,
)
from swarm_ctl.mesh.impaired import Impairment

WORD = "0badc0de"
FULL = Launch(
    show="dashboard",
    attach=("prometheus=9100",),
    tlog=True,
    autopilots=(2,),
    remembered=(3,),
    relay=RelayConfig(
        (
            RelayVehicle(1, 11, 250, "udpout:127.0.0.1:14601"),
            RelayVehicle(2, 12, 251, "udpout:127.0.0.1:14602", shared=True, secret=WORD),
        ),
        (GcsAddress("127.0.0.1", 14550, 14560),),
    ),
    keeper=Rules(0.05, ("simulator", "agent-1"), 5.0),
    script=RunScript(
        {
            1: AgentScript(
                (
                    Due(3.0, Deed.PART, names=("2", "station")),
                    Due(4.5, Deed.SAY, untruth=Untruth((1.0, -2.0), (("step", 7),))),
                ),
                Impairment(loss=0.1, delay_s=0.2),
                (1, 2, "station"),
                seed=1009,
                clock=(0.5, 1e-4),
            )
        },
        StationScript((ScriptedOrder(2.0, "hold"),), 90.0, 12.0),
        "happens: []\n",
    ),
)


def test_all_of_it_comes_back(tmp_path: Path) -> None:
    """Publishers stay numbers or words, and nobody else can read it: it has a secret."""
    write_launch(tmp_path, FULL)
    assert read_launch(tmp_path) == FULL
    assert (tmp_path / LAUNCH).stat().st_mode & 0o077 == 0


def test_who_shares_its_link() -> None:
    """The agent whose vehicle has no other link, at the port where the relay reaches it."""
    assert FULL.relay is not None
    assert FULL.relay.mirror_of(1) is None
    shared = FULL.relay.mirror_of(2)
    assert shared is not None
    assert (shared.port, shared.secret) == (14602, WORD)
