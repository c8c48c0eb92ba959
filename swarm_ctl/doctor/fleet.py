"""The vehicles that a file names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.fleet.fleet_file import read_fleet
from swarm_ctl.mission.input import yaml_file


def fleet_in(path: Path) -> Fleet:
    """The fleet of a fleet file or a mission; MissionError with every mistake in the file."""
    return load(path).fleet if is_mission(path) else read_fleet(path)


def is_mission(path: Path) -> bool:
    """Whether it is a mission and no fleet file; MissionError where it can't be read."""
    data = yaml_file.read(path, what="fleet").data
    return isinstance(data, dict) and "steps" in data


def vehicles_of(path: Path) -> Fleet:
    """The fleet of a fleet file or a mission, with those alone that have an endpoint.

    InputError where there are none, MissionError with every mistake in the file.
    """
    fleet = fleet_in(path)
    found = tuple(agent for agent in fleet.agents if agent.endpoint)
    if not found:
        raise InputError(
            f"{path}: no vehicle has an endpoint: run provides them all;"
            " allowed: a fleet with an endpoint for each vehicle to ask"
        )
    return replace(fleet, agents=found)
