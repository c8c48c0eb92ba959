"""Lists that are filled anew every tick, and keep their memory."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


def put(items: list[T], used: int, item: T) -> int:
    """`item` behind the first `used` of `items`; how many are used then."""
    if used < len(items):
        items[used] = item
    else:
        items.append(item)
    return used + 1
