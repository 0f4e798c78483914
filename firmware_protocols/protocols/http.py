"""The web pages of a device, by HTTP/1.1. The grammar is h11's, which opens no connection itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import h11

__all__ = ["Pages"]

MAX_REQUEST_BYTES = 16_384
"""The largest number of bytes of a request with its body; bounds the memory that a client can use."""


class Pages:
    """A server of pages for requests in chunks of any size. ``counters`` counts ``requests`` and ``bad_request``."""

    def __init__(self, *, counters: Counter[str]):
        self.counters = counters
        self.buffer = b""
        """The bytes of an incomplete request. Set it to empty when the line is closed."""

    def answers(self, data: bytes, pages: Mapping[str, tuple[str, bytes]]) -> list[bytes]:
        """Return one answer for each request that these bytes complete.

        Args:
            data: received bytes.
            pages: type and content of each page, by its path without the part from ``?`` on.
        """
        self.buffer += data
        answers = []
        while self.buffer:
            line = h11.Connection(h11.SERVER, max_incomplete_event_size=MAX_REQUEST_BYTES)
            line.receive_data(self.buffer)
            try:
                request = event = line.next_event()
                while not isinstance(event, h11.EndOfMessage) and event is not h11.NEED_DATA:
                    event = line.next_event()
                if event is h11.NEED_DATA and len(self.buffer) > MAX_REQUEST_BYTES:
                    raise h11.RemoteProtocolError("too long", 413)
            except h11.RemoteProtocolError as error:
                self.counters["bad_request"] += 1
                self.buffer = b""
                return [*answers, _answer(line, error.error_status_hint)]
            if event is h11.NEED_DATA:
                break
            assert isinstance(request, h11.Request)
            self.counters["requests"] += 1
            self.buffer = line.trailing_data[0]
            page = pages.get(request.target.decode("ascii").partition("?")[0])
            if request.method != b"GET" or page is None:
                answers.append(_answer(line, 404 if page is None else 405))
            else:
                answers.append(_answer(line, 200, *page))
        return answers


def _answer(line: h11.Connection, status: int, kind: str = "text/plain", content: bytes = b"") -> bytes:
    headers = [("Content-Type", kind), ("Content-Length", str(len(content)))]
    sent = line.send(h11.Response(status_code=status, headers=headers)) or b""
    for part in [h11.Data(data=content)] if content else []:
        sent += line.send(part) or b""
    return sent + (line.send(h11.EndOfMessage()) or b"")
