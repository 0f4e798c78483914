"""Pages that a device shows by HTTP/1.1; the grammar is h11's, which opens no connection itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import h11

LONGEST = 16_384
"""Bytes of a request with its body; a longer one is refused."""


class Pages:
    """Answers requests that come in chunks of any size. ``counters`` gets ``requests`` and ``bad_request``."""

    def __init__(self, *, counters: Counter[str]):
        self.counters = counters
        self.heard = b""
        """Of a request that is not whole. Forget it where the line is closed."""

    def answers(self, data: bytes, pages: Mapping[str, tuple[str, bytes]]) -> list[bytes]:
        """Return one answer for each request that is now whole.

        Args:
            data: what came.
            pages: by path (what follows a ``?`` is not looked at): type and content.
        """
        self.heard += data
        answers = []
        while self.heard:
            line = h11.Connection(h11.SERVER, max_incomplete_event_size=LONGEST)
            line.receive_data(self.heard)
            try:
                request = event = line.next_event()
                while not isinstance(event, h11.EndOfMessage) and event is not h11.NEED_DATA:
                    event = line.next_event()
                if event is h11.NEED_DATA and len(self.heard) > LONGEST:
                    raise h11.RemoteProtocolError("too long", 413)
            except h11.RemoteProtocolError as error:
                self.counters["bad_request"] += 1
                self.heard = b""
                return [*answers, _answer(line, error.error_status_hint)]
            if event is h11.NEED_DATA:
                break
            assert isinstance(request, h11.Request)
            self.counters["requests"] += 1
            self.heard = line.trailing_data[0]
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
