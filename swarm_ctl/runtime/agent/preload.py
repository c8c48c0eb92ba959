"""What the agents' forkserver imports once for all of them, then freezes: no collection in an agent
touches the pages of objects it shares with the others (7 MB an agent)."""

from __future__ import annotations

import gc

from swarm_ctl.runtime.agent import agent_process

ENTRY = agent_process.child_main

gc.collect()
gc.freeze()
