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
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np

from firmware_protocols import Device
from tactemu.assembly import Assembled, Wishes, assemble, truth_of
from tactemu.emulator import Channel, Emulator
from tactemu.errand import Errand
from tactemu.errors import TactemuError
from tactemu.kernels import start_quietly
from tactemu.scenario import befall
from tactemu.scene import file
from tactemu.scene.motion import Pose
from tactemu.scene.placement import PlacedSkin
from tactemu.scene.schema import Event, one_or_more
from tactemu.scene.steering import (
    Leg,
    Steered,
    check_depth,
    check_pace,
    check_place,
    nearest_body,
    pressing_way,
    steered,
)
from tactemu.transports.pty import PtyTransport
from tactemu.truth import Sample, Truth

if TYPE_CHECKING:
    from tactemu.physics.simulation import Simulation
    from tactemu.scene.bodies import Body
    from tactemu.scene.scene import Scene

_SPEED = 0.05
"""Of bodies that are steered [m/s], unless told otherwise."""


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
    source: Scene | Simulation | Callable[[float], Any] | None = None,
) -> Served:
    """A device or scene file on a port of its own; use it in a ``with`` statement.

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
        adjustable: laws of imperfection (``noise``, ``dead``, ``bias`` ...) that :meth:`Served.happen` will switch on.
        truth: file for the truth log, ``.mcap`` or ``.jsonl``.
        keep: memory for samples and frames, ``"64MB"``; default: the scene's, else a share of the process's 256 MB.
        compute: where kernels run, ``cpu`` or ``cuda:0``; default: as the scene says.
        device_options: of a device named by ``target``, as for ``tactemu run NAME OPTION=VALUE``.
        source: a simulator of your own: a scene, built or not, or a function of time that gives poses or readings
            (:mod:`tactemu.sources`).

    Raises:
        TactemuError: when it starts, if something asked for cannot be had.
    """
    wishes = Wishes(
        port=port, rate_hz=rate_hz, faults=tuple(one_or_more(faults)), seed=seed, compute=compute, fresh_ports=True,
        scenario=tuple(scenario), adjustable=tuple(one_or_more(adjustable)),
    )  # fmt: skip
    steered_by_name = tuple(one_or_more(steer))
    return Served(
        str(target), wishes, steered_by_name, truth, keep, device_options, by_hand=by_hand, source=source
    )  # fmt: skip


class Served:
    """What :func:`serve` returns: a running emulator, seen from a test."""

    def __init__(
        self,
        target: str,
        wishes: Wishes,
        steer: Sequence[str],
        truth: str | Path | None,
        keep: str | int | None,
        device_options: Mapping[str, Any] | None,
        *,
        by_hand: bool,
        source: Any,
    ):
        self.before_opening: Callable[[Emulator], object] = lambda emulator: None
        """Called when everything is made and no port is open yet."""
        self._source = source
        self._target, self._device_options, self._wishes, self._steer_names = target, device_options, wishes, steer
        self._by_hand = by_hand and not target.endswith(".toml")
        self._truth_path, self._keep = truth, keep
        self._thread: threading.Thread | None = None
        self._maker = 0
        """Process in which the thread runs."""
        self._error: BaseException | None = None
        self._assembled: Assembled | None = None
        self._unwatched: list[Errand] = []
        """Those that nobody waited for; :meth:`stop` raises what went wrong in them."""
        self._steered: dict[str, Steered] = {}
        self._back: dict[str, np.ndarray] = {}
        self._hand = ""
        """The body that was pressed last."""

    # -- life ------------------------------------------------------------------------------------------------------

    def start(self) -> Served:
        """Compile, open the port, and run in a background thread. Does nothing when it already runs.

        Raises:
            TactemuError: something asked for cannot be had; nothing is left behind.
        """
        if self._thread is not None:
            return self
        start_quietly()
        loaded = file.load(self._target, self._device_options)
        loaded, self._steered = steered(loaded, self._steer_names, by_hand=self._by_hand)
        truth = truth_of(loaded, self._truth_path, self._keep)
        try:
            self._assembled = assemble(loaded, self._wishes, truth=truth, source=self._source)
            for name in self._assembled.posed:
                self._steered.pop(name, None)
            self.before_opening(self.emulator)
            self.emulator.open()
        except BaseException:
            truth.close()
            raise
        self._maker = os.getpid()
        self._thread = threading.Thread(target=self._run, name="tactemu", daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Stop, remove the port, and raise what went wrong in the background. Safe to call twice, and in a fork."""
        if self._thread is None or self._maker != os.getpid():
            return
        self.emulator.call(self.emulator.stop)
        self._thread.join()
        self._thread = None
        self.emulator.close()
        self._raise()

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
        errors = [self._error, *(errand.failed for errand in self._unwatched)]
        self._error, self._unwatched = None, []
        for error in errors:
            if error is not None:
                raise error

    # -- what a test looks at ------------------------------------------------------------------------------------------

    @property
    def emulator(self):
        """The :class:`~tactemu.emulator.Emulator`; it belongs to the background thread, use ``emulator.call``."""
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
        """The firmware model of a skin (default: the only one)."""
        return self._channel(skin).device

    def sample(self, skin: str | None = None) -> Sample | None:
        """The latest sample of a skin: ideal and measured reading, and counts."""
        return self.truth.latest(self._channel(skin).name)

    def _channel(self, skin: str | None) -> Channel:
        channels = {channel.name: channel for channel in self.emulator.channels}
        if skin is None and len(channels) == 1:
            return next(iter(channels.values()))
        if skin not in channels:
            raise TactemuError(f"which skin? there are: {', '.join(channels)}")
        return channels[skin]

    # -- what a test does ----------------------------------------------------------------------------------------------

    def press(
        self,
        depth: float,
        seconds: float | None = None,
        *,
        taxel: int | None = None,
        body: str | None = None,
        skin: str | None = None,
        speed: float = _SPEED,
        wait: bool = True,
    ) -> None:
        """Bring a body over a taxel and press it in.

        Args:
            depth: how far its foremost point goes below the skin [m].
            seconds: how long it stays at depth; then it is released. ``None``: it stays until :meth:`release`.
            taxel: number of the taxel; default: the one nearest to the body.
            body: which body; default: of those that can be steered, the one nearest to the taxel.
            skin: which skin; default: the only one.
            speed: [m/s].
            wait: return when it is done (at depth, or released again) and every skin has sampled it, not at once.
        """
        check_depth("press", depth)
        check_pace("press", 0.0 if seconds is None else seconds, speed)
        assert self._assembled is not None
        channel, now_s = self._channel(skin), self.emulator.clock.now_ns() / 1e9
        taxels = self._taxels(channel)
        choose = body is None and self._steered
        name = self._hand = nearest_body(self._steered, taxels, taxel, now_s) if choose else self._body(body)
        shape = self._assembled.scene.body(name)

        def legs(here: Pose, t_s: float) -> list[Leg]:
            k = taxels.chosen(taxel, here.position, t_s)
            target, normal = taxels.positions(t_s)[k], taxels.normals(t_s)[k]
            gap = float(channel.device.layout.pitches[k])
            way, back = pressing_way(shape, here, target, normal, depth=depth, clearance=gap, speed=speed)
            self._back[name] = back
            if seconds is None:
                return way
            down = way[-1].position
            return [*way, Leg(seconds, down), Leg(float(np.linalg.norm(back - down)) / speed, back)]

        self._go(name, legs, wait)

    def release(self, *, body: str | None = None, speed: float = _SPEED, wait: bool = True) -> None:
        """Lift a body (default: the one that pressed last) to where it was over the skin."""
        check_pace("release", 0.0, speed)
        name = self._body(body)

        def legs(here: Pose, _t: float) -> list[Leg]:
            back = self._back.get(name, here.position)
            return [Leg(float(np.linalg.norm(back - here.position)) / speed, back)]

        self._go(name, legs, wait)

    def move(
        self,
        position: Sequence[float] | None = None,
        quaternion: Sequence[float] | None = None,
        *,
        by: Sequence[float] = (0.0, 0.0, 0.0),
        seconds: float = 0.0,
        body: str | None = None,
        wait: bool = True,
    ) -> None:
        """Move a body to a world position [m] and orientation, or ``by`` a distance, along a straight line.

        ``seconds`` 0 means at once (no velocity is felt for more than a step).
        """
        check_pace("move", seconds, _SPEED)
        check_place("move", position=position, by=by, quaternion=quaternion)

        def legs(here: Pose, _t: float) -> list[Leg]:
            goal = (here.position if position is None else np.asarray(position, float)) + np.asarray(by, float)
            return [Leg(seconds, goal, None if quaternion is None else np.asarray(quaternion, float))]

        self._go(self._body(body), legs, wait)

    def happen(self, **event: Any) -> None:
        """Let something go wrong, as an entry ``[[scenario]]`` of a scene file would; times count from now.

        ``dev.happen(fault="unplug for 0.5s")``, ``dev.happen(dead=[4])``, ``dev.happen(at=1, until=2, hang=True)``,
        ``dev.happen(reset=True)``, ``dev.happen(set={"noise": 0.1})``. Imperfections that were off when the device was
        built must be named in ``serve(..., adjustable=[...])``.

        Raises:
            SceneError: the event is not one, or this scene cannot have it.
        """
        what = Event(**event)

        def begin(now_s: float) -> float:
            befall(self.emulator, what, now_s)
            return now_s

        self._until(begin)

    def set_pose(self, body: Body | str, **pose: Any) -> None:
        """Pose a body of the simulation, as :meth:`tactemu.physics.simulation.Simulation.set_pose`, from any thread.

        Raises:
            TactemuError: there is no such body, it is fixed, or the pose is none.
        """

        def put(now_s: float) -> float:
            self.simulation.set_pose(body, **pose)
            return now_s

        self._until(put)

    def set_lines(self, *, dtr: bool, rts: bool, skin: str | None = None) -> None:
        """Move the modem lines of a pseudo terminal, on which a driver cannot."""
        transport = self._channel(skin).wire.transport
        if not isinstance(transport, PtyTransport):
            raise TactemuError(f"the port {transport.address} is no pseudo terminal; only those want their lines moved")
        transport.set_lines(dtr, rts)

    def wait(self, seconds: float) -> None:
        """Let the emulator run for ``seconds`` of its time."""
        check_pace("wait", seconds, _SPEED)
        self._until(lambda now_s: now_s + seconds)

    def wait_for_driver(self, seconds: float = 20.0, skin: str | None = None) -> None:
        """Return when a driver has opened the port (on a bus: has sent something).

        Raises:
            TimeoutError: none did within ``seconds``.
        """
        wire = self._channel(skin).wire
        deadline = time.monotonic() + seconds
        while not (wire.counters["received"] if wire.carrier.one_line else wire.transport.listening):
            if time.monotonic() > deadline:
                raise TimeoutError(f"no driver came to {wire.transport.address} within {seconds} s")
            self.wait(0.01)

    def _body(self, name: str | None) -> str:
        if not self._steered:
            raise TactemuError("no body can be steered: give serve(..., steer=[name]) one that is not fixed")
        if name is not None and name not in self._steered:
            raise TactemuError(f"body {name!r} cannot be steered; these can: {', '.join(self._steered)}")
        return name or self._hand or next(iter(self._steered))

    def _taxels(self, channel: Channel) -> PlacedSkin:
        assert self._assembled is not None
        if channel.name not in self._assembled.skins:
            raise TactemuError(f"skin {channel.name!r} plays recorded readings; nothing can be pressed into it")
        return self._assembled.skins[channel.name]

    def _go(self, name: str, legs: Callable[[Pose, float], list[Leg]], wait: bool) -> None:
        motion = self._steered[name]
        self._until(lambda now_s: motion.follow(now_s, legs(motion.world(now_s), now_s)), wait=wait, sampled=True)

    def in_loop(self, action: Callable[[], object]) -> None:
        """Have the loop call ``action`` between two of its turns; returns when it has, and raises what it raised."""

        def begin(now_s: float) -> float:
            action()
            return now_s

        self._until(begin)

    def _until(self, begin: Callable[[float], float], *, wait: bool = True, sampled: bool = False) -> None:
        """Have the loop call ``begin(now_s)``, and wait until the time [s] that it returns (see :class:`Errand`)."""
        errand = Errand(self.emulator, begin, sampled=sampled)
        if not wait:
            self._unwatched = [e for e in (*self._unwatched, errand) if e.failed or not e.done.is_set()]
            return
        while not errand.done.wait(0.05):
            if self._thread is None or not self._thread.is_alive():
                self._raise()
                raise TactemuError("the emulator has stopped")
        if errand.failed is not None:
            raise errand.failed
