"""Types of arrays, and the operations of formulas that one agent and arrays of agents share.

A formula written with an `Arithmetic` serves both: plain floats and complex numbers with `ONE`
(numpy costs ten times as much for a single agent, every tick), arrays with `MANY`. A horizontal
vector is then the complex number north + 1j * east.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)
Floats: TypeAlias = NDArray[np.float64]
Complex: TypeAlias = NDArray[np.complex128]
Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.int64]
Indices: TypeAlias = NDArray[np.intp]


class Arithmetic(NamedTuple):
    """What is called differently for one number and for an array of them."""

    least: Callable[[Any, Any], Any]
    most: Callable[[Any, Any], Any]
    where: Callable[[Any, Any, Any], Any]
    """(condition, if true, if false)."""
    some: Callable[[Any], bool]
    """True for one at least."""


ONE: Final = Arithmetic(min, max, lambda condition, yes, no: yes if condition else no, bool)
MANY: Final = Arithmetic(np.minimum, np.maximum, np.where, np.any)


def complex_of(vectors: Floats) -> Complex:
    """Vectors (2, ...), north and east, as complex numbers (...)."""
    combined = np.empty(vectors.shape[1:], dtype=np.complex128)
    combined.real, combined.imag = vectors
    return combined


def complex_of_last(vectors: Floats) -> Complex:
    """Vectors (..., 2 or 3), north and east first, as complex numbers (...)."""
    combined: Complex = vectors[..., 0] + 1j * vectors[..., 1]
    return combined


def places(mask: Bools) -> tuple[Indices, ...]:
    """Where the mask is true, as `nonzero` says: several times quicker where few are."""
    return np.unravel_index(np.flatnonzero(mask), mask.shape)


def taken(array: NDArray[T], *place: Indices) -> NDArray[T]:
    """The elements at these places of the last axes, as an index, but several times quicker; an
    axis of length 1 stands for any length."""
    shape = array.shape[-len(place) :]
    flat: Any = 0
    for length, index in zip(shape, place, strict=True):
        flat = flat * length + (index if length > 1 else 0)
    found: NDArray[T] = array.reshape(*array.shape[: -len(place)], -1).take(flat, axis=-1)
    return found


def keep_missions(owner: object, missions: Bools | Indices, *names: str) -> None:
    """Keep only these missions of the named arrays of `owner`; missions are the last axis."""
    for name in names:
        setattr(owner, name, np.ascontiguousarray(getattr(owner, name)[..., missions]))
