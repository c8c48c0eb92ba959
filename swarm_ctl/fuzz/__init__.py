"""Scenarios drawn from a seed, and what must hold in each of them."""
