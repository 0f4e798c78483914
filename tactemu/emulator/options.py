"""The options of an assembly: what a caller may ask of an emulator beside its scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tactemu.base.errors import SceneError
from tactemu.base.options import number
from tactemu.base.units import Hertz
from tactemu.scene.events import EventTable
from tactemu.scene.schema import one_or_more

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation


@dataclass(frozen=True)
class AssemblyOptions:
    """The options of an emulator; those that are ``None`` or empty follow the scene."""

    port: str | Mapping[str, str] | None = None
    """One port, or ports by skin, by the device's connector, or by ``SKIN/CONNECTOR``, as for ``tactemu run --port``;
    default: the scene's, else the device's usual one."""
    rate_hz: float | Mapping[str, float] | None = None
    """Sampling rate; default: the device's own [Hz]. A table by stream for a device with several."""
    faults: str | Sequence[str] = ()
    """Faults on the wire, as for ``--fault``."""
    seed: int | None = None
    """Root of all random numbers; default: the scene's."""
    scenario: Sequence[EventTable] = ()
    """Events with their times (:class:`tactemu.Event`), beside the scene's own schedule."""
    adjustable: str | Sequence[str] = ()
    """Laws of imperfection (``noise``, ``dead``, ``bias`` ...) that you will switch on while it runs."""
    device: str | None = None
    """The device that runs the kernels, ``cpu`` or ``cuda:0``; default: the scene's ``compute``. The sensor is the
    target."""
    measured: bool = False
    """Take noise, clock and so on from measurements of real devices (docs/transducers.md) where the scene does not set
    them."""
    source: Scene | Simulation | Callable[[float], Any] | None = None
    """A simulator of your own: a scene, built or not, or a function of time that returns poses or readings
    (:mod:`tactemu.emulator.sources`)."""
    fresh_ports: bool = False
    """Take an unused port instead of the usual one, where neither caller nor scene names one."""
    usual_network: bool = False
    """Keep the usual port on the network, also with :attr:`fresh_ports`."""
    env: int = 0
    """Number of the environment, if other processes simulate others: each has random numbers of its own."""

    def __post_init__(self):
        ports = self.port.values() if isinstance(self.port, Mapping) else [self.port]
        if not all(isinstance(port, str | None) for port in ports):
            raise SceneError(f"port: give a text such as 'pty:/tmp/skin', got {self.port!r}")
        rates = self.rate_hz.values() if isinstance(self.rate_hz, Mapping) else [self.rate_hz]
        for rate in rates:
            if rate is not None:
                number("rate_hz", "a rate", rate, Hertz)
        if not isinstance(self.seed, int | None) or isinstance(self.seed, bool):
            raise SceneError(f"seed: expected a whole number, got {self.seed!r}")
        self._make_tuples("faults", "adjustable")
        object.__setattr__(self, "scenario", tuple(self.scenario))

    def _make_tuples(self, *names: str) -> None:
        """Turn options that are one text or several into tuples.

        Raises:
            SceneError: an option is neither.
        """
        for name in names:
            given = one_or_more(getattr(self, name))
            if not all(isinstance(text, str) for text in given):
                raise SceneError(f"{name}: expected a list of texts, got {given!r}")
            object.__setattr__(self, name, tuple(given))
