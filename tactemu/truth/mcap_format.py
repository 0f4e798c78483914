"""``.mcap``: a truth log in the container format of robotics (https://mcap.dev), one message of arrays per sample.

Messages are those of ROS 2, so that Foxglove, PlotJuggler and ``mcap-ros2-support`` show them. Every skin has a topic
per kind (``/thumb/sample/force``, ``/thumb/tx`` ...); the time of a message is emulation time. Chunks are compressed
with LZ4, and a file that was cut off can be read up to its last complete chunk.
"""

from __future__ import annotations

import json
import mmap
import os
import stat
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from tactemu.truth.entries import BodyPose, End, Entry, Header, Sample, Sink, checked_end, checked_header
from tactemu.truth.messages import Decoder, Message, message_of, metadata_of

_CHUNK_BYTES = 1 << 18
"""Size of a chunk before compression [byte]; small, because a chunk is compressed without a break."""
_MAX_CHUNK_BYTES = 1 << 28
"""Maximum size of an uncompressed chunk that is read [byte]; protects the memory from damaged files."""
_MAX_MAPPED_BYTES = 1 << 24
"""Maximum size of the part of a file that stays in memory while it is read [byte]."""
_HEAD = "tactemu"
"""The name of the metadata record before the entries."""
_END = "tactemu end"
"""The name of the metadata record after the entries."""


class McapWriter:
    """A writer of entries as messages, to a file that is open for binary writing."""

    def __init__(self, file: Sink):
        from mcap.writer import CompressionType, Writer

        self._file = file
        self._writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.LZ4)  # type: ignore[arg-type]
        self._channels: dict[tuple, int] = {}
        self._schemas: dict[str, int] = {}
        self.is_saved = True
        """True if all entries are in the file."""

    def begin(self, header: Header) -> None:
        """Write the head of the file."""
        self._writer.start(library="tactemu")
        origin = {} if header.origin_ns is None else {"origin_ns": str(header.origin_ns)}
        scene = {} if header.scene is None else {"scene": json.dumps(header.scene, separators=(",", ":"))}
        self._writer.add_metadata(_HEAD, {"version": str(header.version), "ends": "1"} | origin | scene)

    def add(self, entry: Entry) -> Iterator[None]:
        """Write an entry, and yield between its parts, so that a large one can be written in slices of time."""
        kind, message, values = message_of(entry)
        yield
        key: tuple = (entry.body if isinstance(entry, BodyPose) else entry.device, kind)
        if isinstance(entry, Sample):
            key += (entry.sense, message.name, entry.ideal.shape, entry.counts.shape)
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._channel(message, metadata_of(entry, kind))
        data = message.encode(values)
        yield
        time = max(entry.t_ns, 0)  # the container has no negative times; the message has it as it is
        before = self._file.tell()
        self._writer.add_message(channel, time, data, time)
        self.is_saved = self._file.tell() != before

    def _channel(self, message: Message, metadata: dict[str, str]) -> int:
        if message.name not in self._schemas:
            definition = message.definition.encode()
            self._schemas[message.name] = self._writer.register_schema(message.name, "ros2msg", definition)
        topic = "/".join(("", *(metadata[name] for name in ("device", "body", "kind", "sense") if name in metadata)))
        return self._writer.register_channel(topic, "cdr", self._schemas[message.name], metadata)

    def flush(self) -> None:
        """Finish the chunk."""
        self._writer.flush()

    def finish(self, end: End) -> None:
        """Finish the chunk, and write the index."""
        self._writer.flush()
        summary = {"summary": json.dumps(list(end.summary), separators=(",", ":"))} if end.summary else {}
        self._writer.add_metadata(_END, {"lost": str(end.lost)} | summary)
        self._writer.finish()


def read(path: Path) -> Iterator[Header | Entry | End]:
    """Yield the entries of a file of messages; of a file that was cut off, up to its last complete chunk.

    Raises:
        OSError, ValueError: it cannot be read, is no truth log, or damaged before its end.
    """
    with path.open("rb") as file:
        yield from read_open(file)


def read_open(file: IO[bytes]) -> Iterator[Header | Entry | End]:
    """Yield the entries of an open file, or of a pipe while it is written.

    Raises:
        ValueError: it is no truth log, or damaged before its end.
    """
    status = os.fstat(file.fileno())
    if stat.S_ISFIFO(status.st_mode):
        yield from _entries(file)
        return
    if not status.st_size:
        raise ValueError("the file is empty")
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        yield from _entries(content)


def _entries(content: mmap.mmap | IO[bytes]) -> Iterator[Header | Entry | End]:
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, Footer, Metadata, Schema
    from mcap.records import Message as Record
    from mcap.stream_reader import StreamReader

    decoders: dict[int, Decoder] = {}
    definitions: dict[int, str] = {}
    known, read, closed = False, 0, False
    end: End | None = None
    try:  # a stream of a memory map reads no more than there is, whatever length a record claims
        for record in StreamReader(content, emit_chunks=True, record_size_limit=None).records:  # type: ignore[arg-type]
            if isinstance(record, Metadata) and record.name == _HEAD:
                yield _header(record.metadata)
                known = True
            elif isinstance(record, Metadata) and record.name == _END:
                end = checked_end(int(record.metadata["lost"]), json.loads(record.metadata.get("summary", "[]")))
            elif isinstance(record, Footer):
                closed = True
            elif isinstance(record, Chunk) and known:
                read = _release_pages(content, read) if isinstance(content, mmap.mmap) else 0
                for each in _unpacked(record):
                    if isinstance(each, Schema):
                        definitions[each.id] = str(each.data, "utf-8")
                    elif isinstance(each, Channel):
                        decoders[each.id] = Decoder(each.metadata, definitions[each.schema_id])
                    elif isinstance(each, Record):
                        yield decoders[each.channel_id](each.data)
    except (McapError, struct.error, ValueError, RuntimeError, LookupError, TypeError, ArithmeticError) as error:
        if not known:
            raise ValueError(str(error) or "cut off before it begins") from None
        if content.read(1):
            raise ValueError(
                f"the log is damaged before byte {content.tell()}: {error or type(error).__name__}"
            ) from None
    if not known:
        raise ValueError("an MCAP file, but no truth log of tactemu")
    if end is not None:
        yield end._replace(is_cut=not closed)


def _release_pages(content: mmap.mmap, before: int) -> int:
    """Release the pages that were read since ``before``, so that memory does not grow; return where they end."""
    read = content.tell() // mmap.PAGESIZE * mmap.PAGESIZE
    if read - before < _MAX_MAPPED_BYTES:
        return before
    content.madvise(mmap.MADV_DONTNEED, before, read - before)
    return read


def _unpacked(chunk: Any) -> list:
    """Return the records of a chunk, with a bounded size whatever its header claims.

    Raises:
        ValueError, RuntimeError: it is damaged.
    """
    from lz4.frame import LZ4FrameDecompressor
    from mcap.stream_reader import breakup_chunk

    if chunk.uncompressed_size > _MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression == "lz4":
        data = LZ4FrameDecompressor().decompress(chunk.data, max_length=chunk.uncompressed_size)
        chunk = replace(chunk, compression="", data=data)
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression!r}; truth logs have lz4")
    if len(chunk.data) != chunk.uncompressed_size:
        raise ValueError("a chunk is shorter than its header claims")
    return breakup_chunk(chunk, validate_crc=True)


def _header(metadata: dict[str, str]) -> Header:
    origin = metadata.get("origin_ns")
    return checked_header(
        int(metadata.get("version", "0")),
        None if origin is None else int(origin),
        json.loads(metadata.get("scene", "null")),
        "ends" in metadata,
    )
