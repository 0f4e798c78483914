"""A CAN frame that is meant for a device and that its controller does not take is counted; one for another is not."""

import time

import can
import pytest

import tactemu

CASES = [
    # device, options, identifiers that are counted, and one that is not its own
    ("xela_uskin", {}, (0x211, 0x271), 0x212),
    ("barrett_bh8", {}, (0x02B, 0x3EE), 0x01F),
    ("dexrobot_dexhand", {}, (0x201, 0x586), 0x20F),
]


@pytest.mark.parametrize(("device", "options", "own", "foreign"), CASES, ids=lambda value: str(value)[:16])
def test_what_is_meant_for_a_device_and_passes_by_is_counted(device, options, own, foreign):
    channel = f"addressed-{device}"
    with (
        tactemu.serve(device, port=f"can:virtual:{channel}", device_options=options) as dev,
        can.Bus(interface="virtual", channel=channel) as driver,
    ):
        counters = dev.device().counters
        for ident in (foreign, *own):
            driver.send(can.Message(arbitration_id=ident, data=[7, 0], is_extended_id=False))
        end = time.monotonic() + 10
        while counters["ignored"] < len(own) and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(0.05)
        assert counters["ignored"] == len(own)
        wire = dev.emulator.channels[0].wire
        assert wire.counters["received"] == len(own), "they are in the truth log; the other is none of its business"
