"""A whole swarm in one process on a virtual clock: scenarios, what flies them, what judges them."""
