"""Out of slow modes: each agent also moves slowly to where its slot is by the average error of all
agents that it hears.

The law's consensus runs along the links of N_i. Where the graph is long and thin, what is left of
an error has to travel from end to end, and takes minutes: the rate of the slowest mode is `kappa h`
times the second eigenvalue of the graph's normalised Laplacian, 0.01 and less for fifty agents. The
mesh carries each agent's state to all others, so an agent can see the average error itself:

    v_i += rate (mean_j e_j - e_i),     j: all agents that are heard and fly the same shape, and i

which adds `rate` to the decay of each mode but the common one, and does not move the mean of agents
that agree on it. It is a wish like the law's own: the filter has the last word. A swarm whose graph
was cut by a lost agent forms as well.
"""

from __future__ import annotations

from typing import Final

RATE: Final = 0.5
"""[1/s]: an eighth of the law's own, and slow against the age of any news that counts (0.5 s)."""


def pull(own: complex, total: complex, count: int) -> complex:
    """The velocity [length/s] for an error `own` among `count` others, whose errors sum up to
    `total`."""
    return RATE * ((total + own) * (1.0 / (count + 1)) - own)
