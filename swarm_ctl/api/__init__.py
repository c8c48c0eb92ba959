"""Swarms from Python: `swarm_ctl.fly`. The page "From Python" has the table of all calls."""
