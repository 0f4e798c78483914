"""Tests of the proxy between an emulated sensor and its driver: equal bytes, faults, truth and a recording."""

import contextlib
import os
import select
import subprocess
import sys
import threading
import time
import tty

import numpy as np
import pytest

import firmware_protocols as fp
from tactemu.base.errors import TransportError
from tactemu.judge.proxy import MAX_PARTIAL_WAIT_NS, Cutter, Framing, Proxy, RealSerial, framing_of
from tactemu.truth import Truth, read_log
from tactemu.truth import recording as recordings
from tactemu.truth.recorder import Recorder

HEAD = bytes.fromhex("aa07080a")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("optoforce", "16 bytes that begin with aa07080a, decoded"),
        ("anyskin", "undecoded"),
        ("eflesh_binary", "decoded"),
        ("weiss_wts", "undecoded"),
        ("xela_uskin", "undecoded"),
    ],
)
def test_a_device_is_decoded_by_its_table_or_said_not_to_be(name, words):
    assert words in framing_of(fp.create(name)).about


def test_every_device_of_the_registry_can_be_looked_at():
    for name in fp.names():
        with contextlib.suppress(ImportError):  # a library that is not installed
            assert framing_of(fp.create(name)).about


def test_a_stream_is_cut_whatever_the_pieces():
    frames = [HEAD + bytes([k] * 12) for k in range(5)]
    whole = b"\x07" + frames[0] + frames[1] + b"noise\xaa\x07" + b"".join(frames[2:])
    for size in (1, 3, 16, 17, 500):
        cutter, found = Cutter(Framing(HEAD, 16)), []
        for at in range(0, len(whole), size):
            found += cutter.cut(whole[at : at + size])
        assert b"".join(found) == whole and [each for each in found if len(each) == 16] == frames
    cutter.cut(HEAD + b"\0")
    assert cutter.flush_partial() == [HEAD + b"\0"] and not cutter.partial


@contextlib.contextmanager
def proxied(tmp_path, **more):
    """Yield a proxy on a pty as the real port, the pty's far end, and the driver's end of the proxy's port."""
    sensor, real = os.openpty()
    tty.setraw(real)
    side = RealSerial(os.ttyname(real), 115200)
    proxy = Proxy(fp.create("optoforce"), side, f"pty:{tmp_path / 'skin'}", **more)
    ready = threading.Event()
    thread = threading.Thread(target=proxy.run, kwargs={"seconds": 30, "opened": lambda _: ready.set()})
    thread.start()
    assert ready.wait(5)
    driver = os.open(tmp_path / "skin", os.O_RDWR | os.O_NOCTTY)
    tty.setraw(driver)
    time.sleep(0.1)
    try:
        yield proxy, sensor, driver
    finally:
        proxy.stop()
        thread.join()
        side.close()
        for each in (driver, sensor, real):
            os.close(each)


def taken(fd, size, seconds=3.0):
    data, deadline = b"", time.monotonic() + seconds
    while len(data) < size and select.select([fd], [], [], max(0, deadline - time.monotonic()))[0]:
        data += os.read(fd, 65536)
    return data


def packet(k):
    body = HEAD + k.to_bytes(2, "big") + bytes(2) + bytes([0, k % 100, 0, 1, 255, 0])
    return body + (sum(body) & 0xFFFF).to_bytes(2, "big")


def test_bytes_are_equal_both_ways_and_recorded_and_decoded(tmp_path):
    random = np.random.default_rng(0)
    with (
        Recorder(tmp_path / "real.mcap") as recorder,
        proxied(tmp_path, truth=Truth(tmp_path / "t.jsonl"), recorder=recorder) as (proxy, sensor, driver),
    ):
        sent = b"".join(packet(k) + random.bytes(int(random.integers(0, 3))) for k in range(100))
        for at in range(0, len(sent), 37):
            os.write(sensor, sent[at : at + 37])
            time.sleep(0.0005)
        asked = random.bytes(300)
        os.write(driver, asked)
        assert taken(driver, len(sent)) == sent and taken(sensor, len(asked)) == asked
        assert proxy.passed == {"to driver": len(sent), "from driver": len(asked)} and proxy.samples == 100
    log = read_log(tmp_path / "t.jsonl")["sensor"]
    assert log.counts.shape == (100, 3) and log.counts[:, 0].tolist() == [k % 100 for k in range(100)]
    recording = recordings.load(tmp_path / "real.mcap")
    assert b"".join(entry.frame for entry in recording.entries if entry.kind == "tx") == sent
    assert b"".join(entry.frame for entry in recording.entries if entry.kind == "rx") == asked


def test_faults_hit_whole_frames_both_ways(tmp_path):
    faults = ["flip frame 3 byte 8 bit 0", "drop frame 5", "drop frame 1 from_driver"]
    with proxied(tmp_path, faults=faults) as (proxy, sensor, driver):
        frames = [packet(k) for k in range(8)]
        os.write(sensor, b"".join(frames)[:50])
        time.sleep(0.005)
        os.write(sensor, b"".join(frames)[50:])
        flipped = frames[2][:8] + bytes([frames[2][8] ^ 1]) + frames[2][9:]
        expected = b"".join([*frames[:2], flipped, frames[3], *frames[5:]])
        assert taken(driver, len(expected)) == expected
        os.write(driver, b"lost")
        time.sleep(0.05)
        os.write(driver, b"heard")
        assert taken(sensor, 5) == b"heard"
        assert dict(proxy.truth.injected) == {"flip": 1, "drop": 2}


def test_the_drivers_speed_reaches_the_sensor(tmp_path):
    import serial

    with proxied(tmp_path) as (proxy, _, _driver):
        with serial.Serial(str(tmp_path / "skin"), 57600, stopbits=2) as port:
            for baud in (57600, 38400):  # the second while nothing else happens
                port.baudrate = baud
                deadline = time.monotonic() + 20
                while (proxy.real.port.baudrate, proxy.real.port.stopbits) != (baud, 2):
                    assert time.monotonic() < deadline
                    time.sleep(0.01)


def test_a_port_that_is_not_there():
    with pytest.raises(TransportError, match="cannot open /dev/nope: No such file or directory; check the name"):
        RealSerial("/dev/nope", 115200)


@pytest.mark.idle("it measures less than a millisecond between two processes")
def test_less_than_a_millisecond_is_added(tmp_path):
    """Check the time from the sensor's write to the driver's read, with the command in its own process."""
    sensor, real = os.openpty()
    tty.setraw(real)
    command = [sys.executable, "-m", "tactemu", "proxy", os.ttyname(real), "--sensor", "optoforce"]
    with subprocess.Popen([*command, "--port", f"pty:{tmp_path / 'skin'}"], stdout=subprocess.PIPE, text=True) as proxy:
        try:
            assert proxy.stdout is not None and "passed on" in proxy.stdout.readline()
            driver = os.open(tmp_path / "skin", os.O_RDWR | os.O_NOCTTY)
            tty.setraw(driver)
            time.sleep(0.2)
            waits = []
            for k in range(3000):
                frame = packet(k)
                begun = time.perf_counter()
                os.write(sensor, frame)
                assert taken(driver, 16) == frame
                waits.append(time.perf_counter() - begun)
                time.sleep(0.002)
            os.close(driver)
        finally:
            proxy.terminate()
    print(f"added: p50 {np.quantile(waits, 0.5) * 1e3:.3f} ms, p99 {np.quantile(waits, 0.99) * 1e3:.3f} ms")
    assert np.quantile(waits, 0.99) < 1e-3


def test_a_frame_that_pauses_passes_once(tmp_path):
    with proxied(tmp_path) as (proxy, sensor, driver):
        os.write(sensor, packet(1)[:9])
        assert taken(driver, 9) == packet(1)[:9]
        time.sleep(3 * MAX_PARTIAL_WAIT_NS / 1e9)
        os.write(sensor, packet(1)[9:] + packet(2))
        assert taken(driver, 23) == packet(1)[9:] + packet(2)
        assert proxy.samples == 2
