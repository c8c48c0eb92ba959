"""`swarm-ctl schema`: the mission file's JSON Schema, for editors and other tools."""

from __future__ import annotations

import json

import typer

from swarm_ctl.mission.input.schema import json_schema


def schema() -> None:
    """Print the JSON Schema of mission files."""
    typer.echo(json.dumps(json_schema(), indent=2))
