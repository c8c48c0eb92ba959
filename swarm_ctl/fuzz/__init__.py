"""Scenarios drawn from a seed, what must hold in each of them, and golden traces."""
