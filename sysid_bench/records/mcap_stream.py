"""MCAP bytes -> their records in order: chunks opened within limits, checksums held."""

# protobuf, mcap and pyarrow say no types.
# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from google.protobuf.message import DecodeError
from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

from sysid_bench.nouns import InputError
from sysid_bench.records.columns import MAX_PER_BYTE

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # kind and length of a record
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
MAX_CHUNK_BYTES = 256 * 2**20
# What mcap, protobuf, zstandard and lz4 raise on damaged bytes.
DAMAGED = (
    McapError, DecodeError, struct.error, zstandard.ZstdError, RuntimeError, EOFError, ValueError,
    TypeError, KeyError, OverflowError, MemoryError,
)  # fmt: skip


def check_ends(path: Path) -> None:
    """Raises InputError where the file is no MCAP or does not end as one."""
    with open(path, "rb") as file:
        start = file.read(len(MAGIC))
        file.seek(max(0, path.stat().st_size - len(MAGIC)))
        end = file.read()
    if start != MAGIC and not (len(start) < len(MAGIC) and MAGIC.startswith(start)):
        raise InputError(f"record {path}: not an MCAP file (wrong first bytes).")
    if end != MAGIC or path.stat().st_size < 2 * len(MAGIC):
        raise InputError(
            f"record {path}: truncated MCAP: its end is missing, the writer was stopped. "
            f"`sysid-bench recover {path}` writes a clean file with the samples that are there."
        )


def stream(file: IO[bytes], size: int) -> Iterator[Any]:
    """Records of the data section in order, chunks opened, checksums held; memory stays bounded."""
    for item in StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size).records:
        if isinstance(item, mcap_records.Chunk):
            yield from _opened(item)
        elif isinstance(item, mcap_records.DataEnd):
            return
        else:
            yield item


def _opened(chunk: mcap_records.Chunk) -> Iterator[Any]:
    """Schemas, channels and messages in a chunk. Raises what DAMAGED lists."""
    data = _unpacked(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk whose checksum is wrong")
    source, kinds = BytesIO(data), {Opcode.SCHEMA: mcap_records.Schema, Opcode.CHANNEL: mcap_records.Channel}
    while head := source.read(_HEAD.size):
        opcode, length = _HEAD.unpack(head)
        body = source.read(length)
        if len(body) != length or opcode == 0:
            raise ValueError("a chunk with a record that is cut or has no kind")
        if opcode == Opcode.MESSAGE:
            channel, sequence, log, publish = _MESSAGE.unpack_from(body)
            yield mcap_records.Message(channel, log, body[_MESSAGE.size :], publish, sequence)
        elif opcode in kinds:
            yield kinds[opcode].read(ReadDataStream(BytesIO(body)))


def _unpacked(chunk: mcap_records.Chunk) -> bytes:
    """The chunk's bytes uncompressed; one that says or gives more than it should is refused."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size:,} bytes; at most {MAX_CHUNK_BYTES:,} are read")
    if size > 8 * MAX_PER_BYTE * len(chunk.data) + 2**16:
        raise ValueError(f"a chunk of {len(chunk.data):,} bytes that says {size:,} when opened")
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(chunk.data) not in (-1, size):
            raise ValueError("a zstd chunk whose size is not what it says")
        data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression[:20]!r}; zstd, lz4 or none are read")
    if len(data) != size:
        raise ValueError(f"a chunk of {len(data):,} bytes that says {size:,}")
    return data
