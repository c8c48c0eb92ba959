"""Types of arrays, and horizontal vectors as complex numbers north + 1j * east."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Complex: TypeAlias = NDArray[np.complex128]
Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.int64]
Indices: TypeAlias = NDArray[np.intp]


def complex_of(vectors: Floats) -> Complex:
    """Vectors (..., 2 or 3), north and east first, as complex numbers (...)."""
    combined: Complex = vectors[..., 0] + 1j * vectors[..., 1]
    return combined


def plane_of(vectors: Complex) -> Floats:
    """Complex numbers (...) as vectors (..., 2)."""
    return np.stack((vectors.real, vectors.imag), axis=-1)
