"""A study as a file: the fields of `Study`, what it is about, and its table's rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError, field_validator

from swarm_ctl.errors import InputError
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.mission.input.document import Document
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
    says which line is wrong."""
    document = Document("study", {}) if path is None else yaml_file.read(path, what="study")
    if not isinstance(document.data, dict) or document.problems:
        raise InputError("\n".join(map(str, document.problems)) or f"{path}: has no fields")
    fields = {**document.data, **given}
    fields["law"] = {**_law(document.data), **_law(given)}
    try:
        return StudyFile.model_validate(fields)
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        field = str(found["loc"][0]) if found["loc"] else ""
        where = "" if path is None or field in given else f"{document.where((field,))}: "
        text = found["msg"].removeprefix("Value error, ")
        raise InputError(where + (f"{field}: {text}" if field else text)) from None


def _law(fields: Mapping[str, Any]) -> Mapping[str, Any]:
    law: Mapping[str, Any] = fields.get("law", {})
    return law
