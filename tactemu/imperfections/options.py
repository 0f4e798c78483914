"""The options of the imperfections: one keyword each, off by default, in the order in which they act.

Every sensor model has two groups of them: :class:`ImperfectionOptions` for its skin, :class:`ElectronicsOptions` for
its read-out. A column is one number of a reading: a taxel has one column (depth), three (displacement) or six (force,
then torque). Where an option takes *one number or one per column*, you may give a scalar, one per taxel ``(n_taxels,)``
or in the shape of the layout, one per taxel and channel ``(n_taxels, n_channels)``, or a flat list in which the
channels of each vector stand together, in the order of a force/torque sensor: all forces, taxel by taxel, then all
torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactemu.base.option_groups import OptionGroup

Numbers = float | Sequence | np.ndarray
"""One number, or one per column (see the module's docstring)."""

Law = Literal[
    "gain", "radius_noise", "temperature_offset", "temperature_sensitivity", "random_walk", "noise", "bias",
    "saturation_range", "resolution", "jitter", "dead",
]  # fmt: skip
"""A law that can be switched on while the scene runs: the name of an option, or ``dead`` for single dead taxels."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ImperfectionOptions(OptionGroup):
    """The imperfections of a skin. All are off by default, and an imperfection that is off costs nothing."""

    # -- inside the sensor's formula
    gain: Numbers = 1.0
    """Gain of each taxel; one number or one per taxel. Multiplies depth (probes, KinematicTaxel), the sums over points
    (ProximityTaxel) or the displacement (ElastomerTaxel)."""
    gain_range: tuple[float, float] | None = None
    """Range of the gain that every taxel draws, uniformly, when its environment is reset."""
    radius_noise: float = 0.0
    """Half-width of the uniform noise on the probe radius, drawn each step for each taxel [m]."""

    # -- spatial, over a (rows, cols) layout
    crosstalk_strength: float = 0.0
    """Share of a taxel's reading that is spread over its neighbours by a Gaussian."""
    crosstalk_sigma: float = 0.0
    """Standard deviation of that Gaussian [m]."""
    crosstalk_kernel: Sequence | np.ndarray | None = None
    """Instead of the Gaussian: one odd-sized plane for all channels, two (normal | shear and torque) or three
    (normal | shear | torque); shape ``(kh, kw)`` or ``(planes, kh, kw)``, row 0 the lowest row offset."""
    crosstalk_conserving: bool = False
    """A share that would leave the skin at a border, or fall on a filler, stays with its taxel: the total force is
    kept, and a uniform press with a symmetric kernel stays uniform."""

    # -- memory of the material
    hysteresis_strength: float = 0.0
    """Overshoot of a step in load, as a share of the step (a Maxwell element beside the spring)."""
    hysteresis_tau: float = 0.1
    """Time constant with which the overshoot decays [s]."""
    hysteresis_strength_unloading: float | None = None
    """The same share while the magnitude falls; ``None``: as while it rises."""
    hysteresis_tau_unloading: float | None = None
    """Time constant with which the unloading's overshoot decays [s]; ``None``: ``hysteresis_tau``."""
    hysteresis_backlash: float = 0.0
    """Half-width of a loop that does not depend on the rate (a play operator) [unit of the reading]: readings lag
    behind the load by this much, low while loading and high while unloading."""
    creep_strength: float = 0.0
    """Share by which the reading of a constant load has grown in the end."""
    creep_tau: float = 10.0
    """Time constant of the creep [s]."""

    # -- taxels that are broken
    dead_taxel_probability: float = 0.0
    """Probability that a taxel is dead, drawn for each taxel at each reset."""
    dead_taxel_value_range: tuple[float, float] = (0.0, 0.0)
    """Range of the constant that a dead taxel reads in all its columns [unit], drawn uniformly."""
    dead_taxel_mode: Literal["value", "last"] = "value"
    """``value``: a dead taxel reads that constant; ``last``: it is stuck at its first reading after the reset."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ElectronicsOptions(OptionGroup):
    """The imperfections of a sensor's read-out: scan, temperature, drift, noise, quantisation, delay. All are off by
    default."""

    # -- read-out of the taxels one after the other
    scan_time: float = 0.0
    """Duration of one scan [s]. The reading belongs to the end of the scan; a taxel in slot s of n was sampled
    ``scan_time * (1 - (s + 1) / n)`` earlier, by linear interpolation between steps."""
    scan_order: Literal["taxel", "row", "column"] | Sequence[int] = "taxel"
    """Slot of each taxel: ``taxel`` one after the other in index order; ``row`` the taxels of a row one after the
    other, all rows at once; ``column`` the rows one after the other; or a slot number per taxel."""

    # -- electronics
    temperature_course: Sequence[tuple[float, float]] | None = None
    """Keyframes (time [s], temperature [degree C]), rising in time; linear between them, held outside."""
    temperature_reference: float = 25.0
    """Temperature at which the sensor was calibrated [degree C]."""
    temperature_sensitivity: Numbers = 0.0
    """Change of gain [1/K]."""
    temperature_offset: Numbers = 0.0
    """Change of offset [unit/K]."""
    random_walk: Numbers = 0.0
    """Standard deviation of the walk's increment at each step [unit], whatever the step's length."""
    random_walk_density: Numbers = 0.0
    """Standard deviation of the walk after one second [unit/sqrt(s)], whatever the step's length."""
    random_walk_tau: float | None = None
    """Correlation time of a bounded (Gauss-Markov) walk [s]; ``None``: the walk is unbounded."""
    noise: Numbers = 0.0
    """Standard deviation of white noise in each sample [unit]."""
    noise_density: Numbers = 0.0
    """White noise per root bandwidth [unit/sqrt(Hz)], one-sided: that of a sample is ``noise_density / sqrt(2 dt)``."""
    bias: Numbers = 0.0
    """Constant offset [unit]."""
    saturation_range: tuple[float, float] | None = None
    """Range that readings are clipped to [unit], before they are rounded."""
    resolution: Numbers = 0.0
    """Step of the quantiser [unit]: round-half-even of x/resolution; 0: none."""

    # -- delivery
    delay: float = 0.0
    """Age of the reading that is delivered [s], to the nanosecond."""
    jitter: float = 0.0
    """Further delay, uniform in [0, jitter], drawn each step for each environment [s]."""
    jitter_reorder: bool = False
    """A later reading may be delivered before an earlier one. Otherwise a reading is never older than the last."""
    delay_interpolation: Literal["hold", "linear", "nearest"] = "hold"
    """Reading between two steps: ``hold`` the older one (never early), ``linear`` between them, ``nearest`` step (the
    delay is rounded to whole steps)."""
    history_length: int = 0
    """Number of past readings that are delivered, newest first, each delayed like a single one."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ChainOptions(ImperfectionOptions, ElectronicsOptions):
    """The imperfections of one sensor, of its skin and of its electronics, and those that can be switched on."""

    adjustable: Sequence[Law] = ()
    """Options that are built although they are zero, with a number per column, so that their setters can switch them
    on while the scene runs; ``dead`` is for :meth:`~tactemu.sensors.sensor.Sensor.set_dead`."""

    @classmethod
    def join(
        cls, imperfections: ImperfectionOptions, electronics: ElectronicsOptions, adjustable: Sequence[Law]
    ) -> ChainOptions:
        """Return the imperfections of a sensor model, given its groups."""
        return cls(**vars(imperfections), **vars(electronics), adjustable=adjustable)
