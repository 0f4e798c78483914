"""The live page in a real browser, and what those find who should not be there."""

import asyncio
import http.client
import socket
import subprocess
import sys
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import TactemuError
from tactemu.view.page import opening
from tests.control.conftest import runtime_folder  # noqa: F401
from tests.view.page.browser import browsing, colours_drawn, drag, opened

pytest.importorskip("viser", reason="the page comes with the extra web")
pytestmark = [pytest.mark.timeout(180)]


class Seen:
    """`tactemu see` of what is served."""

    def __init__(self, name: str):
        command = [sys.executable, "-m", "tactemu", "see", name, "--web-port", "0"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().split()[-1]
        self.where = urlsplit(self.url)

    def end(self) -> str:
        """What it said."""
        self.process.terminate()
        return self.process.communicate(timeout=20)[1]


@pytest.fixture(scope="module")
def dev(runtime_folder):  # noqa: F811
    with tt.serve("anyskin", name="page", adjustable=["noise"]) as device:
        yield device


@pytest.fixture(scope="module")
def seen(dev):
    page = Seen("page")
    yield page
    if page.process.poll() is None:
        page.end()


class Driver:
    """anyskin 1.0.0, unmodified."""

    def __init__(self, port: str):
        sensor = pytest.importorskip("anyskin.sensor")
        self.sensor = sensor.AnySkinBase(num_mags=5, port=port, temp_filtered=True)

    def reads(self) -> np.ndarray:
        """The mean of what comes now."""
        self.sensor.flush()
        return np.mean([sample[1:] for sample in self.sensor.get_data(5)], axis=0)

    def until(self, true, seconds: float = 30.0) -> np.ndarray:
        """What it reads, once that is so."""
        end = time.monotonic() + seconds
        while not true(read := self.reads()):
            assert time.monotonic() < end, read
        return read


def status(page, text: str) -> None:
    page.get_by_text(text).first.wait_for(timeout=60_000)


def test_what_is_dragged_reaches_the_driver(dev, seen):
    driver, wrong = Driver(dev.port), []
    rest = driver.reads()
    begun = np.array(dev.state()["bodies"]["ball"]["position"])
    with browsing() as browser:
        page = opened(browser, seen.url, wrong)
        status(page, "1 viewer")
        assert colours_drawn(page) > 50, "the scene is drawn"
        drag(page, (0, 70))
        driver.until(lambda read: np.abs(read - rest).max() > 20)
        status(page, "viewer 1 has it")
        page.mouse.up()
        page.keyboard.press("Escape")
        driver.until(lambda read: np.allclose(read, rest, atol=1e-3))
        assert np.allclose(dev.state()["bodies"]["ball"]["position"], begun)
    driver.sensor.close()
    assert not wrong


def test_a_fault_begins_on_enter_and_a_mistake_is_told_once(dev, seen):
    def faults() -> list[str]:
        return [str(fault) for fault in dev.emulator.wires[0].faults]

    wrong, end = [], time.monotonic() + 60
    with browsing() as browser:
        page = opened(browser, seen.url, wrong)
        status(page, "1 viewer")
        box = page.locator("form input").first
        box.click()
        box.press_sequentially("drop 10% for 50s", delay=60)
        assert faults() == [], "it began while it was typed"
        box.press("Enter")
        while not faults():
            assert time.monotonic() < end
        page.wait_for_timeout(500)
        assert [(each[:8], each[-8:]) for each in faults()] == [("drop 10%", " for 50s")]
        box.fill("dorp 10%")
        box.press("Enter")
        status(page, "did you mean 'drop'")
        assert page.get_by_text("That cannot be done").count() == 1 and len(faults()) == 1
        page.get_by_role("button", name="Mend all").click()
        while faults():
            assert time.monotonic() < end
    assert not wrong


@pytest.mark.nightly
def test_of_two_viewers_the_last_to_grab_has_it(dev, seen):
    wrong, done = [], dev.truth.injected["reset"]
    begun = np.array(dev.state()["bodies"]["ball"]["position"])
    with browsing() as browser:
        first, second = (opened(browser, seen.url, wrong) for _ in range(2))
        status(first, "2 viewers")
        drag(first, (0, -40))
        status(second, "viewer 1 has it")
        drag(second, (0, -60), offset=(0, -40))  # where the first one holds it
        status(first, "viewer 2 has it")
        first.mouse.up()
        second.mouse.up()
        assert not np.allclose(dev.state()["bodies"]["ball"]["position"], begun, atol=1e-3), "it is held"
        first.keyboard.press("Escape")  # not its own any more
        status(second, "viewer 2 has it")
        second.keyboard.press("Escape")
        end = time.monotonic() + 30
        while not np.allclose(dev.state()["bodies"]["ball"]["position"], begun):
            assert time.monotonic() < end
        first.reload()
        status(first, "2 viewers")
        first.get_by_role("button", name="Reboot").click()
        while dev.truth.injected["reset"] == done:
            assert time.monotonic() < end
    assert not wrong


@pytest.mark.nightly
@pytest.mark.parametrize("width", [1440, 400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_can_be_looked_at(dev, seen, width, scheme, tmp_path):
    wrong = []
    with browsing() as browser:
        page = opened(browser, seen.url, wrong, width=width, height=900, scheme=scheme)
        if width > 1000:
            status(page, "1 viewer")
        page.wait_for_timeout(3000)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate("document.documentElement.getAttribute('data-mantine-color-scheme')") == scheme
        page.screenshot(path=tmp_path / "page.png")
    assert not wrong


@pytest.mark.nightly
def test_when_the_emulator_ends_the_page_says_so(runtime_folder):  # noqa: F811
    with tt.serve("anyskin", "memory:", name="short"):
        page = Seen("short")
    time.sleep(1.0)
    assert get(page.where, page.where.path)[0] == 200, "it waits for the next run"
    assert not page.end()


def get(where, path: str, **headers: str) -> tuple[int, bytes, dict[str, str]]:
    connection = http.client.HTTPConnection(where.hostname, where.port, timeout=10)
    try:
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read(), dict(answer.getheaders())
    finally:
        connection.close()


def test_others_have_nothing_and_harm_nothing(dev, seen):
    import msgspec
    from websockets.asyncio.client import connect
    from websockets.exceptions import ConnectionClosed, InvalidStatus

    where, token = seen.where, seen.where.path
    ok, page, headers = get(where, token)
    assert ok == 200 and len(page) > 100_000 and "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    refused = [
        get(where, "/"),
        get(where, "/index.html"),
        get(where, f"/{'x' * 22}/"),
        get(where, f"{token}../index.html"),
        get(where, f"{token}index.html"),
        get(where, token, Host="evil.example"),
        get(where, token, Host=f"evil.example:{where.port}"),
        get(where, token, Origin="http://evil.example"),
    ]
    assert {(each[0], each[1]) for each in refused} == {(404, b"not found")}

    async def come(path: str, origin: str | None, *messages: bytes) -> int:
        """The code with which it is closed, or of the refusal."""
        address, kind = f"ws://{where.netloc}{path}", "viser-v" + __import__("viser").__version__
        try:
            async with connect(address, origin=origin, subprotocols=[kind], open_timeout=10) as viewer:
                for message in messages:
                    await viewer.send(message)
                async with asyncio.timeout(10):
                    while True:
                        await viewer.recv()
        except InvalidStatus as error:
            return error.response.status_code
        except ConnectionClosed as error:
            return error.rcvd.code if error.rcvd else 0

    def packed(**message) -> bytes:
        return msgspec.msgpack.encode(message)

    ours = f"http://{where.netloc}"
    for path, origin in (("/", ours), (token, "http://evil.example"), (token, None), (f"/{token[1:-1]}x", ours)):
        assert asyncio.run(come(path, origin)) == 404
    bad = [
        b"\xc1garbage",
        packed(type="ShareUrlRequest"),
        packed(type="FileTransferStartUpload", source_component_uuid="x"),
        packed(type="GuiUpdateMessage", uuid="x", updates={"removed": True}),
        packed(type="GuiUpdateMessage", uuid="x", updates={"value": float("nan")}),
        packed(type="ViewerCameraMessage", wxyz="no"),
        b"x" * 70_000,
    ]
    for message in bad:
        assert asyncio.run(come(token, ours, message)) in (1008, 1009), message[:60]
    assert get(where, token)[0] == 200 and dev.running
    said = seen.end()
    assert 0 < len(said.splitlines()) <= len(bad) + 12 and "Traceback" not in said, said


def test_what_it_lacks_is_said_in_words(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(TactemuError, match=f"cannot listen on 127.0.0.1, port {port}: Address already in use"):
            opening.open_listener(port=port)
    with pytest.raises(TactemuError, match="cannot listen on 192"):
        opening.open_listener("192.0.2.1")
    assert opening.warning(None) is None and "not encrypted" in (opening.warning("0.0.0.0") or "")
    monkeypatch.setattr(opening.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(TactemuError, match=r'pip install "tactemu\[web\]"'):
        opening.open_listener()


@pytest.mark.parametrize("is_over", [False, True])
def test_a_page_that_ends_before_its_run_is_said(is_over, monkeypatch, capfd, tmp_path):
    """As when its process is killed."""
    page = tmp_path / "page"
    page.write_text("#!/bin/sh\nsleep 0.3\n")
    page.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(page))
    told = ""
    with opening.page_process(opening.PageListener(socket.create_server(("127.0.0.1", 0)), "token"), "thumb") as over:
        if is_over:
            over.set()
        end = time.monotonic() + 20
        while not is_over and not told and time.monotonic() < end:
            told = capfd.readouterr().err
            time.sleep(0.01)
    assert told == ("" if is_over else "tactemu: the page has ended; `tactemu see thumb` opens it again\n")
    assert not capfd.readouterr().err
