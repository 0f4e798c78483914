"""Emulators on two multicast groups of one machine are on two buses."""

import time

import can
import pytest

from firmware_protocols import CanFrame
from tactemu.transports import create
from tactemu.transports.transport import Received

pytestmark = pytest.mark.realtime


def test_a_node_hears_its_own_group_only():
    with create("can:udp_multicast:239.74.77.1") as one, create("can:udp_multicast:239.74.77.2") as other:
        with can.Bus(interface="udp_multicast", channel="239.74.77.1") as driver:
            driver.send(can.Message(arbitration_id=0x28, data=[0xC2], is_extended_id=False))
        end = time.monotonic() + 5
        while not (heard := one.poll()) and time.monotonic() < end:
            time.sleep(0.01)
        assert heard == [Received(CanFrame(arbitration_id=0x28, data=b"\xc2"))]
        assert other.poll() == []
