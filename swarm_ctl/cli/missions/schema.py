"""`swarm-ctl schema`: the mission file's JSON Schema, for editors and other tools."""

from __future__ import annotations

import json

import typer


def schema() -> None:
    """Print the JSON Schema of mission files.

    Example:

    \b
        swarm-ctl schema > mission.schema.json
    """
    from swarm_ctl.mission.mission_file import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))
