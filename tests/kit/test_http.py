"""Pages over HTTP: requests in any pieces, of any kind; h11's client side and the standard library's are the judges."""

from collections import Counter

import h11
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols.protocols.http import MAX_REQUEST_BYTES, Pages
from tests.fuzz import examples

SHOWN = {"/a.xml": ("text/xml", b"<a/>")}


def ask(target="/a.xml", method="GET", headers=(), body=b""):
    client = h11.Connection(h11.CLIENT)
    lines = [("Host", "box"), *headers, *([("Content-Length", str(len(body)))] if body else [])]
    sent = client.send(h11.Request(method=method, target=target, headers=lines))
    sent += client.send(h11.Data(data=body)) if body else b""
    return client, sent + client.send(h11.EndOfMessage())


def read(client, answer):
    client.receive_data(answer)
    response, content = client.next_event(), b""
    while not isinstance(event := client.next_event(), h11.EndOfMessage):
        content += event.data
    assert client.trailing_data[0] == b""
    return response.status_code, content


@pytest.mark.parametrize(
    ("target", "method", "body", "status"),
    [
        ("/a.xml", "GET", b"", 200),
        ("/a.xml?index=3", "GET", b"", 200),
        ("/b.xml", "GET", b"", 404),
        ("/b.xml", "HEAD", b"", 404),
        ("/a.xml", "POST", b"x" * 1000, 405),
    ],
)
@pytest.mark.parametrize("size", [1, 7, 10_000])
def test_requests_in_pieces(target, method, body, status, size):
    pages = Pages(counters=Counter())
    client, sent = ask(target, method, body=body)
    answers = [got for at in range(0, len(sent), size) for got in pages.answers(sent[at : at + size], SHOWN)]
    assert read(client, *answers) == (status, b"<a/>" if status == 200 else b"")
    assert pages.buffer == b"" and pages.counters == {"requests": 1}


def test_requests_behind_each_other_and_one_that_is_not_whole():
    pages = Pages(counters=Counter())
    (first, sent), (second, more) = ask(), ask("/b")
    answers = pages.answers(sent + more + sent[:10], SHOWN)
    assert [read(first, answers[0])[0], read(second, answers[1])[0]] == [200, 404]
    third, _ = ask()
    assert read(third, *pages.answers(sent[10:], SHOWN)) == (200, b"<a/>")


def test_nonsense_is_refused_and_the_next_request_is_answered():
    pages = Pages(counters=Counter())
    for nonsense in (b"\x00\x01\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", b"a" * (MAX_REQUEST_BYTES + 1)):
        (answer,) = pages.answers(nonsense, SHOWN)
        assert answer.startswith((b"HTTP/1.1 400 ", b"HTTP/1.1 431 ", b"HTTP/1.1 413 "))
    client, sent = ask()
    assert read(client, *pages.answers(sent, SHOWN)) == (200, b"<a/>") and pages.counters["bad_request"] == 4


def test_a_body_without_end_fills_no_memory():
    pages = Pages(counters=Counter())
    pages.answers(b"POST /a.xml HTTP/1.1\r\nHost: a\r\nContent-Length: 999999999\r\n\r\n", SHOWN)
    for _ in range(100):
        pages.answers(bytes(1000), SHOWN)
        assert len(pages.buffer) <= MAX_REQUEST_BYTES


@examples(100)
@given(st.lists(st.binary(max_size=60) | st.sampled_from([b"GET /a.xml HTTP/1.1\r\n", b"Host: a\r\n", b"\r\n"])))
def test_nothing_that_comes_makes_it_raise(chunks):
    pages = Pages(counters=Counter())
    for chunk in chunks:
        for answer in pages.answers(chunk, SHOWN):
            assert answer.startswith(b"HTTP/1.1 ")
