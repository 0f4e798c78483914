"""Unmodified drivers of sensors on a network, below the whole of tactemu."""

import http.client
import os
import threading
from collections import Counter

import numpy as np
import pytest

import tactemu
from tests.drivers.rig import assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]


def pushed(t_s):
    """A force that names its time [N]."""
    return np.array([[np.sin(40 * t_s), np.cos(30 * t_s), -5 - 4 * np.sin(7 * t_s)]])


def port_of(served, name):
    return int(served.ports[f"{served.emulator.channels[0].name}/{name}"].rpartition(":")[2])


def ati(faults=(), **options):
    ports = {"rdt": "udp:0", "http": "tcp:0"}
    return tactemu.serve("ati_net_ft", ports, rate_hz=500, faults=faults, device_options=options, source=pushed)


def pynetft(served, *, bias=False, count=300):
    ports = port_of(served, "rdt"), port_of(served, "http")
    return run_driver("pynetft", "pynetft_read.py", "127.0.0.1", *ports, int(bias), count)


def truth_of(served):
    return [sample.counts[0] for sample in served.truth.samples]


@pytest.mark.judge("ati_net_ft", driver="pynetft", carrier="UDP", every_run=True)
def test_pynetft():
    with ati(counts_per_torque=2_000_000, records_per_second=250) as dev:
        got = pynetft(dev)
        page = http.client.HTTPConnection("127.0.0.1", port_of(dev, "http"), timeout=5)
        page.request("GET", "/netftapi2.xml?index=0")
        assert b"<comrdtrate>250</comrdtrate>" in page.getresponse().read()
        page.request("GET", "/other")
        assert page.getresponse().status == 404
        page.close()
    assert_consecutive(got["raw"], truth_of(dev), count=300)
    np.testing.assert_allclose(got["wrench"], np.array(got["raw"]) / np.repeat([1e6, 2e6], 3))
    assert got["sequences"] == list(range(got["sequences"][0], got["sequences"][0] + 300))
    steps = np.diff(got["samples"])
    assert steps.min() == 14 and not (steps % 14).any(), "7000 a second; a loop that was held up sends fewer records"
    assert got["status"] == [0]
    assert got["units"] == ["N", "N-m"] and got["counts"] == [1e6, 2e6] and got["product"] == "Net F/T"
    assert got["lost"] == got["duplicate"] == got["late"] == got["malformed"] == 0


@pytest.mark.judge("ati_net_ft", driver="pynetft", carrier="UDP")
def test_pynetft_zeroes_and_is_numbered_anew():
    with ati() as dev:
        got = pynetft(dev, bias=True)
    assert_consecutive(got["raw"], truth_of(dev), count=300)
    assert got["lost"] == 0 and dev.device().bias.any()


@pytest.mark.parametrize(
    ("fault", "counter"),
    [
        ("drop every 20", "lost"),
        ("duplicate every 20", "duplicate"),
        ("truncate every 20", "malformed"),
        ("reorder every 20 frames 3", "late"),
        ("late every 20 by 9ms", "late"),
    ],
)
def test_pynetft_counts_what_befell_the_datagrams(fault, counter):
    with ati(faults=[fault]) as dev:
        got = pynetft(dev)
    injected = dev.truth.injected[fault.split()[0]]
    least = injected // 2 if fault.startswith("late") else injected - 3  # a loop that is held up lets nobody overtake
    assert least <= got[counter] <= injected and injected >= 10, "those at the end it does not see"


@pytest.mark.judge("name", driver="NetFT", carrier="UDP")
@pytest.mark.parametrize("name", ["ati_net_ft", "onrobot_hex"])
def test_netft(name):
    number = os.getpid()
    host = f"127.74.{number >> 8 & 0xFF}.{number & 0xFF or 1}"  # the driver's port is fixed
    with tactemu.serve(name, f"udp:{host}:49152", rate_hz=500, source=pushed) as dev:
        got = run_driver("NetFT", "netft_read.py", host)
        dev.wait(0.1)
        assert not dev.device().left, "stopped"
    assert_consecutive(got["single"], truth_of(dev))
    assert_consecutive(got["streamed"], truth_of(dev))


def xela(faults=(), **options):
    options = {"models": ("uSPa46", "uSPa22"), "calibrated": True, **options}
    return tactemu.serve("xela_server", "ws:0", rate_hz=200, faults=faults, device_options=options, source=spread)


def spread(t_s):
    """A force on each of 28 taxels that names the time [N]."""
    phase = 20 * t_s + np.arange(28)
    return np.stack([np.sin(phase), np.cos(phase), -1 - np.sin(3 * phase)], -1)


def websocket_client(served, count):
    return run_driver("websocket", "websocket_client_read.py", served.port, count)


def counts_in(message):
    """Of all sensors, as XELA's node for ROS reads them: keys that are numbers, hexadecimal X,Y,Z."""
    positions = sorted((key for key in message if key.isdigit()), key=int)
    assert [message[key]["sensor"] for key in positions] == positions and message["sensors"] == len(positions)
    return np.concatenate([
        np.reshape([int(text, 16) for text in message[key]["data"].split(",")], (message[key]["taxels"], 3))
        for key in positions
    ])  # fmt: skip


@pytest.mark.judge("xela_server", driver="websocket-client", carrier="WebSocket", every_run=True)
def test_websocket_client():
    with xela() as dev:
        ((messages, end),) = websocket_client(dev, 300)
        truth = [sample.counts for sample in dev.truth.samples]
        ideal = {sample.counts.tobytes(): sample.measured for sample in dev.truth.samples}
    assert end == "enough" and messages[0] == {"message": "Welcome"}
    readings = [counts_in(message) for message in messages[1:]]
    assert_consecutive(readings, truth)
    numbers = [message["message"] for message in messages[1:]]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    for message, counts in zip(messages[1:], readings):
        newtons = np.reshape(message["1"]["calibrated"] + message["2"]["calibrated"], (28, 3))
        pushed_in = ideal[counts.astype(np.int64).tobytes()] * [1, 1, -1]
        np.testing.assert_allclose(newtons, pushed_in, atol=1e-4)


def test_websocket_client_under_faults():
    with xela(faults=["split every 10 by 3ms", "close every 100 code 1012"]) as dev:
        runs = websocket_client(dev, 350)
        injected = Counter(dev.truth.injected)
        truth = [sample.counts for sample in dev.truth.samples]
    ends = [end for _, end in runs]
    assert ends[:-1] == [1012] * injected["close"] and ends[-1] == "enough" and len(ends) >= 3
    assert all(messages[0] == {"message": "Welcome"} for messages, _ in runs), "it came again"
    assert injected["split"] >= 25
    assert_consecutive([counts_in(each) for messages, _ in runs for each in messages[1:]], truth)


@pytest.mark.parametrize(("fault", "end"), [("close every 50 code 1006", "lost"), ("halfopen for 60s", "silent")])
def test_websocket_client_whose_server_goes_without_a_word(fault, end):
    with xela() as dev:
        found = []
        reader = threading.Thread(target=lambda: found.append(websocket_client(dev, 100_000)))
        reader.start()
        dev.wait_for_driver()
        dev.wait(0.3)
        dev.inject_event(fault=fault)
        reader.join()
    assert found[0][0][1] == end
