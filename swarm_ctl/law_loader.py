"""Which law is flown: the paper's, or an own one: a module that keeps to `swarm_ctl.law`.

An own law has a name. It is one of the modules in `swarm_ctl/laws/`, an entry point of the group
`GROUP` of an installed package, or a file in the user's `laws_folder()`. A plan pins it as
NAME@DIGEST of its source: no two agents fly different code under one name.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import pkgutil
import re
import sys
import traceback
from collections.abc import Callable, Mapping, MutableSequence, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Final, NamedTuple, get_args, get_origin, get_type_hints

from swarm_ctl import laws
from swarm_ctl.core.kernel.law import Pair
from swarm_ctl.core.kernel.receiver import Known, Me
from swarm_ctl.core.law.formation_law import PAPER, FormationLaw, everywhere
from swarm_ctl.core.model.plan import Between, LawParameter, LawParameters
from swarm_ctl.errors import InputError, SwarmError

GROUP: Final = "swarm_ctl.laws"
FOLDER_VARIABLE: Final = "SWARM_CTL_LAWS"
NAME: Final = re.compile(r"[a-z][a-z0-9_-]{0,39}")
RESERVED: Final = frozenset({"h", "kappa", "delta_a", "delta_l", "plan"})
"""Names that `tune` gives another meaning."""
_MOST_MEMORY: Final = 1000
_MOST: Final = 1e6
"""A term of more than this [units/s] is no velocity."""
_FORM: Final = "def terms(me, others, p, memory)"


class LawError(SwarmError):
    """An own law gave what cannot be flown. It ends its agent, and the vehicle's own failsafe
    lands."""


@dataclass(frozen=True, slots=True)
class OwnLaw:
    """An own law as it was found."""

    name: str
    about: str
    """The first line of its docstring."""
    where: str
    digest: str
    parameters: tuple[LawParameter, ...]
    """With their defaults."""
    says: Mapping[str, str]
    """What its parameters mean, by name."""
    law: FormationLaw
    for_tests: bool
    """It flies to try what keeps agents apart, not to form a shape."""

    @property
    def pinned(self) -> str:
        """NAME@DIGEST."""
        return f"{self.name}@{self.digest}"

    def given(self, values: Mapping[str, Any]) -> tuple[LawParameter, ...]:
        """Its parameters with these values; InputError where one is unknown or out of bounds."""
        known = {each.name: each for each in self.parameters}
        for name, value in values.items():
            if name not in known:
                names = ", ".join(known) or "none, this law has no parameters"
                raise InputError(f"law {self.name!r}: unknown parameter {name}; allowed: {names}")
            least, most = known[name].least, known[name].most
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and least <= value <= most):
                raise InputError(
                    f"law {self.name!r}: {name} {value!r}; allowed: {least:g} to {most:g}"
                )
        return tuple(
            LawParameter(each.name, float(values.get(each.name, each.value)), each.least, each.most)
            for each in self.parameters
        )


def laws_folder() -> Path:
    """Where this user's laws are files: `SWARM_CTL_LAWS`, else swarm_ctl/laws in XDG_DATA_HOME or
    ~/.local/share."""
    given, base = os.environ.get(FOLDER_VARIABLE), os.environ.get("XDG_DATA_HOME")
    if given:
        return Path(given)
    return (Path(base) if base else Path.home() / ".local" / "share") / "swarm_ctl" / "laws"


def found_laws() -> dict[str, str]:
    """The own laws that are here, and where each is, by name."""
    return {name: places[0][0] for name, places in sorted(_offered().items())}


def own_law(name: str) -> OwnLaw:
    """The law of this name; InputError where there is none, or where it is no law."""
    offered = _offered().get(name)
    if not offered:
        names = ", ".join([PAPER.name, *sorted(_offered())])
        raise InputError(
            f"law {name!r} is not installed here; allowed: {names}; a file of yours:"
            " swarm-ctl law add FILE"
        )
    if len(offered) > 1:
        places = " and ".join(where for where, _ in offered)
        raise InputError(f"law {name!r} is there more than once: {places}; allowed: one of them")
    return _loaded(name, *offered[0])


def law_in_file(path: Path) -> OwnLaw:
    """The law that a file is, by the file's name; InputError where it is none."""
    return _loaded(path.stem, str(path), _reading(path))


def _loaded(name: str, where: str, load: Callable[[], Any]) -> OwnLaw:
    try:
        return _law_of_module(name, where, load())
    except (InputError, OSError):
        raise
    except Exception as error:  # a module runs whatever its author wrote
        raise InputError(f"law {name!r} ({where}): {_told(error)}; allowed: {_FORM}") from None


@cache
def _law_of_module(name: str, where: str, module: Any) -> OwnLaw:
    """The law that a module is, the same object each time: studies keep what they have compiled of
    it. InputError where it is none."""

    def wrong(what: str, allowed: str) -> InputError:
        return InputError(f"law {name!r} ({where}): {what}; allowed: {allowed}")

    if not isinstance(module, ModuleType):
        raise wrong(f"is {type(module).__name__}", f"a module with {_FORM}")
    terms = getattr(module, "terms", None)
    if not inspect.isfunction(terms):
        raise wrong("has no function terms", _FORM)
    if not _takes(terms, 4):
        raise wrong(f"terms{inspect.signature(terms)} does not take four values", _FORM)
    memory = getattr(module, "MEMORY", 0)
    if type(memory) is not int or not 0 <= memory <= _MOST_MEMORY:
        raise wrong(f"MEMORY is {memory!r}", f"a whole number from 0 to {_MOST_MEMORY}")
    numbers = getattr(module, "Parameters", _NoParameters)
    try:
        parameters, says = _schema(numbers)
    except ValueError as error:
        raise wrong(str(error), "rate: Annotated[float, Between(0.1, 4)] = 1.0") from None
    reach = getattr(module, "reach", None)
    if reach is not None and not (inspect.isfunction(reach) and _takes(reach, 1)):
        raise wrong("reach is no function of one value", "def reach(p)")
    law = FormationLaw(name, _form(name, terms), numbers, memory, reach or everywhere, source=terms)
    about = (inspect.getdoc(module) or "").split("\n")[0]
    digest, for_tests = _digest(name, where, module), bool(getattr(module, "FOR_TESTS", False))
    return OwnLaw(
        name=name,
        about=about,
        where=where,
        digest=digest,
        parameters=parameters,
        says=says,
        law=law,
        for_tests=for_tests,
    )


def law_of(parameters: LawParameters) -> FormationLaw:
    """The law to fly; InputError where this computer has not the one that the plan pins."""
    if not parameters.own:
        return PAPER
    name, _, wanted = parameters.own.partition("@")
    here = own_law(name)
    if here.digest != wanted:
        raise InputError(
            f"law {name!r}: its source here is {here.digest}; allowed: {wanted or 'none'}, the"
            " plan's: the same source on each computer"
        )
    if [each.name for each in here.parameters] != [each.name for each in parameters.parameters]:
        raise InputError(f"law {name!r}: the plan has other parameters; allowed: its own")
    return here.law


def own_law_of(parameters: LawParameters) -> FormationLaw | None:
    """The own law that the plan pins, None: it flies the paper's; InputError as `law_of`."""
    return law_of(parameters) if parameters.own else None


def pinned(name: str, values: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The fields `own` and `parameters` of `LawParameters` for the law of this name; the paper's
    has none."""
    if name == PAPER.name:
        if values:
            raise InputError(
                f"law {name!r}: unknown parameter {next(iter(values))}; allowed: none, its numbers"
                " are the other fields of `law`"
            )
        return {"own": "", "parameters": ()}
    found = own_law(name)
    return {"own": found.pinned, "parameters": found.given(values or {})}


# --- where laws are ---


def _offered() -> dict[str, list[tuple[str, Callable[[], Any]]]]:
    """By name: where each law of that name is, and what loads it."""
    found: dict[str, list[tuple[str, Callable[[], Any]]]] = {}
    for each in pkgutil.iter_modules(laws.__path__):
        path = f"{laws.__name__}.{each.name}"
        found.setdefault(each.name, []).append((path, _importing(path)))
    for point in metadata.entry_points(group=GROUP):
        found.setdefault(point.name, []).append((point.value, point.load))
    folder = laws_folder()
    for file in sorted(folder.glob("*.py")) if folder.is_dir() else ():
        if NAME.fullmatch(file.stem):
            found.setdefault(file.stem, []).append((str(file), _reading(file)))
    return found


def _importing(name: str) -> Callable[[], Any]:
    return lambda: importlib.import_module(name)


def _reading(path: Path) -> Callable[[], Any]:
    return lambda: module_of(path)


def module_of(path: Path) -> ModuleType:
    """A file as a module of its own, run once for each content that it has."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    name = f"swarm_ctl_own_law_{re.sub(r'[^a-z0-9]', '_', path.stem)}_{digest}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise InputError(f"{path}: is no Python file; allowed: NAME.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _digest(name: str, where: str, module: ModuleType) -> str:
    """Of the module's source: that one file."""
    try:
        source = Path(str(module.__file__)).read_bytes()
    except OSError:
        raise InputError(
            f"law {name!r} ({where}): has no source here; allowed: a module with its source"
        ) from None
    return hashlib.sha256(source).hexdigest()[:16]


# --- what a law is ---


class _NoParameters(NamedTuple):
    """Of a law without any."""


def _schema(numbers: Any) -> tuple[tuple[LawParameter, ...], dict[str, str]]:
    """Of a law's `Parameters`: defaults, bounds, and what they mean. ValueError says what is
    wrong."""
    names, defaults = (getattr(numbers, each, None) for each in ("_fields", "_field_defaults"))
    if names is None or defaults is None or not isinstance(numbers, type):
        raise ValueError("Parameters is no NamedTuple")
    hints = get_type_hints(numbers, include_extras=True)
    parameters, says = list[LawParameter](), dict[str, str]()
    for name in names:
        hint, default = hints[name], defaults.get(name)
        spans = [each for each in get_args(hint)[1:] if isinstance(each, Between)]
        if get_origin(hint) is not Annotated or get_args(hint)[0] is not float or not spans:
            raise ValueError(f"parameter {name} is no float between bounds")
        if name in RESERVED:
            raise ValueError(f"parameter {name} has a name that `tune` needs for itself")
        span = spans[0]
        if not (isinstance(default, int | float) and span.least <= default <= span.most):
            raise ValueError(f"parameter {name} has no default in {span.least:g} to {span.most:g}")
        parameters.append(LawParameter(name, float(default), float(span.least), float(span.most)))
        says[name] = span.about
    return tuple(parameters), says


def _takes(function: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    return True


def _form(name: str, terms: Callable[..., Any]) -> Callable[..., tuple[complex, complex, int]]:
    """A user's function in the form of all laws; LawError where its terms are no velocities."""

    def form(
        me: Me, others: Sequence[Known], p: Any, memory: MutableSequence[float], pairs: list[Pair]
    ) -> tuple[complex, complex, int]:
        del pairs
        try:
            given = terms(me, others, p, memory)
            consensus, avoidance = given
            along, away = complex(consensus), complex(avoidance)
        except Exception as error:  # whatever its author wrote
            raise LawError(f"law {name!r}: {_told(error)}; allowed: two velocities") from error
        if not all(abs(part) <= _MOST for part in (along.real, along.imag, away.real, away.imag)):
            raise LawError(
                f"law {name!r} gave {given!r} for {me}; allowed: two velocities of at most"
                f" {_MOST:g} units/s"
            )
        return along, away, 0

    return form


def _told(error: Exception) -> str:
    """An error in a line: what it is, and in which line of the law."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        frame
        for frame in frames
        if frame.filename != __file__ and "importlib" not in frame.filename
    ]
    where = f" ({Path(own[-1].filename).name}:{own[-1].lineno})" if own else ""
    return f"{type(error).__name__}: {' '.join(str(error).split()) or 'no words'}{where}"
