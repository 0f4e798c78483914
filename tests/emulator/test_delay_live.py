"""A device's delay, measured where it matters: at the driver's end of a real port, on the real clock."""

import os
import select
import struct
import threading
import tty

import numpy as np

from firmware_protocols import Serial
from tactemu import transports
from tactemu.base.clock import RealClock
from tactemu.emulator.emulator import Channel, Emulator
from tactemu.emulator.sampling import SampleClock
from tactemu.wire.wire import Wire
from tests.emulator.test_loop import Counter8, Ramp

DELAY_NS, RATE_HZ, FRAMES = 3_700_000, 1000, 500


class Numbered(Counter8):
    """Streams its sample number in four bytes, over USB: nothing else delays it."""

    ports, rate_hz = (Serial(baud=115200, usb=True),), RATE_HZ

    def stream(self, t_ns, name):
        self.n += 1
        return [struct.pack("<I", self.n)]


def test_frames_arrive_after_the_delay_and_never_before():
    transport, device = transports.create("pty:"), Numbered()
    wire = Wire(transport, device.ports[0])
    sampling = SampleClock(period_ns=device.period_ns, delay_ns=DELAY_NS)
    channel = Channel("a", device, Ramp(), {"": wire}, sampling)
    emulator = Emulator(None, [channel], clock=RealClock())
    with emulator:
        thread = threading.Thread(target=emulator.run, args=(20.0,))
        fd = os.open(transport.address, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(fd)
        thread.start()
        arrivals, rest = {}, b""
        while len(arrivals) < FRAMES and select.select([fd], [], [], 5.0)[0]:
            rest += os.read(fd, 4096)
            now = emulator.clock.now_ns()
            while len(rest) >= 4:
                arrivals[struct.unpack("<I", rest[:4])[0]] = now
                rest = rest[4:]
        emulator.stop()
        thread.join(5.0)
        os.close(fd)
    taken = [sample.t_ns for sample in emulator.truth.samples]
    late = np.array([now - taken[n - 1] for n, now in arrivals.items()])
    assert len(late) >= FRAMES
    assert DELAY_NS <= late.min() < 2 * DELAY_NS, "the quickest: a busy machine delays most of them more"
