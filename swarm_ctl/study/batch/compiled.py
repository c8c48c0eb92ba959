"""The flight of missions (`flight.py`) and the kernel that it runs, compiled by numba where that is
installed (the extra `study`); else as they are, a hundred times slower.

What was compiled is kept in the user's cache, by the source of all that went into it: the next
process begins at once, and no change of a source leaves anything of before in use.
"""

from __future__ import annotations

import hashlib
import inspect
import math
import os
import re
import sys
from collections.abc import Callable
from functools import cache, partial
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, Final, NamedTuple

import numpy as np

from swarm_ctl.core.kernel import (
    boundary,
    constraints,
    decide,
    exchange,
    law,
    program,
    queue,
    receiver,
    response,
    walls,
    wish,
)
from swarm_ctl.core.law.formation_law import FormationLaw
from swarm_ctl.core.model import arrays, plan, timeouts
from swarm_ctl.study.batch import flight, missions
from swarm_ctl.study.batch.missions import Missions, Setup

Fly = Callable[[Setup, Missions, int, int, int], None]
_MODULES: Final[tuple[ModuleType, ...]] = (
    *(boundary, constraints, decide, exchange, law, program, response),
    *(queue, walls, wish, flight, receiver),
)
SOURCES: Final = (*_MODULES, missions, timeouts, arrays, plan)
"""Their constants are compiled in, and the types of their records."""


def available() -> bool:
    """Missions can be compiled here."""
    return find_spec("numba") is not None


def waits() -> bool:
    """The next flight has to wait until its functions are compiled."""
    return available() and not any(cache_folder().rglob("*.nbc"))


def compiled(own: FormationLaw | None = None) -> Fly:
    """`flight.fly`, compiled if it can be, with an own law that can be; its compiled twin takes the
    place of `own`."""
    whole = _whole()
    if whole is None:
        form = None if own is None else _called(own)
        return partial(flight.fly, own_law=form) if form else flight.fly
    pointer = None if own is None else law_compiled(own).pointer

    def fly(setup: Setup, many: Missions, first: int, ticks: int, stages: int) -> None:
        whole(_record(setup), many, first, ticks, stages, pointer)

    return fly


@cache
def _whole() -> Any:
    """`flight.fly`, compiled; None where it can't be."""
    if not available():
        return None
    from numba import config, njit

    kept = _writable(cache_folder())
    setattr(config, "CACHE_DIR", str(cache_folder()))  # noqa: B010 (numba does not declare it)

    # what is called from compiled code alone needs no other way in; and in one piece, nothing is
    # counted or copied from function to function: a quarter faster
    alone = ("no_cpython_wrapper", "no_cfunc_wrapper", "forceinline")
    inner: dict[str, Any] = dict.fromkeys(alone, True)
    functions = _compilable(lambda each: _once(njit(error_model="numpy", **inner)(each)))
    return njit(cache=kept, error_model="numpy")(functions["fly"])


class CompiledLaw(NamedTuple):
    """An own law for the flight of missions."""

    pointer: Any
    """None: it is not compiled."""
    why: str
    """It is not."""


@cache
def law_compiled(own: FormationLaw) -> CompiledLaw:
    """An own law, compiled if it can be."""
    if not available():
        return CompiledLaw(None, "numba is not installed")
    import numba
    from numba import njit
    from numba.core.errors import NumbaError

    types: Any = numba.types
    typeof: Any = numba.typeof
    me, known = typeof(receiver.SOMEONE), typeof(receiver.NO_ONE)
    values = types.float64[::1]
    signature = types.UniTuple(types.complex128, 2)(me, types.List(known), values, values)
    # each number by its place: a record of an unknown number of them has no type
    fields = ", ".join(f"values[{k}]" for k in range(len(own.numbers._fields)))  # type: ignore[attr-defined]
    space = {"law": _with_helpers(own.source, {}), "numbers": own.numbers}
    exec(  # noqa: S102 (a line of our own, with numbers alone)
        f"def call(me, others, values, memory):\n"
        f"    consensus, avoidance = law(me, others, numbers({fields}), memory)\n"
        f"    return complex(consensus), complex(avoidance)\n",
        space,
    )
    try:
        call = njit(signature, error_model="numpy")(space["call"]).get_compile_result(signature)
    except NumbaError as error:
        return CompiledLaw(None, _reason(str(error), own.source.__code__.co_filename))

    class Pointer(types.WrapperAddressProtocol):  # type: ignore[misc]
        """Of one type for all laws: the flight of missions is compiled once for all of them."""

        def signature(self) -> Any:
            return signature

        def __wrapper_address__(self) -> int:
            address: int = call.library.get_pointer_to_function(call.fndesc.llvm_cfunc_wrapper_name)
            return address

    return CompiledLaw(Pointer(), "")


def _with_helpers(function: Any, twins: dict[Any, Any]) -> Any:
    """A function to be compiled, and with it all functions that it calls, whatever module they are
    from."""
    from numba import njit

    if function not in twins:
        space = dict(function.__globals__)
        copy = FunctionType(function.__code__, space, function.__name__, function.__defaults__)
        twins[function] = njit(error_model="numpy")(copy)
        for name in function.__code__.co_names:
            if inspect.isfunction(space.get(name)):
                space[name] = _with_helpers(space[name], twins)
    return twins[function]


def interpreted(own: FormationLaw) -> bool:
    """The own law is called as it is, though missions are compiled."""
    return available() and law_compiled(own).pointer is None


def _reason(text: str, source: str) -> str:
    """Of numba's explanation, the line that says it, and which line of the law it is about."""
    lines = [line.strip() for line in re.sub(r"\x1b\[\d*m", "", text).splitlines()]
    said = [
        line for line in lines if line and not line.startswith(("Failed in", "During:", "File"))
    ]
    name = Path(source).name
    places = re.findall(rf"{re.escape(name)}\"?(?:, line | \()(\d+)", text)
    where = f" ({name}:{places[0]})" if places else ""
    return f"{(said or ['numba does not say'])[0][:160]}{where}"


def _called(own: FormationLaw) -> Callable[..., tuple[complex, complex]]:
    """The own law for a flight that is not compiled."""

    def call(me: Any, knows: Any, values: Any, memory: Any) -> tuple[complex, complex]:
        consensus, avoidance, _ = own.form(me, knows, own.numbers(*values.tolist()), memory, [])
        return consensus, avoidance

    return call


def _compilable(compiles: Callable[[Any], Any]) -> dict[str, Any]:
    """All functions of the modules by name, to be compiled when they are called; `fly` as it is.

    They see each other, whatever module they are from, and a size of complex numbers that is a
    plain square root: lengths here are neither huge nor tiny, and hypot takes a quarter of a
    flight.
    """
    found: dict[str, Any] = {}
    twins: dict[int, Any] = {}
    spaces = [dict(vars(module)) for module in _MODULES]
    for module, space in zip(_MODULES, spaces, strict=True):
        for name, function in vars(module).items():
            if inspect.isfunction(function) and function.__module__ == module.__name__:
                copy = FunctionType(function.__code__, space, name, function.__defaults__)
                found[name] = copy if function is flight.fly else compiles(copy)
                twins[id(function)] = found[name]
    size = _size_of()
    for space in spaces:
        for name, value in space.items():
            space[name] = twins.get(id(value), value)
        space["abs"] = size
    return found


def _once(function: Any) -> Any:
    """Numbers that stand in the source are numbers like others: a function is compiled once, not
    for each of them again."""
    from numba import types

    template = function.get_call_template

    def plain(args: Any, kws: Any) -> Any:
        return template(tuple(map(types.unliteral, args)), kws)

    function.get_call_template = plain
    return function


def _size_of() -> Callable[[Any], float]:
    from numba import types
    from numba.extending import overload

    @overload(_size)
    def size(x):  # type: ignore[no-untyped-def]
        if isinstance(x, types.Complex):
            return lambda x: math.sqrt(x.real * x.real + x.imag * x.imag)
        return lambda x: abs(x)

    return _size


def _size(x: complex) -> float:
    return abs(x)


def _record(values: Any) -> Any:
    """A named tuple, and those in it, as one record: compiled code passes a place in memory, not
    sixty numbers."""
    return np.array([_plain(values)], dtype=_type_of(values)).view(np.recarray)[0]


def _plain(values: Any) -> Any:
    return tuple(map(_plain, values)) if isinstance(values, tuple) else values


def _type_of(values: Any) -> np.dtype[Any]:
    kinds = {bool: "b1", int: "i8", float: "f8"}
    fields = [
        (name, _type_of(value) if isinstance(value, tuple) else kinds[type(value)])
        for name, value in zip(values._fields, values, strict=True)
    ]
    return np.dtype(fields, align=True)


@cache
def cache_folder() -> Path:
    """For what is compiled of these very sources, by this numba and this Python."""
    home = os.environ.get("XDG_CACHE_HOME")
    base = Path(home) if home else Path.home() / ".cache"
    made_by = (metadata.version("numba"), *map(str, sys.version_info))
    sources = [inspect.getsource(module) for module in (*SOURCES, sys.modules[__name__])]
    digest = hashlib.sha256("\0".join((*made_by, *sources)).encode())
    return base / "swarm-ctl" / "compiled" / digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    """There is such a folder, and it is ours; else every process compiles anew."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)
