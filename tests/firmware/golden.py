"""Golden frames: ``tests/data/golden/<device>.json``, each vector with its origin.

``{"origin": ..., "vectors": [{"name", "origin", "options"?, "after"?: [hex], "request": hex, "reply": [hex]}]}``:
a fresh device with ``options``, sent ``after`` and then ``request``, must answer exactly ``reply``.
"""

import json
from pathlib import Path

import firmware_protocols as fp
from tests.firmware.feeding import frames

FOLDER = Path(__file__).parents[1] / "data" / "golden"


def golden_vectors(name: str) -> list[dict]:
    vectors = json.loads((FOLDER / f"{name}.json").read_text())["vectors"]
    assert vectors and all(vector["origin"] for vector in vectors)
    return vectors


def replay(vector: dict, name: str) -> None:
    device = fp.create(name, **vector.get("options", {}))
    device.power_on(0)
    for k, request in enumerate(vector.get("after", [])):
        device.receive(bytes.fromhex(request), k * 10_000_000)
    got = frames(device.receive(bytes.fromhex(vector["request"]), 1_000_000_000))
    assert [frame.hex() for frame in got] == vector["reply"]
