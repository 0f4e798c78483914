"""A UART, full duplex, or a USB-CDC port: bytes at the baud rate, noise where the settings differ."""

from __future__ import annotations

from typing import Any

from firmware_protocols import Serial, WireFrame
from firmware_protocols.frames import payload
from tactemu.transports.transport import SerialSetting
from tactemu.wire.line import LineModel, Pacing
from tactemu.wire.uart import agree, as_received


class SerialLine(LineModel, connector=Serial):
    """A serial line; each direction is a line by itself."""

    kind = "serial"
    schemes = ("pty", "rfc2217", "tcp", "serial", "usbip", "gadget")
    faults = ("garbage", "split", "chunk", "merge", "latency", "halfopen")
    only_modelled = {
        "unplug": "the driver's adapter stays in its socket; pull it out, or use 'halfopen'",
        "latency": "the driver's adapter has a timer of its own, /sys/bus/usb-serial/devices/NAME/latency_timer",
    }
    has_settings = True
    likely_faults = ("flip", "truncate", "lose", "garbage", "chunk", "split", "merge", "silence", "unplug")

    def __init__(self, connector: Any, *, pacing: Pacing = True):
        super().__init__(connector, pacing=pacing)
        timed = bool(pacing) and not connector.is_cdc
        self._agreed: tuple[Any, SerialSetting] | None = None
        """The connector and the port setting that were last found to agree."""
        self._byte_ns = connector.bits_per_byte * 1e9 / connector.baud if timed else 0.0

    def duration_ns(self, frame: WireFrame) -> int:
        """Return the time of all bits of a frame at the baud rate [ns]; 0 on USB."""
        return round(len(payload(frame)) * self._byte_ns)

    def driver_ns(self, frame: WireFrame, setting: Any) -> int:
        """Return the time of a frame at the speed that the driver has set [ns]."""
        speed = setting.baud if setting is not None and setting.baud else self.connector.baud
        return round(len(payload(frame)) * self._byte_ns * self.connector.baud / speed)

    def as_received(self, frame: WireFrame, connector: Any, setting: Any, *, to_driver: bool) -> WireFrame:
        """Return noise where the two ends have different settings, else the frame; on USB settings do not matter."""
        if setting is None or (connector, setting) == self._agreed:
            return frame
        if not isinstance(frame, bytes):
            return frame
        own = SerialSetting(connector.baud, connector.bytesize, connector.parity, connector.stopbits)
        if connector.is_cdc or agree(own, setting):
            self._agreed = connector, setting
            return frame
        return as_received(frame, own, setting) if to_driver else as_received(frame, setting, own)

    def describe(self) -> str:
        """Return the line in words: ``serial 115200 8N1`` or ``USB serial 115200 8N1``."""
        c = self.connector
        return f"{'USB serial' if c.is_cdc else 'serial'} {c.baud} {c.bytesize}{c.parity}{c.stopbits}"
