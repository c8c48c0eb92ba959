"""From what is known of the others to the velocity that is flown: plain functions of numbers, and
of sequences of numbers.

An agent runs them as they are. A horizontal vector is the complex number north + 1j * east, in any
one unit of length. They keep to what numba compiles: numbers, sequences, NamedTuples; no objects,
no arrays of their own. State goes in and comes out.
"""
