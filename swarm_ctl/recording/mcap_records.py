"""The records of an MCAP file, one by one, with bounds: a recording may come from a stranger.

The MCAP library's own reader believes all lengths in a file, and a chunk of a few kilobytes may
expand to gigabytes.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator
from typing import IO, Any, Final

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from swarm_ctl.errors import InputError

RECORD_BYTES: Final = 64_000_000
"""Of a record at most. The largest is the manifest in a file's metadata."""
CHUNK_BYTES: Final = 4 << 20
"""Of an expanded chunk at most: four times what `McapWriter` puts into one."""
MOST_EXPANDED: Final = 100
"""All chunks may expand to so many times the file's size together; ours expand about tenfold."""
TORN: Final = (McapError, struct.error, ValueError, EOFError, zstandard.ZstdError)
"""What is raised where a file ends in the middle of a record, or is damaged."""
_HEADER: Final = struct.Struct("<BQ")
"""Opcode and length of each record."""
_MESSAGE: Final = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message; its data follow."""
_READ: Final[dict[int, Any]] = {
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
}


def skip_magic(file: IO[bytes]) -> None:
    """Read the first bytes of an MCAP file; EOFError, one of TORN, if it is none."""
    if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise EOFError


def records_of(file: IO[bytes]) -> Iterator[Any]:
    """The chunks, metadata, schemas, channels and messages from here to the footer, or to where
    the file ends. TORN and InputError pass: the latter where a record is larger than any of ours,
    or the chunks expand further.
    """
    total = 0
    while len(header := file.read(_HEADER.size)) == _HEADER.size:
        opcode, length = _HEADER.unpack(header)
        if opcode == Opcode.FOOTER:
            return
        if length > RECORD_BYTES:
            raise InputError(f"a record has {length} bytes; allowed: up to {RECORD_BYTES}")
        kind = _READ.get(opcode)
        if kind is None and opcode != Opcode.MESSAGE:
            file.seek(length, os.SEEK_CUR)
            continue
        data = file.read(length)
        if len(data) < length:
            return
        record = kind.read(ReadDataStream(io.BytesIO(data))) if kind else _message(data)
        if isinstance(record, Chunk):
            total += record.uncompressed_size
            if total > MOST_EXPANDED * file.tell() + CHUNK_BYTES:
                raise InputError(f"it expands more than {MOST_EXPANDED} times; allowed: fewer")
        yield record


def _message(data: bytes) -> Message:
    """As `Message.read`, at a fifth of its price: a flight of 100 agents has 5,000 a second."""
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data)
    return Message(channel, log_time, data[_MESSAGE.size :], publish_time, sequence)


def unpacked(file: IO[bytes]) -> Iterator[Any]:
    """`records_of`, with the records in a chunk in its place."""
    for record in records_of(file):
        if isinstance(record, Chunk):
            yield from records_of(io.BytesIO(plain(record)))
        else:
            yield record


def plain(chunk: Chunk) -> bytes:
    """What is in a chunk; TORN and InputError pass, the latter where it is more than in ours."""
    data: bytes = chunk.data
    most = min(chunk.uncompressed_size, CHUNK_BYTES)
    if chunk.compression == "zstd":
        size = zstandard.frame_content_size(data)
        if size > most:
            raise _too_large(size, most)
        unpacker = zstandard.ZstdDecompressor(max_window_size=2 * CHUNK_BYTES)
        data = unpacker.stream_reader(data).read(most + 1)
    elif chunk.compression:
        raise InputError(f"a chunk is packed with {chunk.compression[:20]!r}; allowed: zstd, none")
    if len(data) > most:
        raise _too_large(len(data), most)
    return data


def _too_large(size: int, most: int) -> InputError:
    return InputError(f"a chunk expands to {size} bytes or more; allowed: up to {most}")
