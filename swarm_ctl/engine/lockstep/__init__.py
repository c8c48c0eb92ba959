"""Lockstep: one mission clock for all processes of a run, which moves when all have done their
tick. docs/understand/lockstep.md has the whole."""
