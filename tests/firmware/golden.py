"""Golden frames: JSON files of vectors, each with its origin.

``tests/data/golden/*.json``, and ``golden/`` beside the file of a device that lives elsewhere::

    {"origin": ..., "vectors": [{"name", "origin", "device"?, "options"?, "after"?: [frame],
                                 "counts"? | "newtons"?, "request": frame, "reply": [frame] | "stream": [frame]}]}

A vector belongs to ``device``, or to the device that the file is named after. A frame is hex, or a CAN frame in candump
notation. A fresh device with ``options`` is sent ``after``; its skin is pushed by ``newtons`` (one number or one per
taxel), or its converter reads ``counts`` (one per value, or ``"index"``: 0, 1, 2 ...). Then it must answer ``request``
with exactly ``reply``, or its next sample must send exactly ``stream``.
"""

import importlib
import json
from pathlib import Path

import numpy as np

import firmware_protocols as fp
from firmware_protocols import CanFrame
from tests.firmware.feeding import frames, push

FOLDER = Path(__file__).parents[1] / "data" / "golden"


def golden_vectors(name: str) -> list[dict]:
    """Every vector in the file ``name``."""
    return _read(FOLDER / f"{name}.json")


def golden_vectors_of(name: str) -> list[dict]:
    """Every vector of the device ``name``, wherever it is written."""
    module = importlib.import_module(fp.load(name).__module__)
    files = [*FOLDER.glob("*.json"), *(Path(module.__file__).parent / "golden").glob("*.json")]
    return [vector for path in files for vector in _read(path) if vector.get("device", path.stem) == name]


def _read(path: Path) -> list[dict]:
    vectors = json.loads(path.read_text())["vectors"]
    assert vectors and all(vector["origin"] for vector in vectors)
    return vectors


def frame_from(text: str) -> bytes | CanFrame:
    """``"9a00"``, ``"028#C0"``, ``"18FF0000##1AABB"``, ``"123#R"``."""
    if "#" not in text:
        return bytes.fromhex(text)
    ident, _, rest = text.partition("#")
    is_fd, remote = rest.startswith("#"), rest == "R"
    return CanFrame(
        arbitration_id=int(ident, 16),
        data=b"" if remote else bytes.fromhex(rest[2:] if is_fd else rest),
        is_extended_id=len(ident) > 3,
        is_remote_frame=remote,
        is_fd=is_fd,
        bitrate_switch=is_fd and rest[1] == "1",
    )


def replay(vector: dict, name: str) -> None:
    device = fp.create(vector.get("device", name), **vector.get("options", {}))
    device.power_on(0)
    for k, request in enumerate(vector.get("after", [])):
        device.receive(frame_from(request), k * 10_000_000)
    t_ns, sent = 1_000_000_000, []
    if "newtons" in vector:
        sent = device.sample(push(device, vector["newtons"]), t_ns)
    elif "counts" in vector:
        device.counts = _counts(device, vector["counts"])
        sent = device.stream(t_ns)
    if "request" in vector:
        got, expected = device.receive(frame_from(vector["request"]), t_ns), vector["reply"]
    else:
        got, expected = sent, vector["stream"]
    assert [str(f) if isinstance(f, CanFrame) else f.hex() for f in frames(got)] == expected


def _counts(device: fp.Device, counts) -> np.ndarray:
    like = device.digitize(push(device, 0.0))
    values = np.arange(like.size) if counts == "index" else np.array(counts)
    return values.reshape(like.shape).astype(like.dtype)
