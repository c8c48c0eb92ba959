"""`swarm-ctl target`: news of a target, from a receiver to the mesh."""
