"""XELA's server: greeting, messages, sensors by position."""

import json

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def said(device, pushes=0.0, t_ns=0):
    (message,) = sample(device, pushes, t_ns)
    return json.loads(message)


def test_a_greeting_for_whoever_comes_and_nothing_for_what_he_says():
    device = fp.create("xela_server")
    assert [json.loads(each) for each in device.lines(True, True, 0, "")] == [{"message": "Welcome"}]
    assert device.lines(False, False, 0, "") == () and send(device, b'{"message": 1}') == []
    assert device.counters["ignored"] == 1


def test_messages_are_counted_also_while_nobody_listens():
    device = fp.create("xela_server", models=("uSPa11", "uSPa21"))
    assert [said(device, t_ns=k)["message"] for k in range(3)] == [1, 2, 3]
    message = said(device, t_ns=1_500_000_000)
    assert (message["type"], message["time"], message["sensors"]) == ("routine", 1_700_000_001.5, 2)
    assert [key for key in message if key.isdigit()] == ["1", "2"] and "calibrated" not in message["1"]


def test_counts_are_four_digits_and_saturate():
    device = fp.create("xela_server", models=("uSPa11", "uSPa22"), calibrated=True)
    message = said(device, [100.0, 0.0, 0.0, 0.0, 1.5])
    assert message["1"]["data"] == "5DC0,5DC0,FFFF" and message["1"]["calibrated"] == [0, 0, 100]
    assert message["2"]["taxels"] == 4 and message["2"]["data"].split(",")[-1] == f"{21000 + 7500:04X}"
    assert message["2"]["calibrated"][-3:] == [0, 0, 1.5]


@pytest.mark.parametrize(("model", "taxels"), [("uSPa44", 16), ("uSPa46", 24), ("XR1944", 16), ("uSPa21", 2)])
def test_models(model, taxels):
    device = fp.create("xela_server", models=model)
    message = said(device)
    assert (message["1"]["model"], message["1"]["taxels"]) == (model, taxels)
    assert np.shape(device.counts) == (taxels, 3)
