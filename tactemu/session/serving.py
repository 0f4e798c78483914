"""A device on a port while a test moves the scene by hand.

::

    with tactemu.serve("anyskin") as dev:
        driver = MyDriver(dev.port)
        dev.press(depth=1e-3, dwell=0.5)
        assert driver.latest().max() > 0

The emulator runs in one background thread; everything here may be called from any other.
"""

from __future__ import annotations

import inspect
import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack
from urllib.parse import urlsplit

from firmware_protocols import Device
from tactemu.base.errors import SceneError, TactemuError, nearest
from tactemu.control.control import Control
from tactemu.control.control_commands import ControlCommands
from tactemu.control.loop_task import LoopTask, TaskResult
from tactemu.session.options import SERVE_CLOCKS, RunOptions, ServeOptions
from tactemu.session.session import Session
from tactemu.truth import Sample, Truth

if TYPE_CHECKING:
    from tactemu.emulator.emulator import Emulator
    from tactemu.wire.wire import Wire


def serve(target: str | Path, port: str | Mapping[str, str] | None = None, **options: Unpack[ServeOptions]) -> Served:
    """Return a device or scene file on a port of its own; use it in a ``with`` statement.

    Args:
        target: a device's name, ``path/to/device.py:Class`` or ``scene.toml``.
        port: as for ``tactemu run --port``; default: an unused one, so that tests can run in parallel. For several
            ports, a table by skin, by the device's connector, or by ``SKIN/CONNECTOR``.
        options: the options of the run, which :class:`~tactemu.session.options.RunOptions` describes. ``device`` runs
            the kernels, ``cpu`` or ``cuda:0``; the sensor is the target.

    Raises:
        TypeError: there is no such option.
        TactemuError: when it starts, if an argument is wrong or something in the scene is not available.
    """
    if unknown := sorted(options.keys() - ServeOptions.__annotations__.keys()):
        near = nearest(unknown[0], ServeOptions.__annotations__)
        raise TypeError(f"serve() got an unexpected keyword argument {unknown[0]!r}{near}")
    if (clock := options.get("clock", "real")) not in SERVE_CLOCKS:
        raise SceneError(
            f"clock: expected one of {', '.join(SERVE_CLOCKS)}, got {clock!r}{nearest(clock, SERVE_CLOCKS)}"
        )
    return Served(Session(str(target), RunOptions(port=port, fresh_ports=True, **options)))


def _keywords() -> list[inspect.Parameter]:
    """Return the parameters of :func:`serve` besides its target, with types and defaults of the options."""
    served = {"port", *ServeOptions.__annotations__}
    kinds = {"port": inspect.Parameter.POSITIONAL_OR_KEYWORD}
    return [
        inspect.Parameter(
            each.name, kinds.get(each.name, inspect.Parameter.KEYWORD_ONLY), default=each.default, annotation=each.type
        )
        for each in fields(RunOptions)
        if each.name in served
    ]


serve.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
    [inspect.signature(serve).parameters["target"], *_keywords()], return_annotation="Served"
)


class Served(ControlCommands):
    """A running emulator in a background thread, from :func:`serve`.

    Its commands :meth:`press`, :meth:`inject_event` and so on are those of
    :class:`~tactemu.control.control_commands.ControlCommands`.
    """

    def __init__(self, session: Session):
        self._session = session
        self._thread: threading.Thread | None = None
        self._owner_pid = 0
        """Id of the process in which the thread runs."""
        self._error: BaseException | None = None
        self._unwatched: list[LoopTask] = []
        """The tasks for which no caller waits; :meth:`stop` raises their exceptions."""

    # -- life ------------------------------------------------------------------------------------------------------

    def start(self) -> Served:
        """Compile, open the port, and run in a background thread. Does nothing when it already runs.

        Raises:
            TactemuError: an argument is wrong, or something in the scene is not available; nothing is left behind.
        """
        if self._thread is not None:
            return self
        self._session.build().open()
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
        self._session.close()
        self._raise()
        if lost := self.truth.lost:
            path = self._session.options.truth
            raise TactemuError(f"{path}: the truth log lacks {lost} entries: the disk was full, or too slow")

    def __enter__(self) -> Served:
        return self.start()

    def __exit__(self, *_) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            self._session.run()
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
    def emulator(self) -> Emulator:
        """The emulator; it belongs to the background thread, use ``emulator.call``."""
        return self._session.emulator

    @property
    def running(self) -> bool:
        """True if it has been started, and has neither been stopped nor failed."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def truth(self) -> Truth:
        """The log of samples, frames and injected faults."""
        return self.emulator.truth

    @property
    def simulation(self) -> Any:
        """The simulation; it belongs to the background thread."""
        return self._session.assembled.simulation

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
            raise TactemuError(f"the port {self.port} has no host and port; {self._advise('tcp', 'tcp:0')}")
        return url.hostname, url.port

    @property
    def can(self) -> dict[str, str]:
        """``interface`` and ``channel`` of a CAN port: ``can.Bus(**dev.can)``.

        Raises:
            TactemuError: the port is no ``can:INTERFACE:CHANNEL``.
        """
        interface, _, channel = self.port.partition(":")
        if self._wire.transport.scheme != "can":
            raise TactemuError(f"the port {self.port} is no CAN bus; {self._advise('can', 'can:virtual:NAME')}")
        return {"interface": interface, "channel": channel}

    @property
    def _wire(self) -> Wire:
        """The wire of the only port."""
        return next(wire for wire in self.emulator.wires if wire.transport.address == self.port)

    def _advise(self, scheme: str, port: str) -> str:
        """Return what to do for a port of this scheme, or how to open the one that there is."""
        if scheme in self._wire.line_model.schemes:
            return f"give serve(..., port={port!r})"
        kind, can = self._wire.line_model.kind, self._wire.transport.scheme == "can"
        return f"the device has a {kind} connector: open {'can.Bus(**dev.can)' if can else 'dev.port'}"

    def device(self, skin: str | None = None) -> Device:
        """Return the firmware model of a skin (default: the only one)."""
        return self._control.channel(skin).device

    def sample(self, skin: str | None = None) -> Sample:
        """Return the latest sample of a skin: ideal and measured reading, and counts.

        Raises:
            TactemuError: it has not been sampled yet.
        """
        return self._control.sample(skin)

    # -- commands ------------------------------------------------------------------------------------------------------

    @property
    def _control(self) -> Control:
        """The implementation of the commands, in the loop."""
        return self._session.control

    def wait_for_driver(self, seconds: float = 20.0, skin: str | None = None) -> None:
        """Wait until a driver has opened the port (on a bus: has sent something).

        Raises:
            TimeoutError: no driver did within ``seconds``.
        """
        wire = self._control.channel(skin).wire
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
        options = self._session.options
        again = replace(options, port=port, truth=truth, clock=clock or options.clock, name=name, again=None)
        other = Session(self._session.target, again)
        other.origin = self._session.assembled, states[0]
        return Served(other)

    def in_loop(self, action: Callable[[], object]) -> None:
        """Have the loop call ``action`` between two of its turns; wait for it, and raise its exception."""

        def begin() -> TaskResult:
            action()
            return TaskResult()

        self._wait_for(LoopTask(self.emulator, begin))

    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        """Have the loop carry out a command, and wait until it is done."""
        task = self._control.submit(verb, arguments)
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
