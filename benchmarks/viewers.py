"""Viewers of a page that do not draw it: ``python -m benchmarks.viewers URL SECONDS N [stall]``.

They use viser's protocol like a browser. With ``stall`` one stops reading after a second. The output is JSON with the
number of pictures that each has received: messages that colour the taxels of one body.
"""

from __future__ import annotations

import asyncio
import json
import struct
import sys
import time
from typing import Any
from urllib.parse import urlsplit

import msgspec
import viser
import zstandard
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed


def updates(message: bytes) -> list[Any]:
    """Return viser's messages in a WebSocket message."""
    size, packed = struct.unpack_from("<QQ", message)
    inner = zstandard.ZstdDecompressor().decompress(message[16 : 16 + packed], max_output_size=size)
    return msgspec.msgpack.decode(inner)["messages"]


async def view(url: str, seconds: float, *, stalls: bool = False) -> dict[str, Any]:
    """View a page for ``seconds``, and return the counts of what was received."""
    where, got = urlsplit(url), {"pictures": 0, "bytes": 0, "messages": 0}
    kind: Any = f"viser-v{viser.__version__}"
    origin: Any = f"http://{where.netloc}"
    address = f"ws://{where.netloc}{where.path.rstrip('/')}"
    async with connect(address, origin=origin, subprotocols=[kind], max_size=None, open_timeout=60) as socket:
        try:
            begun, first = 0.0, None
            while not begun or time.monotonic() < begun + (1.0 if stalls else seconds):
                message = await socket.recv()
                assert isinstance(message, bytes)
                got["bytes"] += len(message)
                for each in updates(message):
                    got["messages"] += 1
                    if each["type"] == "SceneNodeUpdateMessage" and "batched_colors" in each["updates"]:
                        first, begun = first or each["name"], begun or time.monotonic()
                        got["pictures"] += each["name"] == first
        except ConnectionClosed:
            got["closed"] = True
        if stalls:  # its buffers fill up and are never emptied
            socket.transport.pause_reading()
            await asyncio.sleep(seconds - 1.0)
            socket.transport.abort()
    return got | {"pictures_per_s": got["pictures"] / seconds}


async def _all(url: str, seconds: float, count: int, stalls: bool) -> list[dict[str, Any]]:
    return await asyncio.gather(*(view(url, seconds, stalls=stalls and k == 0) for k in range(count)))


if __name__ == "__main__":
    url, seconds, count = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    json.dump(asyncio.run(_all(url, seconds, count, "stall" in sys.argv[4:])), sys.stdout)
