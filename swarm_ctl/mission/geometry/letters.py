"""A stroke font: letters as lines, and slots evenly along them.

Points are (north, east); a letter is 1 high and 2/3 wide.
"""

from __future__ import annotations

import itertools
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]

_WIDTH: Final = 2 / 3
_GAP: Final = 1 / 3
# A word is one stroke through points of a grid with 3 columns (a to c, west to east) and 5 rows
# (1 to 5, south to north).
_STROKES: Final[dict[str, str]] = {
    "A": "a1a4b5c4c1 a3c3",
    "B": "a1a5b5c4b3a3 b3c2b1a1",
    "C": "c5a5a1c1",
    "D": "a1a5b5c4c2b1a1",
    "E": "c5a5a1c1 a3c3",
    "F": "c5a5a1 a3c3",
    "G": "c5a5a1c1c3b3",
    "H": "a1a5 c1c5 a3c3",
    "I": "b1b5",
    "J": "c5c2b1a2",
    "K": "a1a5 c5a3c1",
    "L": "a5a1c1",
    "M": "a1a5b3c5c1",
    "N": "a1a5c1c5",
    "O": "a1a5c5c1a1",
    "P": "a1a5c5c3a3",
    "Q": "a1a5c5c1a1 b2c1",
    "R": "a1a5c5c3a3 b3c1",
    "S": "c5a5a3c3c1a1",
    "T": "a5c5 b5b1",
    "U": "a5a1c1c5",
    "V": "a5b1c5",
    "W": "a5a1b3c1c5",
    "X": "a1c5 a5c1",
    "Y": "a5b3c5 b3b1",
    "Z": "a5c5a1c1",
    "0": "a1a5c5c1a1",
    "1": "a4b5b1",
    "2": "a5c5c3a3a1c1",
    "3": "a5c5c1a1 a3c3",
    "4": "a5a3c3 c5c1",
    "5": "c5a5a3c3c1a1",
    "6": "c5a5a1c1c3a3",
    "7": "a5c5b1",
    "8": "a1a5c5c1a1 a3c3",
    "9": "c3a3a5c5c1a1",
    " ": "",
}


def slots(text: str, height: float, count: int) -> Array:
    """`count` slots evenly along the strokes of `text`; (count, 2), in the unit of `height`."""
    points = _sampled(_strokes(text), 200 * max(1, count // 10 + 1))
    return _spread(points, count) * height


def _strokes(text: str) -> list[Array]:
    found = []
    for place, letter in enumerate(text.upper()):
        for word in _STROKES[letter].split():
            grid = [("abc".index(word[k]), int(word[k + 1]) - 1) for k in range(0, len(word), 2)]
            east0 = place * (_WIDTH + _GAP)
            found.append(np.array([(row / 4, east0 + column * _WIDTH / 2) for column, row in grid]))
    return found or [np.zeros((1, 2))]


def _sampled(strokes: list[Array], count: int) -> Array:
    """At least `count` points along all strokes, corners included; (m, 2)."""
    length = sum(float(np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum()) for stroke in strokes)
    points = []
    for stroke in strokes:
        for a, b in itertools.pairwise(stroke):
            steps = max(1, round(count * float(np.linalg.norm(b - a)) / length))
            points.append(a + np.linspace(0, 1, steps + 1)[:, None] * (b - a))
    return np.vstack(points) if points else strokes[0]


def _spread(points: Array, count: int) -> Array:
    """Choose `count` points, each time the one farthest from those chosen before."""
    chosen = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        k = int(np.argmax(np.round(away, 9)))
        chosen.append(k)
        away = np.minimum(away, np.linalg.norm(points - points[k], axis=1))
    return points[chosen]
