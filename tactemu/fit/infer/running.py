"""A run of ``tactemu infer``: read, infer, write; with bounded memory, however long the capture is."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.fit.infer.analysis import Draft, infer
from tactemu.fit.infer.captures import Capture, Chunk
from tactemu.fit.infer.dialogue import parts_of_answer
from tactemu.fit.infer.fields import Group
from tactemu.fit.infer.frame_texts import Coverage, coverage_of, encoded_bytes, table_of
from tactemu.fit.infer.framing import cut_messages

LEARNT_BYTES = 6_000_000
LEARNT_CHUNKS = 150_000
"""The part that the inference looks at; the rest of a longer capture is only checked against the findings."""
BLOCK_BYTES = 4_000_000


def read_and_infer(paths: Sequence[Path]) -> tuple[Draft, Coverage]:
    """Return what a capture says, and what stands behind its bytes.

    Raises:
        TactemuError: a file cannot be read, or has nothing from the sensor.
    """
    chunks = Capture(tuple(paths)).chunks()
    learnt = list(_first(chunks))
    if not any(chunk.data for chunk in learnt if chunk.direction == "tx"):
        raise TactemuError(f"{', '.join(map(str, paths))}: nothing in it comes from the sensor")
    draft = infer(learnt)
    coverage = Coverage()
    for group in draft.groups:
        coverage += coverage_of(group, table_of(group))
    coverage.sent = draft.sent_bytes
    learnt_encoded = coverage.encoded
    for sent, encoded in _checked(draft, chunks):
        coverage.sent += sent
        coverage.encoded += encoded
    if learnt_encoded:  # messages that are encoded have the same shares of values and sums as those that were learnt
        more = coverage.encoded / learnt_encoded
        for name in ("values", "checks", "still"):
            setattr(coverage, name, round(getattr(coverage, name) * more))
    return draft, coverage


def _first(chunks: Iterator[Chunk]) -> Iterator[Chunk]:
    size = 0
    for chunk in islice(chunks, LEARNT_CHUNKS):
        yield chunk
        size += len(chunk.data)
        if size > LEARNT_BYTES:
            return


def _checked(draft: Draft, chunks: Iterator[Chunk]) -> Iterator[tuple[int, int]]:
    """Yield the bytes of each further block, and how many of them the tables encode as they came."""
    kinds: defaultdict[tuple[int | None, bytes | None, int], list[Group]] = defaultdict(list)
    for group in draft.groups:
        kinds[group.id, group.question, group.length].append(group)
    rest, question = b"", b""
    while block := list(_block(chunks)):
        messages: list[tuple[int | None, bytes | None, bytes]] = []
        sent = sum(len(chunk.data) for chunk in block if chunk.direction == "tx")
        if draft.is_can or draft.framing.kind == "answers":
            for chunk in block:
                if chunk.direction == "rx":
                    question = (chunk.id or 0).to_bytes(4, "big") + chunk.data if draft.is_can else chunk.data
                else:
                    cut = draft.framing.cut
                    parts = [chunk.data] if cut is None else parts_of_answer(chunk.data, cut, draft.framing.sum)
                    messages += [(chunk.id, question, part) for part in parts]
        else:
            stream = rest + b"".join(chunk.data for chunk in block if chunk.direction == "tx")
            found = cut_messages(stream, draft.framing)
            rest = stream[found[-1].at + found[-1].size :][-BLOCK_BYTES:] if found else b""
            messages = [(None, None, each.data) for each in found]
        yield sent, _encoded(kinds, messages)


def _block(chunks: Iterator[Chunk]) -> Iterator[Chunk]:
    size = 0
    for chunk in chunks:
        yield chunk
        size += len(chunk.data) + 8
        if size > BLOCK_BYTES:
            return


def _encoded(kinds: dict, messages: list[tuple[int | None, bytes | None, bytes]]) -> int:
    rows: defaultdict[tuple[int | None, bytes | None, int], list[bytes]] = defaultdict(list)
    for identifier, question, data in messages:
        key = identifier, question, len(data)
        rows[key if key in kinds else (identifier, None, len(data))].append(data)
    encoded = 0
    for key, same in rows.items():
        block = (
            np.array([np.frombuffer(data, np.uint8) for data in same]) if key in kinds else np.empty((0, 0), np.uint8)
        )
        for group in kinds.get(key, ()):
            chosen = block
            for at, (value, mask) in group.selectors.items():
                chosen = chosen[(chosen[:, at] & mask) == value]
            encoded += encoded_bytes(group, chosen) if len(chosen) else 0
    return encoded


def unframed_places(draft: Draft, most: int = 5) -> list[tuple[int, int]]:
    """Return offset and size of the first stretches of a stream that are in no message."""
    messages = draft.framing.messages
    found, at = [], 0
    for each in messages:
        if each.at > at:
            found.append((at, each.at - at))
        at = each.at + each.size + (1 if draft.framing.coding else len(draft.framing.end))
    return found[:most]
