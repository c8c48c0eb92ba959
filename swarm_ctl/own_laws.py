"""Which law is flown: the paper's, or an own one that an installed package offers.

An own law is a function with the arguments and the result of `formation_law.evaluate`, behind an
entry point of the group `GROUP`. A plan pins it as NAME@DIGEST: no two agents fly different code
under one name. `docs/pages/law.md` has an example.
"""

from __future__ import annotations

import hashlib
import inspect
from importlib import metadata
from typing import Any, Final, cast

import numpy as np

from swarm_ctl.core.law.formation_law import LawResult, OwnLaw, evaluate
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.errors import InputError, SwarmError

GROUP: Final = "swarm_ctl.laws"
PAPER: Final = "paper"
"""The name of the law of Mondal et al., which needs no package."""


class LawError(SwarmError):
    """An own law gave what cannot be flown. It ends its agent, and the vehicle's own failsafe
    lands."""


def pinned(name: str) -> str:
    """NAME@DIGEST of the law that is installed here under `name`, '' of the paper's; InputError
    where none is."""
    return "" if name == PAPER else f"{name}@{_digest(name, _function(name))}"


def own_law_of(parameters: LawParameters) -> OwnLaw | None:
    """The own law that the plan pins, None: it flies the paper's; InputError as `law_of`."""
    return law_of(parameters) if parameters.own else None


def law_of(parameters: LawParameters) -> OwnLaw:
    """The law to fly; InputError where this computer has not the one that the plan pins."""
    if not parameters.own:
        return evaluate
    name, _, wanted = parameters.own.partition("@")
    function = _function(name)
    here = _digest(name, function)
    if here != wanted:
        raise InputError(
            f"law {name!r}: its source here is {here}; allowed: {wanted or 'none'}, the plan's:"
            " the same source on each computer"
        )
    return _checked(name, function)


def _function(name: str) -> OwnLaw:
    offered = {point.name: point for point in metadata.entry_points(group=GROUP)}
    if name not in offered:
        names = ", ".join([PAPER, *sorted(offered)])
        more = "" if offered else f" (no package here offers another, by an entry point of {GROUP})"
        raise InputError(f"law {name!r} is not installed here; allowed: {names}{more}")
    try:
        function = offered[name].load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"law {name!r} ({offered[name].value}): {error}") from None
    if not callable(function):
        raise InputError(f"law {name!r} ({offered[name].value}): allowed: a function")
    return cast("OwnLaw", function)


def _digest(name: str, function: OwnLaw) -> str:
    """Of the source of the function's module."""
    module = inspect.getmodule(function)
    try:
        source = inspect.getsource(module) if module is not None else ""
    except OSError:
        source = ""
    if not source:
        raise InputError(f"law {name!r}: allowed: a function of a module with its source")
    return hashlib.sha256(source.encode()).hexdigest()[:16]


def _checked(name: str, function: OwnLaw) -> OwnLaw:
    """The same law; LawError where its terms are not numbers for each agent."""

    def law(own: Floats, *others: Any) -> LawResult:
        result: LawResult = function(own, *others)
        for term in (result.consensus, result.avoidance):
            if np.shape(term) != own.shape or not np.isfinite(term).all():
                raise LawError(
                    f"law {name!r} gave {np.shape(term)} with"
                    f" {np.count_nonzero(~np.isfinite(term))} values that are no numbers; allowed:"
                    f" {own.shape}, all finite"
                )
        return result

    return law
