"""A vehicle's key and newest stamp as files: who may read them, and whose clock is right."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.engine.vehicle_key import refuse_network
from swarm_ctl.errors import InputError, TrustError
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.signing import SAVE_EVERY
from swarm_ctl.mavlink.stamp import kept_signing, read_key, stamp_at
from tests.unit.mavlink import wire
from tests.unit.mavlink.test_signing import KEY, vehicle_codec

NOW_S = 1_800_000_000.0


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "mavlink.key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    return path


def test_a_flight_leaves_its_newest_stamp_and_nothing_else(key: Path) -> None:
    stamp = key.with_name("stamp")
    with kept_signing(key, stamp, NOW_S) as signing:
        (frame,) = Framer().feed(
            bytes(wire.heartbeat().pack(vehicle_codec(stamp=stamp_at(NOW_S) + 3 * SAVE_EVERY)))
        )
        assert signing.refusal(frame) is None
    assert int(stamp.read_text()) == stamp_at(NOW_S) + 3 * SAVE_EVERY
    assert stamp.stat().st_mode & 0o777 == 0o600
    assert sorted(path.name for path in key.parent.iterdir()) == ["mavlink.key", "stamp"]


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604])
def test_a_key_that_others_may_read_is_refused(key: Path, mode: int) -> None:
    key.chmod(mode)
    with pytest.raises(TrustError, match=f"mode {mode:04o}.*; allowed: 0600"):
        read_key(key)


def test_a_key_of_another_length_is_refused_and_not_shown(key: Path) -> None:
    key.write_bytes(b"sesame")
    with pytest.raises(TrustError, match="has 6 bytes; allowed: 32") as refused:
        read_key(key)
    assert "sesame" not in str(refused.value)


@pytest.mark.parametrize(
    "endpoint", ["serial:/dev/ttyACM0", "tcp:127.0.0.1:5762", "udpin:localhost:14550"]
)
def test_a_key_may_go_over_a_cable_or_the_loopback(endpoint: str) -> None:
    refuse_network(endpoint)


@pytest.mark.parametrize(
    "endpoint", ["udpout:192.168.1.11:14550", "udpin:0.0.0.0:14550", "tcp:no.such.host.invalid:1"]
)
def test_a_key_goes_over_no_network_unasked(endpoint: str) -> None:
    with pytest.raises(InputError, match="allowed: serial:DEVICE, a loopback address, or --over"):
        refuse_network(endpoint)
