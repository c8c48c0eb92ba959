"""What is thrown: the same numbers from the same seed, on each machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np

T = TypeVar("T")
Data: TypeAlias = dict[str, Any]
Point: TypeAlias = tuple[float, float]


class Dice:
    """The same words give the same throws, on each machine."""

    def __init__(self, *words: int) -> None:
        self._random = np.random.default_rng(words)

    def chance(self, share: float) -> bool:
        """True in this share of throws."""
        return bool(self._random.random() < share)

    def pick(self, these: Sequence[T], weight: Callable[[T], float] = lambda _: 1.0) -> T:
        """One of them, each as often as it weighs."""
        weights = np.array([weight(each) for each in these], dtype=np.float64)
        ends = np.cumsum(weights)
        at = int(np.searchsorted(ends, self._random.random() * ends[-1], side="right"))
        return these[min(at, len(these) - 1)]

    def some(self, these: Sequence[T], count: int) -> list[T]:
        """So many of them, in their order."""
        chosen = self._random.permutation(len(these))[:count]
        return [these[int(k)] for k in sorted(chosen)]

    def shuffled(self, these: Sequence[T]) -> list[T]:
        """All of them in another order."""
        return [these[int(k)] for k in self._random.permutation(len(these))]

    def number(self, low: float, high: float, digits: int = 2) -> float:
        """Evenly between the two, which are among them."""
        drawn = low + (high - low) * float(self._random.random())
        return min(max(round(drawn, digits), low), high)

    def whole(self, low: int, high: int) -> int:
        """Evenly from low to high, both among them."""
        return int(self._random.integers(low, high + 1))

    def signed(self, low: float, high: float, digits: int = 2) -> float:
        """A number of either sign whose size is between the two."""
        size = self.number(low, high, digits)
        return size if self.chance(0.5) else -size


def some_of(dice: Dice, ids: Sequence[int]) -> list[int]:
    """One of them mostly, seldom all."""
    most = len(ids)
    count = dice.pick((1, 1, 1, 1, min(2, most), min(2, most), most))
    return dice.some(ids, count)
