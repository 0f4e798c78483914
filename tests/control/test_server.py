"""The socket: what clients may do, and what hostile ones cannot."""

import json
import os
import socket
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tactemu as tt
from tactemu.base.errors import TactemuError
from tactemu.control import server
from tactemu.control.endpoints import running
from tests.fuzz import examples


@pytest.fixture(scope="module")
def dev():
    with tt.serve("anyskin", "memory:", rate_hz=200, name="skin", adjustable=["noise"]) as device:
        yield device


class Raw:
    """A client that says whatever it likes."""

    def __init__(self, folder):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(10)
        self.socket.connect(str(folder / "skin.sock"))
        self.file = self.socket.makefile("rb")
        self.hello = self.read()

    def say(self, data: bytes) -> None:
        self.socket.sendall(data)

    def read(self) -> Any:
        line = self.file.readline()
        return json.loads(line) if line else None

    def ask(self, verb, ident=1, **args):
        self.say(json.dumps({"id": ident, "verb": verb, "args": args}).encode() + b"\n")
        return self.read()

    def close(self):
        self.file.close()
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def wait_until(true, seconds=10.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_what_a_test_may_do_another_process_may(dev):
    with tt.connect("skin") as skin:
        assert skin.about["skins"] == {"anyskin": "anyskin"} and skin.about["clock"] == "real"
        skin.press(1e-3, taxel=2)
        assert skin.sample().ideal[2][2] == pytest.approx(-1.0, abs=1e-4)
        assert skin.state()["bodies"]["ball"]["in_hand"]
        skin.release()
        assert not skin.sample().ideal.any()
        skin.fault("drop 100% for 50ms")
        skin.wait(0.1)
        stats = skin.stats()
        assert stats["skins"]["anyskin"]["injected"]["drop"] >= 5
        assert stats["clients"]["commands"] >= 6
        with pytest.raises(TactemuError, match=r"taxel: expected 0\.\.4, got 9"):
            skin.press(1e-3, taxel=9)
        with pytest.raises(TactemuError, match="built without bias"):
            skin.set({"bias": 1.0})
        skin.set({"noise": 0.1})
        skin.set({"noise": 0.0})


def test_states_come_at_the_rate_that_is_wished_and_none_is_old(dev, runtime_folder):
    with tt.connect() as skin:
        times = [state["t_s"] for _, state in zip(range(10), skin.watch(rate=50))]
        assert times == sorted(set(times)) and times[-1] - times[0] > 8 / 50
        assert skin.stats()["skins"], "the connection goes on"
    with Raw(runtime_folder) as raw:
        raw.ask("watch", rate=100)
        time.sleep(0.5)  # not reading: states that would wait are left out as soon as one does
        raw.say(b'{"id": 2, "verb": "unwatch"}\n')
        seen = []
        while (said := raw.read()).get("id") != 2:
            seen.append(said["t_s"])
        assert seen == sorted(set(seen))


def test_who_watches_gets_arrays_and_what_happens_on_the_wire(dev):
    with tt.connect() as skin:
        assert not dev.truth._has_sinks, "nobody is told of frames"
        moments = skin.watch(rate=50, arrays=True, wire=20, skin="anyskin")
        first, second = next(moments), next(moments)
        dev.unplug(0.01)
        rows = [row for _, state in zip(range(6), moments) for row in state["wire"]]
        moments.close()
        latest = skin.sample()
        assert not dev.truth._has_sinks
    sample = second["skins"]["anyskin"]["sample"]
    assert sample["measured"].shape == (5, 3) and sample["counts"].dtype == np.float32
    assert latest.number >= sample["number"]
    assert first["t_s"] < second["t_s"] and {"tx", "drop", "inject", "event"} >= {row["kind"] for row in rows}
    assert any(row["kind"] == "inject" and row["what"] == "unplug" for row in rows)
    assert any(row["kind"] == "event" and '"verb": "unplug"' in row["what"] for row in rows), "and of what was asked"


def test_what_is_there_is_described(dev):
    with tt.connect() as skin:
        told = skin.describe()
        body = {each["name"]: each for each in told["scene"]["bodies"]}["ball"]
        assert body["outline"] == {"radius": 0.02}
        assert told["devices"]["anyskin"]["adjustable"] == ["noise"]
        assert [each["name"] for each in told["devices"]["anyskin"]["columns"]] == ["T", "Bx", "By", "Bz"]


def test_a_body_is_moved_no_faster_than_is_said(dev):
    with tt.connect() as skin:
        begun = np.array(skin.state()["bodies"]["ball"]["position"])
        skin.move(by=(0, 0, 0.1), body="ball", speed=0.2, wait=False)
        skin.wait(0.1)
        skin.move(by=(0, 0, 0), body="ball", wait=False)  # stay
        way = np.array(skin.state()["bodies"]["ball"]["position"]) - begun
        assert 0.015 < way[2] < 0.05
        skin.give_back("ball")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"press", "expected a JSON object on a line, got b'press'"),
        (b"[1]", "expected a JSON object on a line, got [1]"),
        (b"\xff\xfe", "expected a JSON object"),
        (b'{"a":' * 5000 + b"1" + b"}" * 5000, "expected a JSON object"),
        (b'{"verb": "press", "args": {"depth": NaN}}', "expected a JSON object"),
        (b'{"verb": "press", "args": {"depth": 1e999}}', "press: depth must be"),
        (b'{"verb": "pres"}', "verb: there is no 'pres'; did you mean 'press'?"),
        (b'{"verb": ["press"]}', "verb: there is no ['press']"),
        (b'{"verb": "press", "args": [1]}', "args: expected a table"),
        (b'{"id": [1], "verb": "stats"}', "id: expected a whole number or a short text"),
        (b'{"id": 1, "protocol": 2, "verb": "stats"}', "protocol: this emulator has version 1, got 2"),
        (b'{"verb": "watch", "args": {"rate": 1e9}}', "watch: rate must be"),
        (b'{"verb": "watch", "args": {"wire": 1000}}', "watch: wire must be"),
        (b'{"verb": "watch", "args": {"wire": 1, "skin": "thumb"}}', "no skin 'thumb' (skins: anyskin)"),
        (b'{"verb": "watch", "args": {"arrays": "pickle"}}', "watch: arrays must be lists or base64"),
        (b'{"verb": "happen", "args": {"fault_": "drop"}}', "did you mean 'fault'?"),
        (b'{"verb": "step"}', "step: time runs by itself"),
        (b'{"verb": "_do"}', "verb: there is no '_do'"),
    ],
)
def test_a_request_that_is_none_is_refused_in_words(dev, runtime_folder, line, says):
    with Raw(runtime_folder) as raw:
        before = dev.stats()["clients"].get("errors", 0)
        raw.say(line + b"\n")
        said = raw.read()
        assert not said["ok"] and says in said["error"]
        assert raw.ask("stats")["ok"], "the next one is answered"
        assert dev.stats()["clients"]["errors"] == before + 1


def test_requests_in_pieces_and_many_at_once_are_heard(dev, runtime_folder):
    with Raw(runtime_folder) as raw:
        for k in range(len(line := b'{"id": "a", "verb": "sample"}\n')):
            raw.say(line[k : k + 1])
        assert raw.read()["id"] == "a"
        raw.say(b"".join(b'{"id": %d, "verb": "state"}\n' % k for k in range(200)))
        assert sorted(raw.read()["id"] for _ in range(200)) == list(range(200))


def test_who_says_its_last_word_has_its_answer(dev, runtime_folder):
    """As ``echo ... | nc -U``: the writing half is closed at once."""
    with Raw(runtime_folder) as raw:
        raw.say(b'{"id": 1, "verb": "wait", "args": {"seconds": 0.2}}\n')
        raw.socket.shutdown(socket.SHUT_WR)
        assert raw.read()["ok"] and raw.read() is None


def test_a_line_without_an_end_is_cut_off(dev, runtime_folder):
    with Raw(runtime_folder) as raw:
        with pytest.raises(OSError):
            for _ in range(1000):
                raw.say(b"x" * 4096)
        assert raw.read()["error"] == "a line is longer than 65536 bytes"


def test_there_is_room_for_sixteen(dev, runtime_folder):
    clients = [Raw(runtime_folder) for _ in range(server.MAX_CLIENTS)]
    try:
        with Raw(runtime_folder) as raw:
            assert raw.hello["error"].startswith("16 clients are connected already") and raw.read() is None
        assert all(client.ask("sample")["ok"] for client in clients)
    finally:
        for client in clients:
            client.close()
    wait_until(lambda: "protocol" in Raw(runtime_folder).hello)


def test_those_who_left_while_something_was_under_way_make_room(dev, runtime_folder):
    for _ in range(server.MAX_CLIENTS):
        with Raw(runtime_folder) as raw:
            raw.say(b'{"id": 1, "verb": "wait", "args": {"seconds": 1e6}}\n')
    with Raw(runtime_folder) as raw:
        assert raw.ask("stats")["ok"]


def test_a_client_that_does_not_read_is_dropped(dev, runtime_folder, monkeypatch):
    monkeypatch.setattr(server, "CLIENT_TIMEOUT_S", 0.3)
    with Raw(runtime_folder) as raw:
        before = dev.stats()["clients"].get("dropped", 0)
        raw.socket.settimeout(0.05)
        end = time.monotonic() + 10
        with pytest.raises(OSError):
            while time.monotonic() < end:
                try:
                    raw.say(b'{"verb": "state"}\n' * 100)
                except TimeoutError:
                    continue
        wait_until(lambda: dev.stats()["clients"].get("dropped", 0) == before + 1)


VALUES = st.none() | st.booleans() | st.floats() | st.text(max_size=9) | st.sampled_from([1 << 99, "press", "id"])
NESTED = st.recursive(
    VALUES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
NEARLY = st.fixed_dictionaries(
    {},
    optional={
        "id": st.integers() | st.text(max_size=3),
        "verb": st.sampled_from(["press", "move", "pose", "set", "happen", "dead", "fault", "watch", "mend"]),
        "args": st.dictionaries(
            st.sampled_from(["depth", "body", "taxels", "fault", "options", "position", "at", "seconds", "x"]),
            VALUES | st.sampled_from(["ball", "drop 1%", [0, 0, 1], [1, 2], {"noise": 0.0}]),
            max_size=3,
        ),
    },
)
LINES = st.one_of(
    st.binary(max_size=200),
    NESTED.map(lambda value: json.dumps({"verb": "press", "args": value}).encode() + b"\n"),
    NEARLY.map(lambda value: json.dumps(value).encode() + b"\n"),
)


@given(st.lists(LINES, max_size=6), st.booleans())
@examples(60)
def test_whatever_a_client_says_the_others_are_served(dev, runtime_folder, lines, reads):
    with Raw(runtime_folder) as raw:
        raw.say(b"".join(lines))
        if reads:
            raw.say(b'\n{"id": "last", "verb": "sample"}\n')
            while (said := raw.read()) is not None and said.get("id") != "last":
                pass
            assert said is not None and said["ok"]
    with tt.connect("skin") as skin:
        assert skin.sample().number > 0
    assert dev.running


def test_nothing_is_left(runtime_folder):
    with tt.serve("anyskin", "memory:", name="short"):
        assert "short" in [owner.name for owner in running()]
        connection = tt.connect("short")
    assert not (runtime_folder / "short.sock").exists()
    with pytest.raises(TactemuError, match="the emulator has stopped"):
        connection.stats()
    connection.close()


def test_another_user_is_refused(dev, runtime_folder):
    if os.getuid() != 0:
        pytest.skip("to be somebody else takes root")
    code = (
        f"import os, socket; s = socket.socket(socket.AF_UNIX); d = os.open({str(runtime_folder)!r}, os.O_RDONLY);"
        "os.fchdir(d); os.setuid(65534); s.connect('skin.sock'); print(s.makefile().readline())"
    )
    mode = runtime_folder.stat().st_mode
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert "PermissionError" in done.stderr, "the folder keeps them out"
        runtime_folder.chmod(0o755)
        (runtime_folder / "skin.sock").chmod(0o777)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert json.loads(done.stdout)["error"] == "this emulator belongs to another user", "and so does the emulator"
    finally:
        runtime_folder.chmod(mode)
