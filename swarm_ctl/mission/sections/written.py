"""A section whose fields are declared by the plan: names, bounds, defaults and descriptions."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import sys
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, TypeVar, get_type_hints

from annotated_types import Ge, Le
from pydantic import ConfigDict, Field, create_model

from swarm_ctl.core.model.policies import DERIVED
from swarm_ctl.mission.sections.section import Section

T = TypeVar("T")


class Written(Section, Generic[T]):
    """`Written[Limits]` has the fields of the plan's `Limits`, as a file gives them: those that the
    plan derives are None where the file does not."""

    model_config = ConfigDict(use_attribute_docstrings=False)  # `_docstrings` finds them
    plan_type: ClassVar[type[Any]]
    plan_hints: ClassVar[dict[str, Any]]

    def planned(self, **derived: Any) -> T:
        """As the plan has it; `derived` has all that the plan derives, each kept within bounds."""
        values = {
            name: _within(self.plan_hints[name], derived[name]) if value is None else value
            for name, value in self
        }
        planned: T = self.plan_type(**values)
        return planned

    if not TYPE_CHECKING:

        def __class_getitem__(cls, plan_type: type[Any]) -> type[Section]:
            """The section, made from the plan's type."""
            made = create_model(plan_type.__name__, __base__=cls, **_fields(plan_type))
            made.plan_type = plan_type
            made.plan_hints = get_type_hints(plan_type, include_extras=True)
            return made


def _within(of: Any, value: Any) -> Any:
    for bound in getattr(of, "__metadata__", ()):
        if isinstance(bound, Ge):
            value = max(value, bound.ge)
        elif isinstance(bound, Le):
            value = min(value, bound.le)
    return value


def _fields(plan_type: type[Any]) -> dict[str, Any]:
    """For `create_model`."""
    hints, docstrings = get_type_hints(plan_type, include_extras=True), _docstrings(plan_type)
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(plan_type):
        of: Any = hints[field.name]
        default = ... if field.default is dataclasses.MISSING else field.default
        if DERIVED in getattr(of, "__metadata__", ()):
            of, default = of | None, None
        elif isinstance(of, type) and issubclass(of, Enum):
            of = Annotated[of, Field(strict=False)]  # a file has its value
        fields[field.name] = of, Field(default=default, description=docstrings.get(field.name))
    return fields


def _docstrings(plan_type: type[Any]) -> dict[str, str]:
    """By field; none where the sources are not installed."""
    found = dict[str, str]()
    lines = getattr(_classes(plan_type.__module__).get(plan_type.__name__), "body", ())
    for pair in itertools.pairwise(lines):
        match pair:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(text))):
                found[name] = inspect.cleandoc(text)
    return found


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    try:
        parsed = ast.parse(inspect.getsource(sys.modules[module]))
    except OSError:
        return {}
    return {node.name: node for node in parsed.body if isinstance(node, ast.ClassDef)}
