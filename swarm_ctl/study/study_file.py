"""A study as a file: the fields of `Study`, what it is about, and its table's rows."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any

from pydantic import ValidationError, field_validator

from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.errors import InputError
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.input.error_messages import show
from swarm_ctl.mission.input.near_matches import did_you_mean
from swarm_ctl.study.parameter_space import Study


class StudyFile(Study):
    """What a file in `studies/` may say."""

    about: str = ""
    by: tuple[str, ...] = ()
    """The lists that the table's rows are made by; all that vary, where there are none."""

    @field_validator("by", mode="before")
    @classmethod
    def _names(cls, given: Any) -> Any:
        return given.split(",") if isinstance(given, str) else given

    @property
    def study(self) -> Study:
        """What is flown."""
        return Study.model_validate(self.model_dump(exclude={"about", "by"}))


def study_file(path: Path | None, given: Mapping[str, Any]) -> StudyFile:
    """The study of a file, if there is one, with the fields `given` instead of its own. InputError
    has every mistake with its line."""
    document = Document("study", {}) if path is None else yaml_file.read(path, what="study")
    if not isinstance(document.data, dict) or document.problems:
        raise InputError("\n".join(map(str, document.problems)) or f"{path}: has no fields")
    fields = {**document.data, **given}
    fields["law"] = {**_law(document.data), **_law(given)}
    try:
        return StudyFile.model_validate(fields)
    except ValidationError as error:
        said = list[str]()
        order: dict[tuple[int | str, ...], int] = {(name,): k for k, name in enumerate(fields)}
        errors = error.errors(include_url=False)
        for found in sorted(errors, key=lambda each: order.get(each["loc"][:1], 0)):
            loc = tuple(part for part in found["loc"] if isinstance(part, str))
            own = path is None or not loc or loc[0] in given
            where = [] if own else [document.where(loc)]
            field = [".".join(loc)] if loc else []
            said.append(": ".join([*where, *field, _wrong(found)]))
        raise InputError("\n".join(dict.fromkeys(said))) from None


def _wrong(found: Mapping[str, Any]) -> str:
    """What is wrong, and what is allowed."""
    value, text = found["input"], found["msg"].removeprefix("Value error, ")
    if found["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        in_law = [field.name for field in fields_of(LawParameters) if field.name != "h"]
        names = in_law if len(found["loc"]) > 1 else sorted(StudyFile.model_fields)
        near = did_you_mean(str(found["loc"][-1]), names)
        return f"unknown field{near}; allowed: {', '.join(names)}"
    if found["type"] in ("literal_error", "enum"):
        names = re.findall("'([^']+)'", found["ctx"]["expected"])
        near = did_you_mean(str(value), names)
        return f"{show(value)} is not allowed{near}; allowed: {', '.join(names)}"
    return f"{show(value)} {text.removeprefix('Input ')}" if text.startswith("Input ") else text


def _law(fields: Mapping[str, Any]) -> Mapping[str, Any]:
    law: Mapping[str, Any] = fields.get("law", {})
    return law
