"""The guest's part of ``test_cable_in_a_kernel.py``: ``cable_guest PORT READINGS``, or ``PORT SECONDS PULLS`` for long.

``serial:`` has one end of a null-modem cable between two FT232R, drivers have the other. Prints a JSON object a line.
"""

import json
import os
import subprocess
import sys
import time
import zlib
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import serial

from firmware_protocols import Serial
from tactemu import transports
from tactemu.base.errors import TransportError
from tactemu.transports.transport import Closed, Counted, LinesChanged, Opened, Received
from tactemu.transports.uart_settings import errors as errors_of
from tactemu.wire.wire import Wire
from tests.transports.played import Played

ROOT = Path(__file__).parents[2]
NEAR, FAR = "/dev/ttyUSB0", "/dev/ttyUSB1"
NEAR_2, FAR_2 = "/dev/ttyUSB2", "/dev/ttyUSB3"
"""The ends of a cable between a CP2102 and an FT232R."""


def wait(condition, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.02)
    return bool(met)


def tell(what, **said):
    print(json.dumps({"what": what, **said}), flush=True)


def opened(options="", near=NEAR, **line):
    port = transports.create(f"serial:{near}{options}")
    port.set_connector(Serial(**({"baud": 115_200} | line)))
    port.open()
    return port


def events_until(port, condition, seconds=10.0):
    """Return all events up to those that meet a condition, or until a time."""
    seen = []
    wait(lambda: seen.extend(port.poll()) or condition(seen), seconds)
    return seen


def counted(seen):
    counts = Counter()
    for event in seen:
        if isinstance(event, Counted):
            counts[event.counter] += event.count
    return counts


def readings(count, near=NEAR, far=FAR):
    """Every reading of a sensor's own driver."""
    with Played("anyskin", f"serial:{near}") as played:
        read = [sys.executable, ROOT / "tests/drivers/scripts/anyskin_read.py", "anyskin", far, str(count)]
        done = subprocess.run(read, capture_output=True, text=True, timeout=300, check=True)
    got = json.loads(done.stdout.splitlines()[-1])["readings"]
    samples = played.samples()
    equal = sum(np.array(each).tobytes() in samples for each in got)
    tell(f"readings {near}", count=len(got), equal=equal, counters=dict(played.wire.counters))


def both_ways(near=NEAR, far=FAR):
    """All bytes, at speeds that a 16550A does not have, too."""
    data, equal = bytes(range(256)) + b"\xff\xff\x00", {}
    for baud in (9_600, 250_000, 1_000_000):
        with opened(near=near, baud=baud) as port, serial.Serial(far, baud, timeout=5) as driver:
            port.poll()
            is_sent = port.write(data) and driver.read(len(data)) == data
            driver.write(data)
            seen = events_until(port, lambda seen: len(received(seen)) >= len(data))
            equal[baud] = is_sent and received(seen) == data
    tell(f"both ways {near}", equal=equal)


def received(seen):
    return b"".join(event.data for event in seen if isinstance(event, Received))


def lines():
    """Modem lines both ways: the driver's are ours crossed over."""
    port = opened("?reader=dsr")
    before = port.has_reader
    with serial.Serial(FAR, 115_200, timeout=1) as driver:
        seen = events_until(port, lambda seen: Opened() in seen)
        theirs = [driver.cts, driver.dsr, driver.cd]
        driver.rts = False
        seen += events_until(port, lambda seen: LinesChanged(True, False) in seen)
        driver.dtr = False
        ours = events_until(port, lambda seen: Closed() in seen)
        driver.dtr = True
        events_until(port, lambda seen: Opened() in seen)
        port.close()
        after = wait(lambda: not (driver.cts or driver.dsr), 5)
    tell(
        "lines", before=before, opened=Opened() in seen, rts_dropped=LinesChanged(True, False) in seen,
        closed=Closed() in ours, theirs=theirs, dropped_with_us=after,
    )  # fmt: skip


def errors():
    """Breaks, framing errors and parity errors."""
    said = {}
    with opened() as port, serial.Serial(FAR, 115_200, timeout=1) as driver:
        port.poll()
        driver.send_break(0.05)
        said["break"] = counted(events_until(port, lambda seen: counted(seen)["breaks"]))
        driver.baudrate = 57_600
        driver.write(b"another speed")
        said["speed"] = counted(events_until(port, lambda seen: counted(seen)["framing"]))
    with opened(parity="E") as port, serial.Serial(FAR, 115_200, parity="O", timeout=1) as driver:
        port.poll()
        driver.write(b"odd")
        said["parity"] = counted(events_until(port, lambda seen: counted(seen)["parity"]))
    tell("errors", **said)


def fills():
    """Frames that wait for one another, on a line that takes their time itself."""
    frame, frames, baud = bytes(100), 100, 115_200
    wire = Wire(transports.create(f"serial:{NEAR}"), Serial(baud=baud), backlog_ns=10**11)
    with serial.Serial(FAR, baud, timeout=0) as driver:
        wire.open()
        wire.receive(0)
        for _ in range(frames):
            wire.send([frame], 0, "skin")
        arrivals, size, start = [], 0, time.monotonic_ns()
        while size < (frames - wire.counters["dropped_unread"]) * len(frame):
            now = time.monotonic_ns() - start
            if now > 6 * 10**10:
                break
            wire.receive(now)
            wire.flush(now)
            if data := driver.read(4096):
                size += len(data)
                arrivals.append((size, time.monotonic_ns() - start))
            time.sleep(0.0005)
        wire.close()
    byte_ns = 10 * 10**9 / baud
    filled = size * byte_ns / arrivals[-1][1]
    tell("fills", size=size, filled=filled, counters=dict(wire.counters))


def speeds():
    try:
        opened(baud=7_000_000).close()
    except TransportError as error:
        tell("speeds", refused=str(error))


def stays_open():
    """An adapter that is pulled out is taken again, and the run goes on: the host pulls it when it reads this."""
    with opened() as port:
        port.poll()
        tell("pull")
        gone = events_until(port, lambda seen: any("has gone" in str(event) for event in seen), 30)
        back = events_until(port, lambda seen: any("is back" in str(event) for event in seen), 60)
        with serial.Serial(FAR, 115_200, timeout=5) as driver:
            wait(lambda: port.poll() or True)
            is_read = port.write(b"again") and driver.read(5) == b"again"
        tell("pulled", gone=Closed() in gone, back=Opened() in back, is_read=is_read)


READER = """
import os, signal, sys, termios, tty, zlib
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(fd)
mode = termios.tcgetattr(fd)
mode[4] = mode[5] = termios.B115200
mode[2] |= termios.CLOCAL
mode[6][termios.VMIN], mode[6][termios.VTIME] = 0, 100
termios.tcsetattr(fd, termios.TCSANOW, mode)
print("ready", flush=True)
size = check = 0
while not (data := os.read(fd, 65536)):
    pass
while data:
    size, check = size + len(data), zlib.crc32(data, check)
    data = os.read(fd, 65536)
print(size, check)
"""
"""A program that reads until nothing has come for ten seconds."""


def soak(seconds):
    """A sensor that streams for long; the bytes at the other end are those that were sent."""
    reader = subprocess.Popen([sys.executable, "-c", READER, FAR], stdout=subprocess.PIPE, text=True)
    reader.stdout.readline()
    with Played("anyskin", f"serial:{NEAR}") as played:
        time.sleep(seconds)
    size, check = map(int, reader.communicate(timeout=60)[0].split())
    sent = b"".join(frame for _, _, frame in played.truth.frames)
    with serial.Serial(FAR) as driver:
        overrun = errors_of(driver.fileno())
    tell(
        "soak", sent=len(sent), received=size, equal=zlib.crc32(sent) == check, counters=dict(played.wire.counters),
        samples=len(played.truth.samples), overrun=overrun.buffer_overrun + overrun.uart_overrun,
    )  # fmt: skip


def pulls(count):
    """Either adapter is pulled out many times: ours is taken again, the driver's is opened again, and bytes pass."""
    passed = 0
    with opened() as port:
        port.poll()
        for k in range(count):
            driver = serial.Serial(FAR, 115_200, timeout=5)
            tell("pull", end=k % 2)
            if k % 2:
                is_seen = wait(lambda driver=driver: is_lost(driver))
                driver.close()
                is_seen &= wait(lambda: not os.path.exists(FAR)) and wait(lambda: os.path.exists(FAR))
                driver = serial.Serial(FAR, 115_200, timeout=5)
            else:
                seen = events_until(port, lambda seen: "is back" in str(seen), 60)
                is_seen = "has gone" in str(seen) and "is back" in str(seen)
            message = b"%06d" % k
            port.poll()
            is_read = port.write(message) and driver.read(len(message)) == message
            driver.close()
            passed += is_seen and is_read
            if not (is_seen and is_read):
                tell(f"pull {k}", is_seen=is_seen, is_read=is_read)
    tell("pulls", count=count, passed=passed)


def is_lost(driver):
    try:
        return bool(driver.read(1)) and False
    except (serial.SerialException, OSError):
        return True


def main(number, *words):
    command = [sys.executable, "-m", "tactemu", "attach", f"{os.environ['KERNEL_GUEST_HOST']}:{number}"]
    keeper = subprocess.Popen(command, cwd=ROOT)
    try:
        for node in (NEAR, FAR):
            assert wait(lambda node=node: os.path.exists(node), 240), f"no {node}"
        if len(words) > 1:
            soak(float(words[0]))
            pulls(int(words[1]))
        else:
            for node in (NEAR_2, FAR_2):
                assert wait(lambda node=node: os.path.exists(node), 60), f"no {node}"
            count = int(words[0])
            for part in (both_ways, lines, errors, speeds, fills, partial(readings, count), stays_open):
                part()
            both_ways(NEAR_2, FAR_2)
            readings(count, NEAR_2, FAR_2)
    finally:
        keeper.terminate()
        keeper.wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
