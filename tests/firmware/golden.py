"""Golden frames: JSON files of vectors, each with its origin.

``tests/data/golden/*.json``, and ``golden/`` beside the file of a device that lives elsewhere::

    {"origin": ..., "vectors": [{"name", "origin", "device"?, "options"?, "after"?: [frame], "counts"? | "newtons"? |
                                 "pushes"?, "request": frame, "reply": [frame] | "stream": [frame]}]}

A vector belongs to ``device``, or to the device that the file is named after. A frame is hex, or a CAN frame in candump
notation. A fresh device with ``options`` is sent ``after``; its skin is pushed by ``newtons`` (one number or one per
taxel) or by ``pushes`` (pictures of patches by name, in newtons; the others are not touched), or its converter reads
``counts`` (one per value, or ``"index"``: 0, 1, 2 ...). Then it must answer ``request`` with exactly ``reply``, or its
next conversion must send exactly ``stream``.
"""

import importlib
import json
from pathlib import Path

import numpy as np

import firmware_protocols as fp
from firmware_protocols.frames import frame_of, text_of
from tests.firmware.feeding import frames, reading_of, send

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


def replay(vector: dict, name: str) -> None:
    device = fp.create(vector.get("device", name), **vector.get("options", {}))
    for k, request in enumerate(vector.get("after", [])):
        send(device, request, k * 10_000_000)
    t_ns, sent = 1_000_000_000, []
    for stream in device.periods:
        counts = device.feel(reading_of(device, vector.get("pushes", vector.get("newtons", 0.0)), stream), t_ns)
        if "counts" in vector:
            device.counts = _counts(vector["counts"], counts)
        if "stream" in vector:
            sent += frames(device.stream(t_ns, stream))
    got = send(device, vector["request"], t_ns) if "request" in vector else sent
    expected = vector["reply"] if "request" in vector else vector["stream"]
    assert [text_of(frame_of(text)) for text in expected] == [text_of(frame) for frame in got]


def _counts(counts, like: np.ndarray) -> np.ndarray:
    values = np.arange(like.size) if counts == "index" else np.array(counts)
    return values.reshape(like.shape).astype(like.dtype)
