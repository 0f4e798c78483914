"""A device on a port while a test moves the scene by hand.

::

    with tactemu.serve("anyskin") as dev:
        driver = MyDriver(dev.port)
        dev.press(depth=1e-3, seconds=0.5)
        assert driver.latest().max() > 0

The emulator runs in one background thread; everything here may be called from any other.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from firmware_protocols import Device
from tactemu.base.clock import LockstepClock, PacedClock, RealClock
from tactemu.base.errors import SceneError, TactemuError
from tactemu.base.kernels import start_quietly
from tactemu.control.command_replay import replay_commands
from tactemu.control.control import Control
from tactemu.control.control_commands import ControlCommands
from tactemu.control.endpoints import Endpoint
from tactemu.control.loop_task import LoopTask, TaskResult
from tactemu.control.server import Server
from tactemu.emulator.assembly import Assembled, RunOptions, assemble, truth_of
from tactemu.scene import file
from tactemu.scene.schema import Event, one_or_more
from tactemu.scene.steering import steered
from tactemu.truth import Sample, Truth

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation

CLOCKS = {"real": RealClock, "lockstep": LockstepClock, "paced": PacedClock}
"""The values of ``clock``: time runs by itself, or only by ``step``, or more slowly rather than miss a sample."""


def serve(
    target: str | Path,
    port: str | Mapping[str, str] | None = None,
    *,
    rate_hz: float | Mapping[str, float] | None = None,
    faults: str | Sequence[str] = (),
    seed: int | None = None,
    steer: str | Sequence[str] = (),
    by_hand: bool = True,
    scenario: Sequence[Event] = (),
    adjustable: str | Sequence[str] = (),
    truth: str | Path | None = None,
    keep: str | int | None = None,
    compute: str | None = None,
    device_options: Mapping[str, Any] | None = None,
    measured: bool = False,
    source: Scene | Simulation | Callable[[float], Any] | None = None,
    clock: str = "real",
    name: str | None = None,
    again: str | Path | None = None,
) -> Served:
    """Return a device or scene file on a port of its own; use it in a ``with`` statement.

    Args:
        target: a device's name, ``path/to/device.py:Class`` or ``scene.toml``.
        port: as for ``tactemu run --port``; default: an unused one, so that tests can run in parallel. For several
            ports, a table by skin, by the device's connector, or by ``SKIN/CONNECTOR``.
        rate_hz: sampling rate; default: the device's own. A table for a device with several streams.
        faults: faults on the wire, as for ``--fault``.
        seed: root of all random numbers; default: the scene's.
        steer: bodies of a scene file that you move by hand instead of by their motions. Bodies without a motion, and
            all those of a device's default scene, are moved by hand anyway.
        by_hand: move the bodies of a device's default scene by hand, rather than by their motions.
        scenario: events with their times (:class:`tactemu.Event`), beside the scene's own schedule.
        adjustable: laws of imperfection (``noise``, ``dead``, ``bias`` ...) that you will switch on while it runs.
        truth: file for the truth log, ``.mcap`` or ``.jsonl``.
        keep: memory for samples and frames, ``"64MB"``; default: the scene's, else a share of the process's 256 MB.
        compute: the device that runs the kernels, ``cpu`` or ``cuda:0``; default: the scene's.
        device_options: options of a device named by ``target``, as for ``tactemu run NAME OPTION=VALUE``.
        measured: take noise, clock and so on from measurements of real devices (docs/transducers.md).
        source: a simulator of your own: a scene, built or not, or a function of time that returns poses or readings
            (:mod:`tactemu.emulator.sources`).
        clock: ``real``; ``lockstep``: time advances only by :meth:`Served.step`; ``paced``: as real, but time runs
            slower on a machine that is late, and no sample is missed.
        name: the name for ``tactemu poke --name`` and :func:`tactemu.connect`; default: they cannot connect.
        again: truth log of an earlier run, whose live commands are repeated at the same times; on ports ``memory:``
            the driver's bytes are repeated, too.

    Raises:
        TactemuError: when it starts, if an argument is wrong or something in the scene is not available.
    """
    run_options = RunOptions(
        port=port, rate_hz=rate_hz, faults=tuple(one_or_more(faults)), seed=seed, compute=compute, fresh_ports=True,
        scenario=tuple(scenario), adjustable=tuple(one_or_more(adjustable)),
        measured=measured,
    )  # fmt: skip
    steered_by_name = tuple(one_or_more(steer))
    if clock not in CLOCKS:
        raise SceneError(f"clock: expected one of {', '.join(CLOCKS)}, got {clock!r}")
    return Served(
        str(target), run_options, steered_by_name, truth, keep, device_options,
        by_hand=by_hand, source=source, clock=clock, name=name, again=again,
    )  # fmt: skip


class Served(ControlCommands):
    """A running emulator in a background thread, from :func:`serve`.

    Its commands :meth:`press`, :meth:`inject_event` and so on are those of
    :class:`~tactemu.control.control_commands.ControlCommands`.
    """

    def __init__(
        self,
        target: str,
        run_options: RunOptions,
        steer: Sequence[str],
        truth: str | Path | None,
        keep: str | int | None,
        device_options: Mapping[str, Any] | None,
        *,
        by_hand: bool,
        source: Any,
        clock: str,
        name: str | None,
        again: str | Path | None,
    ):
        self.before_opening: Callable[[Any], object] = lambda emulator: None
        """A function that is called when everything is built and no port is open yet."""
        self._source = source
        self._target, self._device_options, self._run_options, self._steer_names = (
            target,
            device_options,
            run_options,
            steer,
        )
        self._by_hand = by_hand and not target.endswith(".toml")
        self._truth_path, self._keep = truth, keep
        self._thread: threading.Thread | None = None
        self._owner_pid = 0
        """Id of the process in which the thread runs."""
        self._error: BaseException | None = None
        self._clock, self._name, self._again = clock, name, again
        self._server: Server | None = None
        self._assembled: Assembled | None = None
        self._control: Control | None = None
        self._unwatched: list[LoopTask] = []
        """The tasks for which no caller waits; :meth:`stop` raises their exceptions."""
        self._forked: tuple[Assembled, dict[str, Any]] | None = None
        """The origin of a fork, and its state."""

    # -- life ------------------------------------------------------------------------------------------------------

    def use_usual_network_ports(self) -> None:
        """Use the usual ports on the network, as `tactemu run` does, rather than unused ones. Call before start."""
        self._run_options = replace(self._run_options, usual_network=True)

    def start(self) -> Served:
        """Compile, open the port, and run in a background thread. Does nothing when it already runs.

        Raises:
            TactemuError: an argument is wrong, or something in the scene is not available; nothing is left behind.
        """
        if self._thread is not None:
            return self
        start_quietly()
        loaded = file.load(self._target, self._device_options)
        truth = truth_of(loaded, self._truth_path, self._keep)
        try:
            clock = CLOCKS[self._clock]()
            if self._forked is not None:
                origin, state = self._forked
                self._assembled = origin.fork(port=self._run_options.port, clock=clock, truth=truth, state=state)
            else:
                loaded = steered(loaded, self._steer_names, by_hand=self._by_hand)
                self._assembled = assemble(loaded, self._run_options, clock=clock, truth=truth, source=self._source)
            self._control = Control(self._assembled)
            if self._again is not None:
                replay_commands(self._control, self._again)
            self.before_opening(self.emulator)
            self.emulator.open()
            if self._name is not None:
                endpoint = Endpoint(self._name, self._target, exactly=True)
                self._server = Server(endpoint, self._control, yield_to_loop=not clock.virtual)
        except BaseException:
            truth.close()
            if self._assembled is not None:
                self.emulator.close()
            raise
        self._owner_pid = os.getpid()
        self._thread = threading.Thread(target=self._run, name="tactemu", daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Stop, remove the port, and raise an exception of the background thread. Safe to call twice, and in a forked
        process."""
        if self._thread is None or self._owner_pid != os.getpid():
            return
        self.emulator.call(self.emulator.stop)
        self._thread.join()
        self._thread = None
        if self._server is not None:
            self._server.close()
        self.emulator.close()
        self._raise()
        if lost := self.truth.lost:
            raise TactemuError(
                f"{self._truth_path}: the truth log lacks {lost} entries: the disk was full, or too slow"
            )

    def __enter__(self) -> Served:
        return self.start()

    def __exit__(self, *_) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            self.emulator.run()
        except BaseException as error:  # raised by the waiting thread, or by stop()
            self._error = error

    def _raise(self) -> None:
        errors = [self._error, *(task.failed for task in self._unwatched)]
        self._error, self._unwatched = None, []
        for error in errors:
            if error is not None:
                raise error

    # -- state, readings and ports -------------------------------------------------------------------------------------

    @property
    def emulator(self):
        """The :class:`~tactemu.emulator.emulator.Emulator`; it belongs to the background thread, use
        ``emulator.call``."""
        if self._assembled is None:
            raise TactemuError("not started; use `with tactemu.serve(...) as dev:`")
        return self._assembled.emulator

    @property
    def running(self) -> bool:
        """True if it has been started, and has neither been stopped nor failed."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def truth(self) -> Truth:
        """The log of samples, frames and injected faults."""
        return self.emulator.truth

    @property
    def simulation(self):
        """The simulation; it belongs to the background thread."""
        assert self._assembled is not None
        return self._assembled.simulation

    @property
    def port(self) -> str:
        """The port that the driver opens: a path, a URL of pyserial (``socket://``, ``rfc2217://``),
        ``interface:channel``.

        Raises:
            TactemuError: there are several ports; see :attr:`ports`.
        """
        ports = set(self.ports.values())
        if len(ports) != 1:
            raise TactemuError(f"there are several ports; choose one from dev.ports: {self.ports}")
        return ports.pop()

    @property
    def ports(self) -> dict[str, str]:
        """The port of each skin."""
        return {
            channel.name if len(channel.wires) == 1 else f"{channel.name}/{port}": wire.transport.address
            for channel in self.emulator.channels
            for port, wire in channel.wires.items()
        }

    @property
    def host_port(self) -> tuple[str, int]:
        """Host and number of a TCP port, for drivers with two arguments: ``ModbusTcpClient(host, port=port)``.

        Raises:
            TactemuError: the port is no TCP port.
        """
        url = urlsplit(self.port)
        if url.hostname is None or url.port is None:
            raise TactemuError(f"the port {self.port} has no host and port; give serve(..., port='tcp:0')")
        return url.hostname, url.port

    @property
    def can(self) -> dict[str, str]:
        """``interface`` and ``channel`` of a CAN port: ``can.Bus(**dev.can)``."""
        interface, _, channel = self.port.partition(":")
        return {"interface": interface, "channel": channel}

    def device(self, skin: str | None = None) -> Device:
        """Return the firmware model of a skin (default: the only one)."""
        return self.control.channel(skin).device

    def sample(self, skin: str | None = None) -> Sample | None:
        """Return the latest sample of a skin: ideal and measured reading, and counts."""
        return self.truth.latest(self.control.channel(skin).name)

    # -- commands ------------------------------------------------------------------------------------------------------

    @property
    def control(self) -> Control:
        """The implementation of the commands, in the loop."""
        if self._control is None:
            raise TactemuError("not started; use `with tactemu.serve(...) as dev:`")
        return self._control

    def wait_for_driver(self, seconds: float = 20.0, skin: str | None = None) -> None:
        """Wait until a driver has opened the port (on a bus: has sent something).

        Raises:
            TimeoutError: no driver did within ``seconds``.
        """
        wire = self.control.channel(skin).wire
        deadline = time.monotonic() + seconds
        while not (wire.counters["received"] if wire.line_model.is_half_duplex else wire.transport.has_reader):
            if time.monotonic() > deadline:
                raise TimeoutError(f"no driver opened {wire.transport.address} within {seconds} s")
            self._check_alive()
            time.sleep(0.01)

    def fork(
        self,
        port: str | Mapping[str, str] | None = None,
        *,
        truth: str | Path | None = None,
        clock: str | None = None,
        name: str | None = None,
    ) -> Served:
        """Return another emulator that continues from the present state once it is started: use it in a ``with``
        statement.

        The two share only constant data; events in one do not change the other.

        Args:
            port: as for :func:`serve`; default: an unused one.
            truth: file for its own truth log.
            clock: as for :func:`serve`; default: as this one's.
            name: the name for ``tactemu poke``.

        Raises:
            StateError: a part of it cannot be saved.
        """
        states: list[dict[str, Any]] = []
        self.in_loop(lambda: states.append(self.emulator.snapshot()))
        other = Served(
            self._target, replace(self._run_options, port=port), self._steer_names, truth, self._keep,
            self._device_options, by_hand=self._by_hand, source=self._source,
            clock=clock or self._clock, name=name, again=None,
        )  # fmt: skip
        assert self._assembled is not None
        other._forked = self._assembled, states[0]
        return other

    def in_loop(self, action: Callable[[], object]) -> None:
        """Have the loop call ``action`` between two of its turns; wait for it, and raise its exception."""

        def begin() -> TaskResult:
            action()
            return TaskResult()

        self._wait_for(LoopTask(self.emulator, begin))

    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        """Have the loop carry out a command, and wait until it is done."""
        task = self.control.submit(verb, arguments)
        if not arguments.get("wait", True):
            self._unwatched = [e for e in (*self._unwatched, task) if e.failed or not e.done.is_set()]
            return None
        return self._wait_for(task)

    def _wait_for(self, task: LoopTask) -> Any:
        while not task.done.wait(0.05):
            self._check_alive()
        return task.result()

    def _check_alive(self) -> None:
        if not self.running:
            self._raise()
            raise TactemuError("the emulator has stopped")
