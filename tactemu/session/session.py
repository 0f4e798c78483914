"""One run of an emulator, from its target to its end: the order of its steps is the same for everyone who runs one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError, TransportError
from tactemu.base.kernels import start_warp
from tactemu.control.command_replay import replay_commands
from tactemu.control.control import Control
from tactemu.control.endpoints import Endpoint
from tactemu.control.server import CommandTarget, Server
from tactemu.emulator.assembly import Assembled, assemble, truth_of
from tactemu.emulator.emulator import Emulator
from tactemu.scene.file import LoadedScene, load
from tactemu.scene.steering import steered
from tactemu.session.options import CLOCKS, RunOptions
from tactemu.truth import Truth


class Session:
    """One run of an emulator; use it in a ``with`` statement, which builds it and at the end closes everything.

    Its steps are: load the scene and make its bodies movable, open the truth log, assemble, restore a state, repeat the
    commands of an earlier run (:meth:`build`); open the control socket, what goes with it, and the ports
    (:meth:`open`); at the end ports, what goes with the socket, socket and log are closed in this order
    (:meth:`close`).

    Args:
        target: a device's name, ``path/to/device.py:Class`` or ``scene.toml``; or a scene, which is run as it is.
        options: the options of the run.
    """

    def __init__(self, target: str | LoadedScene, options: RunOptions):
        self.target = target if isinstance(target, str) else target.source
        self.options = options
        self.before_opening: Callable[[Emulator], object] = lambda emulator: None
        """A function that is called when everything is built and no port is open yet."""
        self.beside: Callable[[Server | None], AbstractContextManager[object]] = lambda server: nullcontext()
        """A context, such as a live page, that is entered with the control socket before the ports are opened."""
        self.origin: tuple[Assembled, Mapping[str, Any]] | None = None
        """The emulator from which this one is forked, and its state."""
        self._given = None if isinstance(target, str) else target
        self._loaded: LoadedScene | None = None
        self._assembled: Assembled | None = None
        self._control: Control | None = None
        self._undo = ExitStack()

    def load(self) -> LoadedScene:
        """Return the scene, with bodies that can be moved by hand.

        Raises:
            TactemuError: the target is no device or scene, or there is no such body.
        """
        self._loaded = self._given
        if self._loaded is None:
            own = load(self.target, self.options.device_options)
            by_hand = self.options.by_hand and not self.target.endswith(".toml")
            self._loaded = steered(own, self.options.steer, by_hand=by_hand)
        return self._loaded

    def build(self) -> Session:
        """Build everything, from the scene that :meth:`load` has returned or anew; no port is open yet.

        Raises:
            TactemuError: an option is wrong, or something in the scene is not available; nothing is left behind.
        """
        options = self.options
        if options.preempt:
            from tactemu.base.priority import enable_realtime_priority

            enable_realtime_priority()
        start_warp()
        loaded, self._loaded = self._loaded or self.load(), None
        with ExitStack() as undo:
            truth = truth_of(loaded, options.truth, options.keep)
            undo.callback(truth.close)
            self._assembled = self._assemble(loaded, truth)
            self._control = Control(self._assembled)
            if options.restore is not None:
                self.emulator.restore(options.restore)
            if options.again is not None:
                replay_commands(self._control, options.again)
            if options.save is not None and options.save_at is not None:
                self.emulator.call(partial(self.emulator.save, options.save), round(options.save_at * 1e9))
            self._undo = undo.pop_all()
        return self

    def _assemble(self, loaded: LoadedScene, truth: Truth) -> Assembled:
        clock = CLOCKS[self.options.clock]()
        if self.origin is None:
            return assemble(loaded, self.options, clock=clock, truth=truth)
        origin, state = self.origin
        return origin.fork(port=self.options.port, clock=clock, truth=truth, state=state)

    def open(self) -> Session:
        """Open the control socket, what goes with it, and the ports.

        Raises:
            TactemuError: a port or the socket cannot be opened; nothing is left behind.
        """
        options = self.options
        try:
            server: Server | None = None
            if options.name is not None or options.default_name:
                yields = not self.emulator.clock.virtual
                socket = control_socket(self.control, self.target, options.name, yield_to_loop=yields)
                server = self._undo.enter_context(socket)
            self._undo.enter_context(self.beside(server))
            self.before_opening(self.emulator)
            self.emulator.open()
            self._undo.callback(self.emulator.close)
        except BaseException:
            self.close()
            raise
        return self

    def run(self) -> None:
        """Run the emulator's loop until the time is over or it is stopped."""
        self.emulator.run(self.options.seconds)

    def save(self) -> None:
        """Save the state if the options want it at the end.

        Raises:
            StateError: a part of it cannot be saved, or the file cannot be written.
        """
        if self.options.save is not None and self.options.save_at is None:
            self.emulator.save(self.options.save)

    def close(self) -> None:
        """Close the ports, the socket and the log. Safe to call twice."""
        self._undo.close()

    def __enter__(self) -> Session:
        return self.build()

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def assembled(self) -> Assembled:
        """The emulator with its simulation, scene and skins."""
        if self._assembled is None:
            raise TactemuError("not started; use `with tactemu.serve(...) as dev:`")
        return self._assembled

    @property
    def emulator(self) -> Emulator:
        """The emulator."""
        return self.assembled.emulator

    @property
    def control(self) -> Control:
        """The implementation of the commands, in the loop."""
        if self._control is None:
            raise TactemuError("not started; use `with tactemu.serve(...) as dev:`")
        return self._control


def control_socket(
    driven: CommandTarget, target: str, name: str | None, *, yield_to_loop: bool = True
) -> AbstractContextManager[Server | None]:
    """Serve commands under a name, default the target's; without a ``name``, a failure is only printed.

    Raises:
        TactemuError: the socket of the given name cannot be opened.
    """
    place = Endpoint(name or Path(target.rpartition(":")[2]).stem, target, exactly=name is not None)
    try:
        return closing(Server(place, driven, yield_to_loop=yield_to_loop))
    except TransportError as error:
        if name is not None:
            raise
        sys.stderr.write(f"tactemu: `tactemu poke` will not find this run: {error}\n")
        return nullcontext()
