"""The rig itself: a frame goes whole, however busy the kernel is."""

import os
import threading

from tests.drivers.rig import _Pty


def test_a_frame_that_the_kernel_takes_in_parts_goes_whole():
    link, frame, got = _Pty(), bytes(range(256)) * 200, bytearray()

    def read():
        while len(got) < len(frame):
            got.extend(os.read(link.slave, 4096))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    link.write(frame)
    reader.join(20)
    link.close()
    assert bytes(got) == frame
