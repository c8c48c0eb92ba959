"""What the forkserver imports once for all that `run` forks, then freezes: no collection in an
agent touches the pages of objects it shares with the others (7 MB an agent)."""

from __future__ import annotations

import gc

from swarm_ctl.engine.agent import agent_process
from swarm_ctl.engine.radio import link_process
from swarm_ctl.engine.router import router_process

ENTRIES = agent_process.child_main, router_process.child_main, link_process.child_main

gc.collect()
gc.freeze()
