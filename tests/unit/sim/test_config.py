"""The configuration names what is wrong, where, and what is allowed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from swarm_sim.config import ConfigError, load_config


def settings() -> dict[str, Any]:
    place = {"lat_deg": 47.0, "lon_deg": 8.0, "alt_m": 400.0}
    vehicles = [{"sysid": i, "endpoint": f"udpin:127.0.0.1:{14600 + i}"} | place for i in (1, 2)]
    return {"version": 1, "epoch_s": 0.0, "origin": place, "vehicles": vehicles}


def refusal(tmp_path: Path, changed: dict[str, Any]) -> str:
    path = tmp_path / "sim.json"
    path.write_text(json.dumps(changed))
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("sysid", 251, ["vehicles[0].sysid", "250"]),
        ("sysid", 2, ["vehicles[0] and vehicles[1]", "sysid 2"]),
        ("endpoint", "udpin:127.0.0.1:14602", ["vehicles[0] and vehicles[1]", "endpoint"]),
        ("endpoint", "tcp:127.0.0.1:14602", ["vehicles[0].endpoint", "udpin"]),
        ("persona", "betaflight", ["vehicles[0].persona", "'ardupilot' or 'px4'"]),
        ("lat_deg", 91.0, ["vehicles[0].lat_deg", "89"]),
        ("colour", "red", ["vehicles[0].colour", "remove it"]),
    ],
)
def test_a_mistake_in_a_vehicle(tmp_path: Path, field: str, value: Any, told: list[str]) -> None:
    changed = settings()
    changed["vehicles"][0][field] = value
    text = refusal(tmp_path, changed)
    assert all(part in text for part in told), text


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("speedup", 0.0),
        ("speedup", "fast"),
        ("version", 2),
        ("vehicles", []),
        ("truth_rate_hz", -1),
        ("what", 1),
    ],
)
def test_a_mistake_at_the_top(tmp_path: Path, field: str, value: Any) -> None:
    assert field in refusal(tmp_path, settings() | {field: value})


def test_not_json_and_not_there(tmp_path: Path) -> None:
    path = tmp_path / "sim.json"
    with pytest.raises(ConfigError, match="can't be read"):
        load_config(path)
    path.write_text("{\n nonsense")
    with pytest.raises(ConfigError, match=r"sim.json:2: not JSON"):
        load_config(path)
