"""What one law iteration costs: `python -m tests.bench.bench_law` (agent-steps a second on one
core, law only).

Three ways over the same random missions: `core.law.swarm_law` in numpy, a per-pair loop compiled by
numba (not a dependency: `pip install numba`), and the same loop in plain Python (on a few
missions). And a single agent's call of `core.law.formation_law.evaluate`, in microseconds.
Processor time, best of many; results of all ways are checked against each other.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable

import numpy as np

from swarm_ctl.core.law.formation_law import evaluate
from swarm_ctl.core.law.swarm_law import SwarmLaw
from swarm_ctl.core.model.plan import LawParameters

CASES = (
    (6, 10.0, LawParameters(r=4.5, r_out=1.5, r_in=0.5, h=0.05)),
    (32, 20.0, LawParameters(r=10.5, r_out=0.5, r_in=0.1, h=0.05)),
)
MISSIONS = (512, 2048)


def loop(points, slots, links, u, r, r_in, r_out, h, delta_l, delta_a):  # type: ignore[no-untyped-def]
    """(26), pair by pair (docs/pages/law.md#one-iteration): a first version. Arrays (m, n, 2),
    links (m, n, n)."""
    for mission in range(points.shape[0]):
        p, z, linked = points[mission], slots[mission], links[mission]
        for i in range(p.shape[0]):
            n_x = n_y = 0.0
            count = strangers = 0
            for j in range(p.shape[0]):
                if linked[i, j]:
                    n_x += (p[j, 0] - z[j, 0]) - (p[i, 0] - z[i, 0])
                    n_y += (p[j, 1] - z[j, 1]) - (p[i, 1] - z[i, 1])
                    count += 1
                elif j != i and (p[j, 0] - p[i, 0]) ** 2 + (p[j, 1] - p[i, 1]) ** 2 < r_out * r_out:
                    strangers += 1
            u_x, u_y = h / max(count, 1) * n_x, h / max(count, 1) * n_y
            for j in range(p.shape[0]):
                q_x, q_y = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1]
                xx = q_x * q_x + q_y * q_y
                if j == i or xx >= r_out * r_out:
                    continue
                x = math.sqrt(xx)
                g = 1.0 if x < r_in else 0.5 * (1 + math.cos(math.pi * (x - r_in) / (r_out - r_in)))
                members = count if linked[i, j] else strangers
                beta = h / members**2 if linked[i, j] else 0.0
                S, C = beta * (q_x * n_x + q_y * n_y), beta * (q_x * n_y - q_y * n_x)
                pull = beta * math.sqrt(n_x * n_x + n_y * n_y)
                d_ic = x / 2
                d_lb = r / (d_ic + 2 * members * math.sqrt((g + S) ** 2 + C * C) / x)
                d_ub = r / (d_ic + 2 * members * pull)
                d = d_lb + delta_l if d_lb < 2.0 else (d_lb + d_ub) / 2
                if d >= d_ub:
                    d = max(2.0, (d_lb + d_ub) / 2)
                sigma_lb = 0.0
                if d_ub - d_lb > 1e-12 * d_ub and d < d_ub:
                    R = (r / d - d_ic) / (2 * members)
                    root = math.sqrt(max(xx * R * R - C * C, 0.0))
                    alpha_ub = (R - pull) * (R + pull) / (S + root) if S > 0 else (root - S) / xx
                    sigma_lb = g / alpha_ub - xx
                alpha = g / (max(sigma_lb, 0.0) + delta_a + xx)
                u_x += alpha * q_x
                u_y += alpha * q_y
            u[mission, i, 0], u[mission, i, 1] = u_x, u_y


def best(call: Callable[[], object], times: int) -> float:
    """Least processor time [s] of `times` calls."""
    found = math.inf
    for _ in range(times):
        start = time.process_time()
        call()
        found = min(found, time.process_time() - start)
    return found


def swarms(
    n: int, m: int, side: float, law: LawParameters
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and slots (2, n, m) spread over a square, and the links by range a little
    earlier (n, n, m)."""
    random = np.random.default_rng(n)
    start, slots = random.random((2, n, m)) * side, random.random((2, n, m)) * side
    links = np.hypot(*(start[:, :, None] - start[:, None])) <= law.r
    links[np.arange(n), np.arange(n)] = False
    return start + random.normal(0.0, 0.5, start.shape), slots, links


def compare(
    n: int, m: int, side: float, law: LawParameters, compiled: Callable[..., None] | None
) -> None:
    """Print a row for n agents and m missions."""
    points, slots, links = swarms(n, m, side, law)
    swarm = SwarmLaw(slots, links, np.full(m, law.h), law)
    u, near = swarm.step(points)
    pairs = 0 if near is None else 2 * len(near.first) / (n * m)
    numbers = (law.r, law.r_in, law.r_out, law.h, law.delta_l, law.delta_a)
    arrays = tuple(np.ascontiguousarray(np.moveaxis(a, -1, 0)) for a in (points, slots, links))
    arrays = tuple(np.ascontiguousarray(a.transpose(0, 2, 1)) for a in arrays)
    rates = {"numpy": n * m / best(lambda: swarm.step(points), 200)}
    few = tuple(a[:4] for a in arrays)
    out = np.empty_like(arrays[0])
    rates["python"] = 4 * n / best(lambda: loop(*few, out[:4], *numbers), 5)
    if compiled is not None:
        compiled(*arrays, out, *numbers)
        if not np.allclose(out.transpose(2, 1, 0), u, rtol=1e-9, atol=1e-12):
            raise SystemExit("the ways do not agree")
        rates["numba"] = n * m / best(lambda: compiled(*arrays, out, *numbers), 200)
    row = "  ".join(f"{name} {rate / 1e6:9.4f} M/s" for name, rate in rates.items())
    share = f"  numpy/numba {rates['numpy'] / rates['numba']:.2f}" if "numba" in rates else ""
    print(f"n {n:3d}  missions {m:5d}  near others {pairs:.2f}  {row}{share}")


def single(pairs: int) -> float:
    """Microseconds of one agent's call among six, with 0 or 3 others inside r_out."""
    near = [(1.0, 0.0), (0.0, 1.2), (0.0, -1.0)]
    others = np.array(
        [[*near[:pairs], (3.0, 0.0), (0.0, 3.0), (2.0, 2.0), (-3.0, 0.0), (0.0, -3.0)][:5]]
    )
    slots = np.random.default_rng(1).random((1, 5, 2))
    yes = np.ones((1, 5), dtype=bool)
    arguments = (np.zeros((1, 2)), np.zeros((1, 2)), others, slots, yes, yes, yes, LawParameters())
    return best(lambda: [evaluate(*arguments) for _ in range(100)], 50) * 1e4


def main() -> None:
    """Print the table."""
    compiled: Callable[..., None] | None = None
    try:
        import numba

        compiled = numba.njit(loop)
    except ImportError:
        sys.stderr.write("numba is not installed: no compiled loop\n")
    for n, side, law in CASES:
        for m in MISSIONS:
            compare(n, m, side, law, compiled)
    print(
        f"one agent's call: {single(0):.1f} us with none near, {single(3):.1f} us with three near"
    )


if __name__ == "__main__":
    main()
