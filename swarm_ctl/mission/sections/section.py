"""The base of every section of a mission file, and the types of fields that several have.

Lengths with a suffix (`_m`) are in metres; other lengths are in what `lengths` says. Horizontal
vectors are [north, east]. Angles are degrees clockwise from north, seen from above.
"""

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
from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, create_model
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from swarm_ctl.core.model.plan import Policy
from swarm_ctl.core.model.policies import DERIVED

AgentId = Annotated[int, Field(ge=1, le=65535)]
Length = Annotated[float, Field(gt=0, le=1000)]
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000)]
NorthEast = tuple[Coordinate, Coordinate]
Angle = Annotated[float, Field(ge=-360, le=360)]
Timeout = Annotated[float, Field(gt=0, le=3600)]
Name = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,39}$", examples=["hexagon", "search-line_2"])
]
Action = Annotated[Policy, Field(strict=False)]
Link = tuple[AgentId, AgentId]
Links = Annotated[tuple[Link, ...], Field(min_length=1, max_length=31125)]


class Section(BaseModel):
    """Strict: no unknown field, no silent conversion, no NaN or infinity."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        defer_build=True,  # sections are read as parts of the file, which is built as one
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """With the texts below the fields, which are looked up for a schema alone: that takes
        longer than to read a mission."""
        schema = handler(core)
        fields = handler.resolve_ref_schema(schema).get("properties", {})
        for name, text in cls.described().items():
            if name in fields:
                fields[name].setdefault("description", text)
        return schema

    @classmethod
    def described(cls) -> dict[str, str]:
        """The texts below the fields."""
        found = dict[str, str]()
        for each in reversed(cls.__mro__):
            found |= _docstrings(each) if issubclass(each, Section) else {}
        return found


T = TypeVar("T")


class Written(Section, Generic[T]):
    """`Written[Limits]` has the fields of the plan's `Limits`, as a file gives them: those that the
    plan derives are None where the file does not."""

    plan_type: ClassVar[type[Any]]
    plan_hints: ClassVar[dict[str, Any]]

    @classmethod
    def described(cls) -> dict[str, str]:
        """Those of the plan's type."""
        return super().described() | _docstrings(cls.plan_type)

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
    hints = get_type_hints(plan_type, include_extras=True)
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(plan_type):
        of: Any = hints[field.name]
        default = ... if field.default is dataclasses.MISSING else field.default
        if DERIVED in getattr(of, "__metadata__", ()):
            of, default = of | None, None
        elif isinstance(of, type) and issubclass(of, Enum):
            of = Annotated[of, Field(strict=False)]  # a file has its value
        fields[field.name] = of, Field(default=default)
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
