"""Files that are written whole: what they say where they can't be."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.files import append_line, replacing

FULL = Path("/dev/full")


@pytest.mark.parametrize("name", [".", "folder", "none/page.html"])
def test_a_place_that_can_not_be_written_is_named_itself(name: str, tmp_path: Path) -> None:
    """A folder (`--out .`), or a file in a folder that is not there: the error has the path that
    was given, no name of a file in between, and nothing is left."""
    (tmp_path / "folder").mkdir()
    path = tmp_path / name
    with pytest.raises(OSError) as caught, replacing(path):  # noqa: PT011
        pass
    assert caught.value.filename == str(path)
    assert sorted(each.name for each in tmp_path.rglob("*")) == ["folder"]


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")
def test_of_a_full_disk_the_file_is_named(tmp_path: Path) -> None:
    """A write's own error has no name; one that has the name of another file keeps it."""
    with pytest.raises(OSError, match=str(FULL)):
        append_line(FULL, "a line")
    for name, said in ((None, str(tmp_path / "page.html")), ("its source", "its source")):
        with pytest.raises(OSError, match=said), replacing(tmp_path / "page.html"):
            raise OSError(28, "No space left on device", name)
    assert not list(tmp_path.iterdir())
