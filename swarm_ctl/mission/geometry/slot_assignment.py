"""Who takes which slot, from plan data alone, so that everybody who computes it gets the same."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.law.formation import centred

Array: TypeAlias = npt.NDArray[np.float64]


def nearest(points: npt.ArrayLike, slots: npt.ArrayLike) -> Array:
    """The slots in the order of the points that makes the total squared distance least, centroids
    aligned; (n, 2).

    The law reaches the shape anywhere, so only the place within it counts: that is why the
    centroids are aligned.
    """
    # Here and not above: scipy takes 0.3 s to import, and most commands never ask for slots.
    from scipy.optimize import linear_sum_assignment

    targets = np.asarray(slots, dtype=np.float64)
    between = centred(points)[:, None, :] - centred(targets)[None, :, :]
    # Rounded, so that slots equally far away are chosen alike on machines whose last bits differ.
    cost = np.round(np.sum(between**2, axis=-1), 9)
    _, chosen = linear_sum_assignment(cost)
    return targets[chosen]
