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
"""What ``clock`` may be: time runs by itself, only as far as ``step`` lets it, or slower rather than miss a sample."""


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
        port: as for ``tactemu run --port``; default: a fresh one, so that tests may run side by side. Where there are
            several, a table of ports by skin, by the device's connector, or by ``SKIN/CONNECTOR``.
        rate_hz: sampling rate; default: the device's own. A table for a device with several streams.
        faults: what goes wrong on the wire, as for ``--fault``.
        seed: root of all random numbers; default: the scene's.
        steer: bodies of a scene file to be moved by hand instead of by their motions. Bodies without a motion, and
            all those of a device's default scene, are.
        by_hand: whether the default scene of a device is moved by hand, rather than by its own motions.
        scenario: what goes wrong when (:class:`tactemu.Event`), beside the scene's own schedule.
        adjustable: laws of imperfection (``noise``, ``dead``, ``bias`` ...) that you will switch on while it runs.
        truth: file for the truth log, ``.mcap`` or ``.jsonl``.
        keep: memory for samples and frames, ``"64MB"``; default: the scene's, else a share of the process's 256 MB.
        compute: where kernels run, ``cpu`` or ``cuda:0``; default: as the scene says.
        device_options: of a device named by ``target``, as for ``tactemu run NAME OPTION=VALUE``.
        measured: noise, clock and so on as of real devices, where such were measured (docs/transducers.md).
        source: a simulator of your own: a scene, built or not, or a function of time that gives poses or readings
            (:mod:`tactemu.emulator.sources`).
        clock: ``real``; ``lockstep``: time advances only by :meth:`Served.step`; ``paced``: as real, but a machine that
            is late makes time slower, and no sample is missed.
        name: under which ``tactemu poke --name`` and :func:`tactemu.connect` find it; default: they do not.
        again: truth log of an earlier run: what was done to it live is done again, at the same times; on ports
            ``memory:`` what its driver said is said again, too.

    Raises:
        TactemuError: when it starts, if something asked for cannot be had.
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
    """What :func:`serve` returns: a running emulator, seen from a test.

    What may be done to it, :meth:`press`, :meth:`inject_event` and so on, it has of
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
        """Called when everything is made and no port is open yet."""
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
        """Process in which the thread runs."""
        self._error: BaseException | None = None
        self._clock, self._name, self._again = clock, name, again
        self._server: Server | None = None
        self._assembled: Assembled | None = None
        self._control: Control | None = None
        self._unwatched: list[LoopTask] = []
        """Those that nobody waited for; :meth:`stop` raises what went wrong in them."""
        self._forked: tuple[Assembled, dict[str, Any]] | None = None
        """What it is a fork of, and its state then."""

    # -- life ------------------------------------------------------------------------------------------------------

    def use_usual_network_ports(self) -> None:
        """Have what is on the network where `tactemu run` has it, rather than on a fresh port. Call before start."""
        self._run_options = replace(self._run_options, usual_network=True)

    def start(self) -> Served:
        """Compile, open the port, and run in a background thread. Does nothing when it already runs.

        Raises:
            TactemuError: something asked for cannot be had; nothing is left behind.
        """
        if self._thread is not None:
            return self
        start_quietly()
        loaded = file.load(self._target, self._device_options)
        truth = truth_of(loaded, self._truth_path, self._keep)
        try:
            clock = CLOCKS[self._clock]()
            if self._forked is not None:
                whole, state = self._forked
                self._assembled = whole.fork(port=self._run_options.port, clock=clock, truth=truth, state=state)
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
        """Stop, remove the port, and raise what went wrong in the background. Safe to call twice, and in a fork."""
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
        except BaseException as error:  # handed to whoever waits, and to stop()
            self._error = error

    def _raise(self) -> None:
        errors = [self._error, *(task.failed for task in self._unwatched)]
        self._error, self._unwatched = None, []
        for error in errors:
            if error is not None:
                raise error

    # -- what a test looks at ------------------------------------------------------------------------------------------

    @property
    def emulator(self):
        """The :class:`~tactemu.emulator.emulator.Emulator`; it belongs to the background thread, use
        ``emulator.call``."""
        if self._assembled is None:
            raise TactemuError("not started; use `with tactemu.serve(...) as dev:`")
        return self._assembled.emulator

    @property
    def running(self) -> bool:
        """Whether it has been started, and neither been stopped nor failed."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def truth(self) -> Truth:
        """What was felt, sent and injected."""
        return self.emulator.truth

    @property
    def simulation(self):
        """The simulation; it belongs to the background thread."""
        assert self._assembled is not None
        return self._assembled.simulation

    @property
    def port(self) -> str:
        """What the driver opens: a path, a URL of pyserial (``socket://``, ``rfc2217://``), ``interface:channel``.

        Raises:
            TactemuError: several ports; see :attr:`ports`.
        """
        ports = set(self.ports.values())
        if len(ports) != 1:
            raise TactemuError(f"several ports, choose from dev.ports: {self.ports}")
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
        """Host and port of a TCP port, for drivers that take them apart: ``ModbusTcpClient(host, port=port)``.

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

    # -- what a test does ----------------------------------------------------------------------------------------------

    @property
    def control(self) -> Control:
        """What may be done to it, in the loop's own words."""
        if self._control is None:
            raise TactemuError("not started; use `with tactemu.serve(...) as dev:`")
        return self._control

    def wait_for_driver(self, seconds: float = 20.0, skin: str | None = None) -> None:
        """Return when a driver has opened the port (on a bus: has sent something).

        Raises:
            TimeoutError: none did within ``seconds``.
        """
        wire = self.control.channel(skin).wire
        deadline = time.monotonic() + seconds
        while not (wire.counters["received"] if wire.line_model.is_half_duplex else wire.transport.has_reader):
            if time.monotonic() > deadline:
                raise TimeoutError(f"no driver came to {wire.transport.address} within {seconds} s")
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
        """Return another that goes on from where this one is now, once it is started: use it in a ``with`` statement.

        They share what never changes; what happens to one, the other does not feel.

        Args:
            port: as for :func:`serve`; default: a fresh one.
            truth: file for its own truth log.
            clock: as for :func:`serve`; default: as this one's.
            name: for ``tactemu poke``.

        Raises:
            StateError: some part of it cannot be saved.
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
        """Have the loop call ``action`` between two of its turns; returns when it has, and raises what it raised."""

        def begin() -> TaskResult:
            action()
            return TaskResult()

        self._wait_for(LoopTask(self.emulator, begin))

    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        """Have the loop do a command, and wait until it is done."""
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
