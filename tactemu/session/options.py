"""The options of a run: of ``tactemu run``, ``tactemu exec``, ``tactemu.serve``, the fixture, judge and datasets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from tactemu.base.clock import Clock, LockstepClock, PacedClock, RealClock, VirtualClock
from tactemu.base.errors import SceneError, nearest
from tactemu.emulator.options import AssemblyOptions

if TYPE_CHECKING:
    from tactemu.scene.events import EventTable
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation

CLOCKS: dict[str, type[Clock]] = {
    "real": RealClock, "virtual": VirtualClock, "lockstep": LockstepClock, "paced": PacedClock,
}  # fmt: skip
"""The clocks of :attr:`RunOptions.clock`."""
RUN_CLOCKS = ("real", "virtual", "lockstep")
"""The clocks of a run in the foreground, which owns the process."""
SERVE_CLOCKS = ("real", "lockstep", "paced")
"""The clocks of a run in a background thread; a virtual clock would not wait for the other threads."""


@dataclass(frozen=True)
class RunOptions(AssemblyOptions):
    """The options of a run; those that are ``None`` or empty follow the scene."""

    steer: str | Sequence[str] = ()
    """Bodies of a scene file that you move by hand instead of by their motions. Bodies without a motion are moved by
    hand anyway."""
    by_hand: bool = True
    """Move all bodies of a device's default scene by hand, rather than by their motions."""
    truth: str | Path | None = None
    """File for the truth log, ``.mcap`` or ``.jsonl``."""
    keep: str | int | None = None
    """Memory for samples and frames, ``"64MB"``; default: the scene's, else a share of the process's 256 MB."""
    device_options: Mapping[str, Any] | None = None
    """Options of a device named by the target, as for ``tactemu run NAME OPTION=VALUE``."""
    clock: str = "real"
    """``real``; ``lockstep``: time advances only by :meth:`Served.step`; ``paced`` (not on the command line): as real,
    but time runs slower on a machine that is late, and no sample is missed; ``virtual`` (on the command line): as fast
    as possible."""
    name: str | None = None
    """The name for ``tactemu poke --name`` and :func:`tactemu.connect`; default: they cannot connect."""
    again: str | Path | None = None
    """Truth log of an earlier run, whose live commands are repeated at the same times; on ports ``memory:`` the
    driver's bytes are repeated, too."""
    default_name: bool = False
    """Take the target's name if :attr:`name` is ``None``; then a failure of the control socket is only printed."""
    seconds: float | None = None
    """Emulation time after which the run ends [s]; default: it does not."""
    restore: Path | None = None
    """File of the saved state with which the run begins."""
    save: Path | None = None
    """File for the complete state at the end."""
    save_at: float | None = None
    """Time at which the state is saved instead [s]."""
    preempt: bool = False
    """Run with real-time priority, so that other programs delay no frame."""

    def __post_init__(self):
        super().__post_init__()
        self._make_tuples("steer")
        if self.clock not in CLOCKS:
            raise SceneError(
                f"clock: expected one of {', '.join(CLOCKS)}, got {self.clock!r}{nearest(self.clock, CLOCKS)}"
            )


class ServeOptions(TypedDict, total=False):
    """The options of :func:`tactemu.serve` and of the fixture, for editors; :class:`RunOptions` describes them."""

    rate_hz: float | Mapping[str, float] | None
    faults: str | Sequence[str]
    seed: int | None
    steer: str | Sequence[str]
    by_hand: bool
    scenario: Sequence[EventTable]
    adjustable: str | Sequence[str]
    truth: str | Path | None
    keep: str | int | None
    device: str | None
    device_options: Mapping[str, Any] | None
    measured: bool
    source: Scene | Simulation | Callable[[float], Any] | None
    clock: str
    name: str | None
    again: str | Path | None
