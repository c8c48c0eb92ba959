"""Tars of strangers: plain files alone, and no more than was allowed."""

from __future__ import annotations

import io
import tarfile
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.archives import packed, plain_files

FILES = [("one", b"1" * 700), ("two", b""), ("three", b"3" * 512)]


def tar(*entries: tarfile.TarInfo, form: int = tarfile.GNU_FORMAT) -> bytes:
    """Of these headers, each with as many bytes as it says, and then one plain file."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:", format=form) as archive:
        for entry in entries:
            archive.addfile(entry, io.BytesIO(bytes(entry.size)))
        last = tarfile.TarInfo("last")
        last.size = 4
        archive.addfile(last, io.BytesIO(b"last"))
    return out.getvalue()


def entry(kind: bytes = tarfile.REGTYPE, **fields: object) -> tarfile.TarInfo:
    """A header."""
    made = tarfile.TarInfo("it")
    made.type = kind
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def sparse(name: str = "it") -> bytes:
    """As GNU tar writes a file of 4 GB that is one hole: a header, and nothing else."""
    header = bytearray(entry(tarfile.GNUTYPE_SPARSE, name=name).tobuf(tarfile.GNU_FORMAT))
    header[386:410] = b"%011o\0%011o\0" % (4 << 30, 0)
    header[483:495] = b"\x80" + (4 << 30).to_bytes(11, "big")
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header)
    return bytes(header) + bytes(1024)


def sparse_in_words() -> bytes:
    """The same in a header of its own (PAX)."""
    return tar(entry(pax_headers={"GNU.sparse.size": str(4 << 30)}), form=tarfile.PAX_FORMAT)


def test_what_was_packed_is_read_in_order() -> None:
    data = packed(FILES)
    assert list(plain_files(io.BytesIO(data), 1212)) == FILES
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        assert [each.mode for each in archive] == [0o600] * 3
    assert packed(FILES) == data


def test_as_many_bytes_as_were_allowed_and_not_one_more() -> None:
    """Before they are read."""
    assert len(list(plain_files(io.BytesIO(packed(FILES)), 1212))) == 3
    with pytest.raises(tarfile.TarError, match=r"holds more than 0\.001211 MB"):
        list(plain_files(io.BytesIO(packed(FILES)), 1211))


@pytest.mark.parametrize(
    "data",
    [
        sparse(),
        sparse_in_words(),
        tar(entry(tarfile.SYMTYPE, linkname="/etc/passwd")),
        tar(entry(tarfile.LNKTYPE, linkname="last")),
        tar(entry(tarfile.FIFOTYPE)),
        tar(entry(tarfile.CHRTYPE)),
        tar(entry(tarfile.DIRTYPE)),
        tar(entry(tarfile.CONTTYPE)),
        tar(entry(name="x" * 300)),
        tar(entry(name="x" * 300), form=tarfile.PAX_FORMAT),
        tar(entry(pax_headers={"size": "9"}), form=tarfile.PAX_FORMAT),
        tar(entry(), entry()),
        packed(FILES)[:600],
        packed(FILES)[:1000],
        packed(FILES)[:2560],
        b"",
        b"no tar" * 500,
    ],
)
def test_what_is_no_plain_file_is_refused(data: bytes) -> None:
    """Links, devices, holes, headers that change headers, a name twice, a torn tar."""
    tracemalloc.start()
    with pytest.raises(tarfile.TarError):
        list(plain_files(io.BytesIO(data), 1_000_000))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1_000_000


@given(at=st.integers(0, 4095), byte=st.integers(0, 255))
def test_a_changed_byte_is_an_error_of_the_tar_or_of_its_contents(at: int, byte: int) -> None:
    """And no other: its readers expect that one."""
    data = bytearray(packed(FILES))
    data[at] = byte
    try:
        found = list(plain_files(io.BytesIO(bytes(data)), 1212))
    except tarfile.TarError:
        return
    assert sum(len(content) for _, content in found) <= 1212
