"""The truth file: read as far as it goes, wherever the simulator was killed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from swarm_ctl.runfolder.files import Damage
from swarm_ctl.runfolder.truth import load_truth, read_truth

SMALL = [
    '{"type":"header","version":1,"t":0.0,"origin":{"lat_deg":1.0,"lon_deg":2.0,"alt_m":3.0},"sysids":[7,9]}',
    '{"type":"event","t":0.5,"sysid":9,"event":"liftoff"}',
    '{"type":"state","t":1.0,"ned":[[0,0,0],[3,4,-5]],"vel":[[0,0,0],[1,0,0]],"armed":[0,1],"airborne":[0,1]}',
    '{"type":"min","t":1.0,"pairs":[[9,7,5.0]]}',
    '{"type":"min","t":1.1,"pairs":[[7,9,4.0]]}',
    '{"type":"end","t":2.0}',
]


def _write(path: Path, lines: list[str]) -> Path:
    path.write_text("".join(line + "\n" for line in lines))
    return path


def test_a_whole_file(tmp_path: Path) -> None:
    truth = load_truth(_write(tmp_path / "truth.jsonl", SMALL))
    assert truth.sysids == (7, 9)
    np.testing.assert_array_equal(truth.time_s, [1.0])
    np.testing.assert_array_equal(truth.position_ned_m, [[[0, 0, 0], [3, 4, -5]]])
    np.testing.assert_array_equal(truth.airborne, [[False, True]])
    assert truth.minima == {(7, 9): 4.0}
    assert [(event.time_s, event.sysid, event.event) for event in truth.events] == [
        (0.5, 9, "liftoff")
    ]
    assert (truth.complete, truth.last_s, truth.damage) == (True, 2.0, Damage())


def test_every_torn_length_gives_the_lines_before(tmp_path: Path) -> None:
    """SIGKILL at any byte: all whole lines count, the torn one does not, and nothing raises."""
    whole = ("\n".join(SMALL) + "\n").encode()
    path = tmp_path / "truth.jsonl"
    for length in range(len(whole) + 1):
        path.write_bytes(whole[:length])
        damage = Damage()
        records = list(read_truth(path, damage))
        assert len(records) == whole[:length].count(b"\n")
        assert damage == Damage(0, torn=length > 0 and whole[length - 1 : length] != b"\n")
        assert load_truth(path).complete == (length == len(whole))


@pytest.mark.parametrize(
    "bad",
    [
        "no json",
        '{"type":"weather","t":1.0}',
        '{"type":"state","t":1.0}',
        '{"type":"state","t":1.0,"ned":[[0,0,0]],"vel":[[0,0,0]],"armed":[0],"airborne":[0]}',
        '{"type":"min","t":1.0,"pairs":[[1,2]]}',
        "\x00\x00\x00",
    ],
)
def test_a_bad_line_is_counted_and_the_next_ones_are_read(tmp_path: Path, bad: str) -> None:
    truth = load_truth(_write(tmp_path / "truth.jsonl", [*SMALL[:3], bad, *SMALL[3:]]))
    assert truth.damage == Damage(bad_lines=1)
    assert truth.minima == {(7, 9): 4.0}
    assert len(truth.time_s) == 1
