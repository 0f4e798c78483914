"""``serial:`` on an FTDI null-modem cable in Debian's kernel for long: ``-m nightly``.

20 minutes in real time, in which no byte is lost that nobody counts; then 200 times an adapter is pulled out.
``TACTEMU_SOAK=0.1`` runs a tenth.
"""

import os

import pytest

from tests.transports.kernel_guest import said_by
from tests.transports.null_modem import NullModem

SHARE = float(os.environ.get("TACTEMU_SOAK", "1"))
SECONDS, PULLS, PULLED_S = SHARE * 1200, round(SHARE * 200), 0.3
pytestmark = [pytest.mark.nightly, pytest.mark.timeout(2 * 3600)]


def test_no_byte_is_lost_that_nobody_counts_and_every_pulled_adapter_comes_back():
    said, lost = {}, 0
    with NullModem() as cable:
        arguments = (cable.number, SECONDS, PULLS)
        limit = round(SECONDS + 15 * PULLS + 300)
        for each in said_by("tests.transports.cable_guest", *arguments, modules="vhci-hcd ftdi_sio", seconds=limit):
            what = each.pop("what")
            said[what] = each
            print(what, each)
            if what == "pull":
                cable.pull(each["end"], PULLED_S)
            elif what == "soak":
                lost = sum(end.counts["lost"] for end in cable.ends)
    soak = said["soak"]
    assert soak["sent"] == soak["counters"]["sent_bytes"] > 0
    assert soak["received"] + soak["overrun"] + lost >= soak["sent"], soak
    assert soak["equal"] or soak["overrun"] or lost, "bytes have changed"
    assert said["pulls"] == {"count": PULLS, "passed": PULLS}
