"""Payloads with some fields drawn out of all ranges, for tests of what hears them."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Final

from hypothesis import strategies as st

ODD_INT: Final = st.sampled_from([-(2**65), -7, -1, 5, 6, 7, 99, 127, 255, 65535, 2**65])
ODD_FLOAT: Final = st.sampled_from(
    [float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 1e13, -1.0, 0.0, 1e-9]
)


def odd(value: object) -> st.SearchStrategy[Any]:
    """A value of the same kind, out of all ranges."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return st.just(value)
    if isinstance(value, float):
        return ODD_FLOAT
    if type(value) is int:
        return ODD_INT
    if isinstance(value, tuple) and value:
        return st.tuples(*map(odd, value))
    if isinstance(value, dict):
        return st.dictionaries(ODD_INT, st.just("x"), max_size=2) if not value else st.just(value)
    if hasattr(value, "__dataclass_fields__"):
        return odd_fields(value)
    return st.just(value)


@st.composite
def odd_changes(draw: st.DrawFn, of: Any) -> dict[str, Any]:
    """One to three fields but `agent`, and their new values."""
    names = [field.name for field in fields(of) if field.name != "agent"]
    chosen = draw(st.sets(st.sampled_from(names), min_size=1, max_size=3))
    return {name: draw(odd(getattr(of, name))) for name in sorted(chosen)}


def odd_fields(of: Any) -> st.SearchStrategy[Any]:
    """The payload with `odd_changes`."""
    return odd_changes(of).map(lambda changes: replace(of, **changes))
