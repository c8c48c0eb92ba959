"""Draws the moving picture of the README from a flight on the virtual clock.

    python -m tests.unit.docs.flight_picture docs/pictures/flight.svg

Real agents, real drivers and the simulator; what is drawn are the true positions. Each drone is a
disc of diameter `r_in`: two discs that touch would be too close.
"""

from __future__ import annotations

import argparse
import colorsys
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarm_ctl.mission.compile.loader import load
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.unit.plans import steps_of

WIDTH: Final = 640
HEIGHT: Final = 520
"""Both at most."""
MARGIN_M: Final = 6.0
CAPTION: Final = 34
SAMPLE_S: Final = 0.25
SPEED: Final = 5.0
"""Mission seconds per second of the picture."""
REST_S: Final = 8.0
"""Mission seconds for which the last moment stays."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One moment: where the drones are (north, east) [m], and what the swarm does."""

    time_s: float
    points: tuple[tuple[float, float], ...]
    step: str

    @property
    def closest_m(self) -> float:
        """The smallest distance of two drones now."""
        pairs = ((a, b) for i, a in enumerate(self.points) for b in self.points[:i])
        return min(math.dist(a, b) for a, b in pairs)


def fly(mission: Path, until_s: float = 900.0) -> tuple[list[Sample], float]:
    """The moments of a flight from the take-off until the landing begins, and its `r_in` [m]."""
    swarm = VirtualSwarm(load(mission))
    plan, samples, due_s = swarm.plan, list[Sample](), 0.0
    swarm.wait(lambda s: s.in_step(1))
    begun_s = swarm.now + plan.tick_s
    while swarm.now < until_s and not swarm.in_step(len(steps_of(plan))):
        swarm.tick()
        if swarm.now < due_s:
            continue
        due_s = swarm.now + SAMPLE_S
        steps = [m.status.step for m in swarm.members.values() if m.status is not None]
        name = plan.groups[0].step_name(min(steps))
        samples.append(Sample(swarm.now - begun_s, tuple(swarm.positions().values()), name))
    return samples, plan.law.r_in * plan.unit_m


def draw(samples: list[Sample], r_in_m: float, title: str) -> str:
    """The picture as SVG text."""
    norths = [north for sample in samples for north, _ in sample.points]
    easts = [east for sample in samples for _, east in sample.points]
    top, left = max(norths) + MARGIN_M, min(easts) - MARGIN_M
    wide_m, high_m = max(easts) + MARGIN_M - left, top - min(norths) + MARGIN_M
    scale = min(WIDTH / wide_m, (HEIGHT - CAPTION) / high_m)
    width, height = max(round(wide_m * scale), 300), round(high_m * scale) + CAPTION
    last_s = samples[-1].time_s + REST_S
    length = f'dur="{last_s / SPEED:.1f}s" repeatCount="indefinite"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"',
        ' font-family="sans-serif" font-size="13">',
        f"<title>{title}</title>",
        f'<rect width="{width}" height="{height}" rx="8" fill="#10182a"/>',
    ]
    times = ";".join(f"{sample.time_s / last_s:.4f}" for sample in samples) + ";1"
    for k in range(len(samples[0].points)):
        red, green, blue = colorsys.hls_to_rgb(k / len(samples[0].points), 0.65, 0.8)
        color = f"rgb({255 * red:.0f},{255 * green:.0f},{255 * blue:.0f})"
        places = [
            f"{(sample.points[k][1] - left) * scale:.1f} {(top - sample.points[k][0]) * scale:.1f}"
            for sample in samples
        ]
        way, places = " ".join(dict.fromkeys(places)), [*places, places[-1]]
        lines += [
            f'<polyline points="{way}" fill="none" stroke="{color}" stroke-opacity=".2"/>',
            f'<circle r="{r_in_m / 2 * scale:.1f}" fill="{color}"',
            f' transform="translate({places[-1]})">',
            f'<animateTransform attributeName="transform" type="translate" {length}',
            f' keyTimes="{times}" values="{";".join(places)}"/></circle>',
        ]
    lines += _captions(samples, last_s, height - 12, length)
    return "\n".join([*lines, "</svg>", ""])


def _captions(samples: list[Sample], last_s: float, y: int, length: str) -> list[str]:
    """One line of text a second, each visible while it is true."""
    shown = samples[:: round(1 / SAMPLE_S)]
    lines = []
    for k, sample in enumerate(shown):
        last = k + 1 == len(shown)
        begin = max(sample.time_s / last_s, 1e-5)
        end = 0.99999 if last else shown[k + 1].time_s / last_s
        text = f"{sample.time_s:.0f} s · {sample.step} · closest pair {sample.closest_m:.1f} m"
        before, after = ("visible" if k == 0 else "hidden"), ("visible" if last else "hidden")
        lines += [
            f'<text x="12" y="{y}" fill="#cbd5e1" visibility="{after}">{text}',
            f'<animate attributeName="visibility" calcMode="discrete" {length}',
            f' keyTimes="0;{begin:.5f};{end:.5f}" values="{before};visible;{after}"/></text>',
        ]
    return lines


def main() -> None:
    """Fly and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("svg", type=Path)
    parser.add_argument("--mission", type=Path, default=Path("missions/letters.yaml"))
    arguments = parser.parse_args()
    samples, r_in_m = fly(arguments.mission)
    count = len(samples[0].points)
    title = f"{count} simulated drones fly {arguments.mission}, {SPEED:g} times as fast"
    arguments.svg.parent.mkdir(parents=True, exist_ok=True)
    arguments.svg.write_text(draw(samples, r_in_m, title))


if __name__ == "__main__":
    main()
