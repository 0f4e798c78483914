"""The line to a real sensor: it is read with times, and every byte in either direction is kept."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable
from pathlib import Path

from firmware_protocols import Connector, Serial, WireFrame
from firmware_protocols.frames import payload
from tactemu.base.errors import TransportError, reason_of
from tactemu.judge.proxy import RealBus, RealPort, RealSerial
from tactemu.transports.transport import LinesChanged, SettingChanged
from tactemu.truth.entries import Passage
from tactemu.truth.recorder import Recorder

NAME = "recorded"
"""The name of the device in the capture."""
MAX_KEPT_BYTES = 64 << 20
"""Largest number of bytes that a comparison keeps in memory; it then stops listening."""
MAX_DATAGRAM_BYTES = 65_535
"""Largest size of a datagram [bytes]."""
MAX_WAIT_S = 0.02
"""Longest wait for data before the caller is asked whether to go on [s]."""
POLL_S = 0.0005
"""Period at which a port without a file descriptor is read [s]."""
_LATENCY_TIMERS = Path("/sys/bus/usb-serial/devices")
"""Folder in which Linux shows the buffering of USB bridges."""


class RealUdp:
    """A sensor that answers datagrams, ``udp:HOST:PORT``."""

    def __init__(self, name: str):
        host, _, port = name.removeprefix("udp:").strip("/").rpartition(":")
        try:
            self.port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.port.connect((host, int(port)))
            self.port.setblocking(False)
        except (OSError, ValueError) as error:
            raise TransportError(f"cannot reach {name}: {reason_of(error)}; expected udp:HOST:PORT") from None

    def filenos(self) -> list[int]:
        """Return the socket's file descriptor."""
        return [self.port.fileno()]

    def read(self) -> list[WireFrame]:
        """Return the datagrams that have arrived."""
        found: list[WireFrame] = []
        with contextlib.suppress(BlockingIOError):
            while True:
                try:
                    found.append(self.port.recv(MAX_DATAGRAM_BYTES))
                except ConnectionRefusedError as error:
                    raise TransportError(f"no program receives datagrams there: {error}") from None
        return found

    def write(self, data: WireFrame) -> None:
        """Send one datagram."""
        self.port.send(payload(data))

    def follow(self, event: SettingChanged | LinesChanged) -> None:
        """Do nothing: a socket has no such settings."""

    def close(self) -> None:
        """Close the socket."""
        self.port.close()


def open_port(source: str, connector: Connector, baud: int | None) -> RealPort:
    """Open the port of a real sensor with the settings of the model.

    Raises:
        TransportError: it cannot be opened.
    """
    if source.startswith("can:"):
        return RealBus(source)
    if source.startswith("udp:"):
        return RealUdp(source)
    if source.startswith("tcp:"):
        source = f"socket://{source.removeprefix('tcp:').strip('/')}"
    of_model = connector if isinstance(connector, Serial) else None
    opened = RealSerial(source, baud or (of_model.baud if of_model else 115_200))
    if of_model is not None and "://" not in source:
        with contextlib.suppress(OSError, ValueError):  # a port that does not support it, such as a pty
            opened.port.parity = of_model.parity
            opened.port.stopbits = of_model.stopbits
    return opened


def buffering_s(source: str) -> float:
    """Return the time for which a USB bridge keeps bytes back before it passes them on [s]; 0 if unknown."""
    try:
        return int((_LATENCY_TIMERS / Path(source).name / "latency_timer").read_text()) * 1e-3
    except (OSError, ValueError):
        return 0.0


class Link:
    """A line to a sensor whose traffic is kept, and recorded in a file.

    Args:
        port: the open port.
        recorder: the file of the capture.
        is_stopped: returns True when the user wants to end.
    """

    def __init__(self, port: RealPort, recorder: Recorder | None, is_stopped: Callable[[], bool] = bool):
        self.port, self.is_stopped = port, is_stopped
        self._recorder = recorder
        self._start_ns = time.monotonic_ns()
        self.entries: list[Passage] = []
        self.kept_bytes = 0
        if recorder is not None:
            recorder.start(self._start_ns)

    @property
    def now_ns(self) -> int:
        """The time since the link was made [ns]."""
        return time.monotonic_ns() - self._start_ns

    @property
    def is_over(self) -> bool:
        """True if the user has ended it, or memory is full."""
        return self.is_stopped() or self.kept_bytes > MAX_KEPT_BYTES

    def send(self, frame: WireFrame) -> None:
        """Send a frame; its time is that before the call, so that no answer seems early."""
        self._keep(Passage(self.now_ns, NAME, "rx", frame))
        self.port.write(frame)

    def receive(self, until_ns: int, enough: Callable[[], bool] = bool) -> None:
        """Read until a time, or until ``enough()`` returns True after some data."""
        while not self.is_over and (left_s := (until_ns - self.now_ns) * 1e-9) > 0:
            if filenos := self.port.filenos():
                select.select(filenos, [], [], min(left_s, MAX_WAIT_S))
            else:
                time.sleep(min(left_s, POLL_S))
            data = self.port.read()
            now_ns = self.now_ns
            for each in data:
                self._keep(Passage(now_ns, NAME, "tx", each))
            if data and enough():
                return

    def _keep(self, entry: Passage) -> None:
        self.entries.append(entry)
        self.kept_bytes += len(payload(entry.frame)) + 64
        if self._recorder is not None:
            self._recorder.add(entry)
