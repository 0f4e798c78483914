"""The test rig of a driver: an emulator on a port, fed by the excitation, with everything recorded."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from firmware_protocols import Can, Device
from firmware_protocols.declared import has_checksum
from tactemu.base.errors import TactemuError
from tactemu.judge.columns import Channel, channels_of
from tactemu.judge.excitation import STEP, WIDE, Excitation, ExcitationRange
from tactemu.judge.plan import LineFacts, Trial
from tactemu.judge.trial_record import Recorder
from tactemu.scene import file
from tactemu.scene.building import make_devices
from tactemu.session.serving import Served, serve
from tactemu.wire.wire import Wire

OVERLOAD = 5.0
"""Factor on the forces that saturates a device."""
OVERLOAD_WIDE = 20.0
"""The same for wide channels, which are excited over a tenth of their range only."""
_CALL_TIMEOUT_S = 10.0
"""Time within which the emulator's loop must run a call [s]."""


class DriverRig:
    """The emulator of a device or scene file on which drivers are judged; use it in a ``with`` statement.

    Args:
        target: as for :func:`tactemu.serve`.
        port: as for :func:`tactemu.serve`.
        seed: of the excitation and of the faults.
        options: of the device.
        rate_hz: sampling rate; default: the device's own.
    """

    def __init__(
        self,
        target: str,
        port: str | Mapping[str, str] | None = None,
        *,
        seed: int = 0,
        options: Mapping[str, Any] | None = None,
        rate_hz: float | None = None,
    ):
        loaded = file.load(target, options)
        devices = make_devices(loaded)
        spans = {
            name: ExcitationRange(lambda device=device: type(device)(**device.options))
            for name, device in devices.items()
        }
        self._on_can = any(isinstance(port, Can) for device in devices.values() for port in device.ports)
        self.excitation = Excitation(spans, seed)
        self.recorder = Recorder()
        self.served: Served = serve(
            target, port, seed=seed, rate_hz=rate_hz, device_options=options, source=self.excitation, by_hand=False
        )
        self.served._session.before_opening = lambda emulator: self.recorder.listen(emulator.truth)
        self._faults: list[tuple[Wire, Any]] = []
        self._undo: list[Callable[[], object]] = []

    def __enter__(self) -> DriverRig:
        if self._on_can:
            # A multicast bus receives every frame on its UDP port, also those of judges that run beside this one.
            # python-can reads this variable here and in the driver's process.
            os.environ.setdefault("CAN_CONFIG", json.dumps({"port": 20_000 + os.getpid() % 20_000}))
        self.served.start()
        self.emulator = self.served.emulator
        self.wires: list[Wire] = self.emulator.wires
        self.periods = {c.name: dict(c.device.periods) for c in self.emulator.channels}
        """The firmware's sampling periods before a driver connects, by skin and stream."""
        return self

    def __exit__(self, *_) -> None:
        self.served.stop()

    # -- properties ----------------------------------------------------------------------------------------------------

    @property
    def ports(self) -> dict[str, str]:
        """The ports that drivers open, by skin."""
        return self.served.ports

    def channels(self) -> list[Channel]:
        """Return the channels of a sample, in its order."""
        devices = {channel.name: channel.device for channel in self.emulator.channels}
        shapes, seen = [], set()
        for sample in self.emulator.truth.samples[-64:]:
            if (sample.device, sample.sense) not in seen:
                seen.add((sample.device, sample.sense))
                shapes.append((sample.device, sample.sense, sample.counts.shape))
        first = {key: k for k, key in enumerate(self.recorder.senses)}
        shapes.sort(key=lambda shape: first.get(f"{shape[0]}/{shape[1]}", len(first)))
        return channels_of(devices, shapes)

    @property
    def period_s(self) -> float:
        """The shortest sampling period in force [s]."""
        periods = [c.period_ns(stream) for c in self.emulator.channels for stream in c.timers]
        return min((period for period in periods if period), default=10_000_000) / 1e9

    def facts(self, since: int, rows: int) -> LineFacts:
        """Return the facts on which the plan depends, from the traffic since a time, with the number of rows since."""
        recorder, wire = self.recorder, self.wires[0]
        frames = [frame for frame in recorder.frames if frame.t_ns >= since]
        tx, rx = [f.text for f in frames if f.kind == "tx"], [f.text for f in frames if f.kind == "rx"]
        device = self.emulator.channels[0].device
        talks = len(rx) > 3 and len(rx) > 0.05 * max(1, rows)
        asks = talks and len(rx) >= 0.5 * rows
        seconds = (time.monotonic_ns() - since) / 1e9
        sets = any(dict(c.device.periods) != self.periods[c.name] for c in self.emulator.channels)
        samples = len({f.sample for f in frames if f.kind == "tx" and not f.is_answer})
        readings = rows if asks else samples
        return LineFacts(
            line=wire.line_model, is_real=wire.transport.is_paced, asks=asks, talks=talks, sets_rate=sets,
            frames=tx[-400:], requests=rx[-64:], frames_per_row=max(1, round(len(tx) / max(1, readings))),
            row_s=seconds / max(1, readings), period_s=self.period_s,
            rollovers=device.rollovers, lacks_checksum=not has_checksum(device),
            replies=_literal_replies(device) if asks else (),
            identifiers=sorted({int(f.partition("#")[0], 16) for f in tx if "#" in f}),
            taxels=sum(len(c.device.layout) for c in self.emulator.channels), numbered=bool(device.rollovers),
        )  # fmt: skip

    # -- actions -------------------------------------------------------------------------------------------------------

    def do(self, action: Callable[[], object]) -> int:
        """Run an action in the emulator's loop, and return the monotonic time at which it was done [ns].

        Raises:
            TactemuError: the action raised it, or the emulator does not respond.
        """
        done, box = threading.Event(), []

        def act() -> None:
            try:
                action()
            except Exception as error:
                box.append(error)
            box.append(time.monotonic_ns())
            done.set()

        self.emulator.call(act)
        if not done.wait(_CALL_TIMEOUT_S):
            self.served.stop()
            raise TactemuError(f"the emulator's loop has not responded for {_CALL_TIMEOUT_S:g} s")
        if len(box) > 1:
            raise box[0]
        return box[0]

    def release(self) -> None:
        """Remove all loads from the skins: drivers tare and calibrate when they open."""
        self.excitation.mode = "untouched"

    def excite(self, steps: bool = False) -> None:
        """Apply new loads at every sample or, with ``steps``, hold them for :data:`~.excitation.STEP` samples."""
        self.excitation.hold_ns = round(STEP * self.period_s * 1e9)
        self.excitation.mode = "steps" if steps else "random"

    def rate(self, hz: float | None) -> None:
        """Set the sampling rate; ``None`` restores the device's own."""
        now = self.emulator.now_ns
        for channel in self.emulator.channels:
            wanted = {} if hz is None else dict.fromkeys(channel.device.periods, round(1e9 / hz))
            channel.want_periods(wanted, now)

    def begin(self, trial: Trial) -> int:
        """Switch a trial's faults on, start its action, and return the time [ns]."""

        def act() -> None:
            for fault in trial.faults:
                for wire in self.wires:
                    self._faults.append((wire, wire.add_fault(fault)))
            self._act(trial)

        return self.do(act)

    def _act(self, trial: Trial) -> None:
        emulator, now = self.emulator, self.emulator.now_ns
        match trial.action:
            case "hang" if not trial.faults:
                emulator.hang(now + round(trial.seconds * 1e9))
            case "reset":
                emulator.reset()
            case "baud":
                for channel in emulator.channels:
                    for port, wire in channel.wires.items():
                        connector: Any = channel.device.connector(port)
                        wire.attach(channel.name, replace(connector, baud=max(1200, connector.baud // 2)))
                    self._undo.append(channel.attach_wires)
            case "rate":
                self.rate(trial.rate_hz)
                self._undo.append(lambda: self.rate(self._usual_rate))
            case "saturate":
                self.excitation.overload = OVERLOAD_WIDE if self._is_wide else OVERLOAD
                self._undo.append(lambda: setattr(self.excitation, "overload", 1.0))
            case "dead":
                self.excitation.dead = dict.fromkeys(self.excitation.spans, self.excitation.seed)
                self._undo.append(self.excitation.dead.clear)

    @property
    def _is_wide(self) -> bool:
        columns = [column for channel in self.emulator.channels for column in channel.device.columns]
        return any(column.high - column.low > WIDE for column in columns)

    def finish(self) -> int:
        """Switch the trial's faults and action off, and return the time [ns]."""

        def act() -> None:
            for wire, fault in self._faults:
                if fault in wire.faults:
                    wire.remove_fault(fault)
            for undo in self._undo:
                undo()
            self._faults, self._undo = [], []

        return self.do(act)

    _usual_rate: float | None = None

    def speed_up(self, hz: float) -> None:
        """Sample faster than the device's own rate until the end of the run."""
        self._usual_rate = hz
        self.do(lambda: self.rate(hz))


def _literal_replies(device: Device) -> list[str]:
    """Return the constant answers of the device's commands, as hex."""
    found = []
    for command in device.commands:
        replies = command.reply if isinstance(command.reply, list | tuple) else [command.reply]
        for reply in replies:
            text = reply.hex() if isinstance(reply, bytes) else reply if isinstance(reply, str) else ""
            text = text.replace(" ", "")
            try:
                found.append(bytes.fromhex(text).hex())
            except ValueError:  # a pattern, or a CAN frame
                continue
    return [reply for reply in dict.fromkeys(found) if reply]
