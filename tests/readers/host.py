"""What every reader of this folder needs: a port, bytes in time, rules that are kept, one line of JSON.

The readers are written from descriptions of the wire, not from the device files, and import nothing of either package.
``python NAME.py PORT COUNT [option ...]`` prints ``{"readings": [[...], ...], "lost": 0}``, lost by the numbers of the
frames, or one sentence and exit status 1.
"""

import atexit
import contextlib
import itertools
import json
import sys
import time
from pathlib import Path

import serial


class Broken(Exception):
    """The wire said something that the description does not."""


def expect(kept, sentence):
    if not kept:
        raise Broken(sentence)


lost = 0


def follow(number, before, full):
    """``number`` comes after ``before``; a busy host may lose a few frames between, which are counted."""
    global lost
    missing = (number - before - 1) % full
    expect(missing <= 20, f"frame {number} after {before}")
    lost += missing


def run(read, pause=0.0):
    """Print COUNT readings of the generator ``read(PORT, *options)``, with a pause [s] where each is asked for."""
    port, count, *options = sys.argv[1:]
    taken = []
    try:
        with contextlib.closing(read(port, *options)) as readings:
            for reading in itertools.islice(readings, int(count)):
                taken.append(reading)
                time.sleep(pause)
    except Broken as rule:
        sys.exit(f"{Path(sys.argv[0]).name}: {rule}")
    print(json.dumps({"readings": taken, "lost": lost}))


class Line(serial.Serial):
    """A serial port, 8N1, that takes whatever has come at once: a tty keeps no more than 4095 bytes."""

    kept = b""

    def read(self, size=1):
        while len(self.kept) < size and (got := super().read(max(1, self.in_waiting))):
            self.kept += got
        data, self.kept = self.kept[:size], self.kept[size:]
        return data

    def reset_input_buffer(self):
        super().reset_input_buffer()
        self.kept = b""


def open_serial(port, baud, *, seconds=2.0):
    """What arrived before is dropped; reads give up after ``seconds``."""
    line = Line(port, baud, timeout=seconds)
    line.reset_input_buffer()
    return line


def exactly(line, count):
    data = line.read(count)
    expect(len(data) == count, f"{count} bytes expected within {line.timeout} s, got {len(data)}: {data.hex(' ')}")
    return data


def skip_to(line, marker, limit):
    """Read up to and with ``marker``; what came before it, at most ``limit`` bytes."""
    before = bytearray()
    while not before.endswith(marker):
        expect(len(before) < limit + len(marker), f"no {marker.hex(' ')} in {limit} bytes")
        begun = next(n for n in range(len(marker) - 1, -1, -1) if before.endswith(marker[:n]))
        before += exactly(line, len(marker) - begun)  # at least so many are missing
    return bytes(before[: -len(marker)])


def open_can(channel):
    """The bus ``channel`` of the interface that the environment variable CAN_INTERFACE names."""
    import can

    bus = can.Bus(channel=channel, fd=True)
    atexit.register(bus.shutdown)
    return bus


echoes = []
"""What was sent on a bus that returns it: multicast does, SocketCAN does not."""


def send(bus, arbitration_id, data, *, extended=False, fd=False):
    import can

    bus.send(can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=extended, is_fd=fd, check=True))
    if type(bus).__name__ == "UdpMulticastBus":
        echoes.append((arbitration_id, bytes(data)))


def frame(bus, wanted, seconds=1.0):
    """The next frame for which ``wanted`` is true; others are passed over, as a driver on a shared bus must."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        message = bus.recv(left)
        if message is not None and (echo := (message.arbitration_id, bytes(message.data))) in echoes:
            echoes.remove(echo)
        elif message is not None and wanted(message):
            expect(not message.is_error_frame, "an error frame")
            return message
    raise Broken(f"no frame that was waited for within {seconds} s")
