"""The garbage collector beside control loops.

A tick leaves next to nothing behind, and what is built at the start stays: looking through all of
it again and again would cost a tenth of the time.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_RARELY: Final = (50_000, 20, 100)
"""Objects between collections."""


def collect_rarely() -> None:
    """From now on, in a process that is one control loop."""
    gc.freeze()
    gc.set_threshold(*_RARELY)


@contextmanager
def collected_rarely() -> Iterator[None]:
    """For the time of a flight in a process that goes on after it."""
    before = gc.get_threshold()
    gc.set_threshold(*_RARELY)
    try:
        yield
    finally:
        gc.set_threshold(*before)
