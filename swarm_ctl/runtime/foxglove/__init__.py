"""Foxglove's view of a swarm, recorded and live."""
