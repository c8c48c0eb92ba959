"""The base of every section of a mission file."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

AgentId = Annotated[int, Field(ge=1, le=65535)]


class Section(BaseModel):
    """Strict: no unknown field, no silent conversion, no NaN or infinity."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )
