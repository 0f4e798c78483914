"""GHand 5: what registers show of a push, limits, what is refused."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def registers(device, request: str) -> bytes:
    (answer,) = send(device, request)
    assert answer[2] == len(answer) - 5
    return answer[3:-2]


def test_axes_of_taxels_and_resultants():
    device = fp.create("ghand5")
    force = np.zeros((162, 3))
    force[38] = (0.5, -0.3, -2.0)
    force[39] = (20.0, -20.0, -40.0)
    sample(device, force=force)
    index = np.frombuffer(registers(device, "31 04 10 C9 00 2F 60 D8"), np.uint8)
    assert index[:6].tolist() == [5, 253, 20, 127, 128, 255] and not index[6:].any() and len(index) == 94
    whole = registers(device, "31 04 10 80 00 10 F1 1E")
    assert whole.hex() == "1f00" + "0000" * 3 + "7f00" + "8000" + "ff00" + "0000" * 9
    assert device.feel(fp.Reading({"force": force}), 0)[38].tolist() == [5, -3, 20]


def test_a_pull_shows_no_push():
    device = fp.create("ghand5")
    sample(device, -5.0)
    assert not any(registers(device, "31 04 10 90 00 39 31 05"))


@pytest.mark.parametrize(
    ("request_", "answer"),
    [("31 03 10 80 00 10 44 DE", "31 83 01 80 FF"), ("31 04 11 85 00 01 20 EF", "31 84 02 C2 CE")],
    ids=["function 3", "behind the last register"],
)
def test_what_is_refused(request_, answer):
    device = fp.create("ghand5")
    sample(device)
    assert send(device, request_) == [bytes.fromhex(answer)]


def test_a_left_hand_is_another_unit():
    device = fp.create("ghand5", side="left")
    sample(device)
    assert send(device, "31 04 10 80 00 10 F1 1E") == [] and device.counters["other_unit"] == 1
