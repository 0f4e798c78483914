"""``tactemu check-host --port``: the hardware behind a port, the rates that it holds, and remedies."""

from __future__ import annotations

import fcntl
import os
import select
import termios
import time
from collections.abc import Iterator
from itertools import accumulate

import numpy as np

from firmware_protocols import Can, Serial
from tactemu.base.errors import TactemuError, TransportError, no_such
from tactemu.cli.finding import Finding
from tactemu.transports import can_link, create, uart_settings
from tactemu.transports.adapter import net_adapter, tty_adapter
from tactemu.transports.serial_port import MAX_BAUD_DEVIATION, SerialPortTransport
from tactemu.transports.socketcan import SocketCanTransport, is_down
from tactemu.transports.transport import Received, SerialSetting

SPEEDS = (9_600, 19_200, 57_600, 115_200, 230_400, 250_000, 460_800, 921_600, 1_000_000, 2_000_000, 3_000_000)
"""The speeds of sensors that are tried [bit/s]."""
USUAL_SPEED = 115_200
BITS_PER_BYTE = 10
ROUNDS, FRAMES, FRAME_BYTES, FRAME_S, STREAM_S = 200, 100, 64, 0.01, 1.0
"""Rounds of one byte; frames, their size and their period for the jitter; time of a stream without a pause [s]."""
WAIT_S = 1.0
"""The longest wait for bytes that should come back."""
SLOW_MS = 5.0
"""The median time of a round trip, without that of the line, from which an adapter gathers bytes."""


def check_port(address: str, *, loopback: bool = False, baud: int = USUAL_SPEED) -> Iterator[Finding]:
    """Yield what is found of a serial port or a CAN interface; ``loopback``: its TX is joined to its RX, at a speed.

    Raises:
        TransportError: it cannot be opened.
        TactemuError: it is another port.
    """
    port = create(address)
    if isinstance(port, SerialPortTransport):
        yield from _serial_port(address, port.address)
        if loopback:
            yield from _loop(address, baud)
    elif isinstance(port, SocketCanTransport):
        if loopback:
            raise TactemuError("--loopback is for serial ports; a CAN adapter receives nothing of what it sends")
        yield from _can_interface(port.channel)
    else:
        raise TactemuError(f"--port {address}: expected serial:NAME or can:socketcan:NAME, which have hardware behind")


# -- a serial port -----------------------------------------------------------------------------------------------------


def _serial_port(address: str, path: str) -> Iterator[Finding]:
    node = os.path.basename(os.path.realpath(path))
    with _opened(address, USUAL_SPEED) as port:  # says in words what hinders, and keeps other programs off
        names = [f"/dev/serial/by-id/{name}" for name in _ids_of(node)]
        what = str(tty_adapter(node)) or "no hardware that Linux knows of"
        yield Finding("adapter", True, f"{os.path.realpath(path)}: {', '.join([what, *names])}")
        timer = uart_settings.latency_timer_ms(node)
        fd = port.filenos()[-1]
        low = uart_settings.set_low_latency(fd)
        yield _latency(node, low, timer)
        counters = uart_settings.errors(fd) is not None
        lost = "framing and parity errors, breaks and overruns"
        yield Finding(
            "errors", counters, f"its driver {'counts' if counters else 'does not count'} {lost}",
            "" if counters else "damaged bytes look like those of the sensor; compare checksums",
        )  # fmt: skip
    made = _speeds_of(path)
    yield Finding("speeds", bool(made), _speeds_in_words(made))


def _opened(address: str, baud: int) -> SerialPortTransport:
    port = create(address)
    assert isinstance(port, SerialPortTransport)
    port.set_connector(Serial(baud=baud))
    return port


def _ids_of(node: str) -> list[str]:
    """Return the names of a node in ``/dev/serial/by-id``."""
    folder = "/dev/serial/by-id"
    names = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
    return [name for name in names if os.path.realpath(os.path.join(folder, name)) == f"/dev/{node}"]


def _latency(node: str, low: bool, timer: int | None) -> Finding:
    says = "low latency is on" if low else "its driver offers no low latency"
    if timer is None:
        return Finding("latency", True, f"{says}; it has no timer that gathers bytes")
    helps = "" if timer == 1 else f"echo 1 | sudo tee {_timer_of(node)}"
    return Finding("latency", timer == 1, f"{says}; it gathers bytes for {timer} ms", helps)


def _timer_of(node: str) -> str:
    return f"/sys/bus/usb-serial/devices/{node}/latency_timer"


def _speeds_of(path: str) -> dict[int, int]:
    """Return the speeds that a port makes of the usual ones, as its driver reports them, if they are close enough."""
    made: dict[int, int] = {}
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for baud in (*SPEEDS, USUAL_SPEED):  # the last is left set
            try:
                speed = uart_settings.apply(fd, SerialSetting(baud, 8, "N", 1), hardware_flow=False).baud
            except (OSError, termios.error):
                continue
            if abs(speed / baud - 1) <= MAX_BAUD_DEVIATION:
                made[baud] = speed
    finally:
        os.close(fd)
    return made


def _speeds_in_words(made: dict[int, int]) -> str:
    other = [f"{speed} of {baud}" for baud, speed in made.items() if speed != baud]
    without = [str(baud) for baud in SPEEDS if baud not in made]
    words = [f"{len(made)} of the usual {len(SPEEDS)}, up to {max(made, default=0)} bit/s, as its driver says"]
    words += [f"not {', '.join(without)}"] if without else []
    words += [f"makes {', '.join(other)}"] if other else []
    return "; ".join(words)


# -- a loop-back plug --------------------------------------------------------------------------------------------------


class _Loop:
    """A port that receives what it sends."""

    def __init__(self, port: SerialPortTransport):
        self._port = port
        self.received = bytearray()
        self.arrivals: list[tuple[int, float]] = []
        """The number of bytes that had been received, and when [s]."""

    def take(self, until: float) -> None:
        """Take what has come, or wait for it until a time."""
        select.select(self._port.filenos(), [], [], max(0.0, until - time.monotonic()))
        for event in self._port.poll():
            if isinstance(event, Received):
                assert isinstance(event.data, bytes)
                self.received += event.data
                self.arrivals.append((len(self.received), time.monotonic()))

    def wait_for(self, count: int) -> bool:
        """Return True when so many bytes have been received, or False if they do not come."""
        end = time.monotonic() + WAIT_S
        while len(self.received) < count and time.monotonic() < end:
            self.take(end)
        return len(self.received) >= count

    def send(self, data: bytes) -> None:
        """Write data; wait where the port has no room for them."""
        while not self._port.write(data):
            self.take(time.monotonic() + 0.001)


def _loop(address: str, baud: int) -> Iterator[Finding]:
    with _opened(address, baud) as port:
        loop = _Loop(port)
        loop.take(time.monotonic())
        loop.send(b"\x55")
        if not loop.wait_for(1):
            helps = "join TX to RX, and nothing else"
            yield Finding("loop", False, f"nothing comes back at {baud} bit/s", helps)
            return
        yield _round_trip(loop, os.path.basename(os.path.realpath(port.address)), baud)
        yield _stream(_Loop(port), baud)
        yield _jitter(_Loop(port), baud)


def _round_trip(loop: _Loop, node: str, baud: int) -> Finding:
    times = []
    for k in range(ROUNDS):
        began, count = time.monotonic(), len(loop.received)
        loop.send(bytes([k]))
        if not loop.wait_for(count + 1):
            return Finding("echo", False, f"byte {k + 1} of {ROUNDS} did not come back at {baud} bit/s")
        times.append(time.monotonic() - began)
    p50, p99 = map(float, np.percentile(times, (50, 99)) * 1e3)
    line = BITS_PER_BYTE / baud * 1e3
    values = {"p50_ms": p50, "p99_ms": p99}
    says = (
        f"one byte at {baud} bit/s comes back after {p50:.2f} ms (median), {p99:.2f} ms (99 of 100); "
        f"the line takes {line:.2f} ms of it"
    )
    if p50 - line <= SLOW_MS:
        return Finding("echo", True, says, values=values)
    timer = uart_settings.latency_timer_ms(node) is not None
    helps = f"echo 1 | sudo tee {_timer_of(node)}" if timer else "stop what keeps the machine busy"
    return Finding("echo", False, says, helps, values)


def _stream(loop: _Loop, baud: int) -> Finding:
    """Send frames without a pause, and count what comes back."""
    random, sent = np.random.default_rng(0), bytearray()
    began = time.monotonic()
    while time.monotonic() < began + STREAM_S:
        frame = random.bytes(FRAME_BYTES)
        loop.send(frame)
        sent += frame
    loop.wait_for(len(sent))
    took = (loop.arrivals[-1][1] if loop.arrivals else time.monotonic()) - began
    rate, is_equal = len(loop.received) / took, loop.received == sent
    share = rate * BITS_PER_BYTE / baud
    what = "all equal" if is_equal else f"{len(loop.received)} of {len(sent)} came back, or others"
    says = f"{rate / 1e3:.1f} kB/s at {baud} bit/s, {share:.1%} of the line, {what}"
    helps = "" if is_equal else "another adapter, a shorter wire, or a lower speed"
    return Finding("stream", is_equal, says, helps, {"kB_per_s": rate / 1e3, "share_of_line": share})


def _jitter(loop: _Loop, baud: int) -> Finding:
    """Send frames at a fixed rate, and compare the times from each to its last byte."""
    sent, ends = [], []
    start = time.monotonic() + FRAME_S
    for k in range(FRAMES):
        while (now := time.monotonic()) < start + k * FRAME_S:
            loop.take(start + k * FRAME_S)
        loop.send(bytes(FRAME_BYTES))
        sent.append(now)
    loop.wait_for(FRAMES * FRAME_BYTES)
    for size in accumulate([FRAME_BYTES] * FRAMES):
        ends.append(next((at for count, at in loop.arrivals if count >= size), float("nan")))
    took = np.array(ends) - sent
    if np.isnan(took).any():
        return Finding("jitter", False, f"frames are missing at {baud} bit/s")
    low, middle, high = map(float, np.percentile(took, (1, 50, 99)) * 1e3)
    says = (
        f"{FRAME_BYTES} bytes, {1 / FRAME_S:.0f} times a second at {baud} bit/s: {middle:.2f} ms (median), "
        f"{low:.2f} to {high:.2f} ms (98 of 100)"
    )
    return Finding("jitter", True, says, values={"p1_ms": low, "p50_ms": middle, "p99_ms": high})


# -- a CAN interface ---------------------------------------------------------------------------------------------------


def _can_interface(name: str) -> Iterator[Finding]:
    link = can_link.can_link(name)
    if link is None or link.kind not in can_link.KINDS:
        raise TransportError(no_such("CAN interface", name, can_link.names()))
    what = str(net_adapter(name)) or f"an interface without hardware ({link.kind})"
    yield Finding("adapter", link.is_real, f"{name}: {what}")
    if link.is_real:
        helps = "" if link.bitrate and not is_down(name) else can_link.set_up(name, Can())
        yield Finding("bus", not helps, can_link.describe(link), helps)
    advice = can_link.advice(link, name) if link.is_real else []
    queue = f"its transmit queue holds {link.queue_length} frames"
    yield Finding("queue", not advice, queue, "; ".join(advice))
    if link.counts:
        told = ", ".join(f"{key} {count}" for key, count in link.counts.items())
        bad = any(link.counts.get(key) for key in ("bus_error", "error_passive", "bus_off"))
        yield Finding("errors", not bad, f"since it was plugged in: {told}")
