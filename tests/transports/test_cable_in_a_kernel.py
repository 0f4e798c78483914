"""``serial:`` on USB adapters of Debian's own kernel, a null-modem cable away from the driver: ``-m kernel``."""

import pytest

from tests.transports.kernel_guest import said_by
from tests.transports.null_modem import NullModem

pytestmark = [pytest.mark.kernel, pytest.mark.timeout(1000)]
READINGS = 40
NODES = {"/dev/ttyUSB0": "FT232R", "/dev/ttyUSB2": "CP2102"}


@pytest.fixture(scope="module")
def told():
    """What the guest's program says, by its words; the adapter is pulled when it asks for it."""
    said = {}
    with NullModem() as cable, NullModem(cable.number, "cp210x"):
        module, arguments = "tests.transports.cable_guest", (cable.number, READINGS)
        for each in said_by(module, *arguments, modules="vhci-hcd ftdi_sio cp210x", seconds=900):
            said[each.pop("what")] = each
            if "pull" in said and "pulled" not in said:
                cable.pull(0, 1.0)
    return said


@pytest.mark.parametrize("node", NODES, ids=NODES.values())
def test_every_reading_of_anyskins_driver_is_a_sample(told, node):
    readings = told[f"readings {node}"]
    assert readings["equal"] == readings["count"] == READINGS
    assert not readings["counters"].get("dropped_readings")


@pytest.mark.parametrize("node", NODES, ids=NODES.values())
def test_all_bytes_pass_both_ways_at_every_speed(told, node):
    assert told[f"both ways {node}"]["equal"] == {"9600": True, "250000": True, "1000000": True}


def test_modem_lines_cross_over(told):
    lines = told["lines"]
    assert not lines["before"], "DSR is down until a driver opens the other end"
    assert lines["opened"] and lines["rts_dropped"] and lines["closed"]
    assert lines["theirs"] == [True, True, True] and lines["dropped_with_us"]


def test_breaks_framing_and_parity_errors_are_counted(told):
    errors = told["errors"]
    assert errors["break"]["breaks"] == 1 and errors["speed"]["framing"] >= 1 and errors["parity"]["parity"] >= 1


def test_a_speed_that_the_chip_does_not_have_is_refused_with_both_numbers(told):
    assert "makes 9600 bit/s of 7000000" in told["speeds"]["refused"]


def test_frames_never_overfill_the_line(told):
    """An FT232R makes 115385 of 115200: 0.2 % more is its own."""
    fills, counters = told["fills"], told["fills"]["counters"]
    assert counters["sent"] + counters.get("dropped_unread", 0) == 100, "a busy machine's cable is slower than its line"
    assert fills["size"] == counters["sent_bytes"] and fills["filled"] <= 1.003, fills
    print(f"filled to {fills['filled']:.2%}")


def test_an_adapter_that_is_pulled_out_is_taken_again(told):
    assert told["pulled"] == {"gone": True, "back": True, "is_read": True}
