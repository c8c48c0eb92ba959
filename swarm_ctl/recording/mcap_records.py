"""The records of an MCAP file, one by one, with bounds: a recording may come from a stranger.

The MCAP library's own reader believes all lengths in a file, and a chunk of a few kilobytes may
expand to gigabytes.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any, Final

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from swarm_ctl.errors import InputError

RECORD_BYTES: Final = 64_000_000
"""Of a record at most. The largest is the manifest in a file's metadata."""
CHUNK_BYTES: Final = 4 << 20
"""Of an expanded chunk at most: four times what `McapWriter` puts into one."""
MOST_EXPANDED: Final = 100
"""All chunks may expand to so many times the file's size together; ours expand about tenfold."""
TORN: Final = (McapError, struct.error, ValueError, OverflowError, EOFError, zstandard.ZstdError)
"""What is raised where a file ends in the middle of a record, or is damaged."""
_HEADER: Final = struct.Struct("<BQ")
"""Opcode and length of each record."""
_END: Final = struct.Struct("<BQQQI8s")
"""The footer (header, starts of the summary and of its offsets, checksum) and the last bytes."""
_FOOTER_BYTES: Final = 20
_MESSAGE: Final = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message; its data follow."""
_READ: Final[dict[int, Any]] = {
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.STATISTICS: Statistics,
}
_OPCODES: Final = range(1, 0x80)
"""Of records that a program may have written."""
_PACKED: Final = b"\x04\x00\x00\x00zstd"
_PACKED_AT: Final = _HEADER.size + 8 + 8 + 8 + 4
"""Where that stands in a chunk of ours: behind its times, its size and its checksum."""
_MOST_MENDED: Final = 200
"""Places of a file at which it is looked for the next chunk."""


@dataclass(slots=True)
class RecordingDamage:
    """What of a recording could be read, and what could not."""

    chunks: int = 0
    """That were read."""
    bad: int = 0
    """Chunks that were left out, and places where no record begins."""
    used: int = 0
    """Messages that were read."""
    said: int | None = None
    """Messages that the file says it has, in front of its footer; None where it does not."""
    expanded: int = 0
    """Bytes of all chunks."""

    def describe(self, name: str) -> list[str]:
        """The damage in words; empty where there is none."""
        if not self.bad:
            return []
        of = f"{self.used} of {self.said}" if self.said is not None else f"{self.used}"
        left_out = f"{self.bad} of {self.bad + self.chunks} chunks"
        words = f"damaged; {left_out} left out, {of} messages used, the file is left as it is"
        return [f"{name}: {words}"]


def skip_magic(file: IO[bytes]) -> None:
    """Read the first bytes of an MCAP file; EOFError, one of TORN, if it is none."""
    if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise EOFError


def records_of(file: IO[bytes], damage: RecordingDamage | None = None) -> Iterator[Any]:
    """The chunks, metadata, schemas, channels, messages and statistics from here to the footer, or
    to where the file ends. TORN and InputError pass: the latter where a record is larger than any
    of ours, or the chunks expand further.
    """
    damage = damage or RecordingDamage()
    while len(header := file.read(_HEADER.size)) == _HEADER.size:
        opcode, length = _HEADER.unpack(header)
        if opcode == Opcode.FOOTER:
            if length != _FOOTER_BYTES:  # a damaged length has led into the middle of a chunk
                raise EOFError
            return
        if opcode not in _OPCODES:
            raise EOFError
        if length > RECORD_BYTES:
            raise InputError(f"a record has {length} bytes; allowed: up to {RECORD_BYTES}")
        kind = _READ.get(opcode)
        if kind is None and opcode != Opcode.MESSAGE:
            if len(file.read(length)) < length:  # a damaged length skips what can be read
                raise EOFError
            continue
        data = file.read(length)
        if len(data) < length:
            raise EOFError
        record = kind.read(ReadDataStream(io.BytesIO(data))) if kind else _message(data)
        if isinstance(record, Chunk):
            damage.expanded += min(record.uncompressed_size, CHUNK_BYTES)
            if damage.expanded > MOST_EXPANDED * file.tell() + CHUNK_BYTES:
                raise InputError(f"it expands more than {MOST_EXPANDED} times; allowed: fewer")
        yield record


def mended(file: IO[bytes], damage: RecordingDamage) -> Iterator[Any]:
    """`records_of` a file, past places where no record can be read: on with the next chunk. The end
    of a file that was cut off is no damage. InputError as there, where nothing was read before."""
    for _ in range(_MOST_MENDED):
        offset = file.tell()
        try:
            for record in records_of(file, damage):
                if isinstance(record, Statistics):
                    damage.said = record.message_count
                yield record
                offset = file.tell()
            return
        except TORN:
            found = _next_chunk(file, offset + 1)
        except InputError:
            found = _next_chunk(file, offset + 1)
            if damage.expanded > MOST_EXPANDED * file.tell() or not (found or damage.chunks):
                raise
        if found is None:
            found = _summary(file)
            if found is None:
                return
        damage.bad += 1
        if found <= offset:
            return
        file.seek(found)


def _summary(file: IO[bytes]) -> int | None:
    """Where a whole file's summary begins: what has no further chunk is damaged there, not cut off.
    None for a file without an end."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _END.size))
    end = file.read()
    if len(end) < _END.size or not end.endswith(MCAP0_MAGIC):
        return None
    opcode, _, start, *_ = _END.unpack(end)
    return int(start) if opcode == Opcode.FOOTER and start < size else 0


def _next_chunk(file: IO[bytes], offset: int) -> int | None:
    """Where the next chunk of ours seems to begin, from there on; None: nowhere."""
    size = file.seek(0, os.SEEK_END)
    start = offset + _PACKED_AT
    while start < size:
        file.seek(start)
        block = file.read(CHUNK_BYTES)
        at = block.find(_PACKED)
        if at < 0:
            start += max(1, len(block) - len(_PACKED) + 1)
            continue
        found = start + at - _PACKED_AT
        file.seek(found)
        opcode, length = _HEADER.unpack(file.read(_HEADER.size))
        if opcode == Opcode.CHUNK and length <= min(2 * CHUNK_BYTES, size - file.tell()):
            return found
        start += at + 1
    return None


def _message(data: bytes) -> Message:
    """As `Message.read`, at a fifth of its price: a flight of 100 agents has 5,000 a second."""
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data)
    return Message(channel, log_time, data[_MESSAGE.size :], publish_time, sequence)


def unpacked(file: IO[bytes], damage: RecordingDamage) -> Iterator[Any]:
    """`mended`, with the records in a chunk in its place; a chunk that is damaged is left out
    whole."""
    told = False
    for record in mended(file, damage):
        if isinstance(record, Chunk):
            found = within(record, damage)
            if damage.bad and not told:  # what was lost may have been the names of all topics
                told = True
                yield from _named_at_the_end(file)
            yield from found
        else:
            yield record


def _named_at_the_end(file: IO[bytes]) -> list[Any]:
    """Schemas and channels, which are there again in front of the footer; the place in the file
    stays."""
    offset = file.tell()
    ahead = mended(file, RecordingDamage(chunks=1))
    found = [record for record in ahead if isinstance(record, Schema | Channel)]
    file.seek(offset)
    return found


def within(chunk: Chunk, damage: RecordingDamage) -> list[Any]:
    """The records in a chunk; none where it is damaged. InputError where it is none of ours, and
    none of ours was read before."""
    try:
        found = list(records_of(io.BytesIO(plain(chunk))))
    except TORN:
        damage.bad += 1
        return []
    except InputError:
        if not damage.chunks:
            raise
        damage.bad += 1
        return []
    damage.chunks += 1
    damage.used += sum(isinstance(record, Message) for record in found)
    return found


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
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise EOFError
    return data


def _too_large(size: int, most: int) -> InputError:
    return InputError(f"a chunk expands to {size} bytes or more; allowed: up to {most}")
