"""Changing imperfections while running, in the environments named and in no others."""

from __future__ import annotations

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.imperfections.columns import Table, environments
from tactemu.imperfections.delivery import Delay
from tactemu.imperfections.elementwise import ALIVE, DIES
from tactemu.imperfections.info import ReadingInfo

SIGNED = {"bias", "temperature_offset", "temperature_sensitivity", "saturation_low", "saturation_high"}
"""Parameters that may be negative."""


class Adjustments:
    """The setters. ``envs_idx`` is ``None`` (all), a list of numbers or a mask.

    A value is one number, one per column, or one of these for each environment named. Each setter raises
    :class:`~tactemu.errors.SceneError` if the law was off when the scene was built and is not in ``adjustable``, or if
    the value does not fit.
    """

    info: ReadingInfo
    tables: dict[str, Table]
    gain: wp.array | None
    stuck: wp.array | None
    _delay: Delay | None

    def set(self, law: str, value, envs_idx=None) -> None:
        """Changes a parameter by its option's name: ``noise_density``, ``temperature_offset`` ..."""
        if law not in self.tables:
            raise self._off(law)
        if law not in SIGNED and np.any(np.asarray(value, dtype=np.float64) < 0.0):
            raise SceneError(f"sensor {self.info.name!r}: {law} must be zero or positive, got {value!r}")
        self.tables[law].set(value, envs_idx)

    def set_bias(self, bias, envs_idx=None) -> None:
        """Constant offset [unit]."""
        self.set("bias", bias, envs_idx)

    def set_noise(self, noise, envs_idx=None) -> None:
        """Standard deviation of white noise in each sample [unit]."""
        self.set("noise", noise, envs_idx)

    def set_random_walk(self, random_walk, envs_idx=None) -> None:
        """Standard deviation of the walk's increment at each step [unit]. Where the walk is now stays."""
        self.set("random_walk", random_walk, envs_idx)

    def set_resolution(self, resolution, envs_idx=None) -> None:
        """Step of the quantiser [unit]; 0 is none."""
        self.set("resolution", resolution, envs_idx)

    def set_probe_radius_noise(self, half_width, envs_idx=None) -> None:
        """Half-width of the noise on the probe radius [m]."""
        self.set("radius_noise", half_width, envs_idx)

    def set_saturation_range(self, low: float, high: float, envs_idx=None) -> None:
        """Range that readings are clipped to [unit]."""
        if not low <= high:
            raise SceneError(f"sensor {self.info.name!r}: saturation range needs low <= high, got {low!r}, {high!r}")
        self.set("saturation_low", low, envs_idx)
        self.set("saturation_high", high, envs_idx)

    def set_jitter(self, jitter, envs_idx=None) -> None:
        """Further delay, uniform in [0, jitter] [s]: one number, or one for each environment named."""
        if self._delay is None:
            raise self._off("jitter")
        self._delay.set_jitter(jitter, envs_idx)

    def set_probe_gain(self, gain, envs_idx=None) -> None:
        """Gains of the taxels: one number, ``(n_taxels,)``, or ``(len(envs_idx), n_taxels)``."""
        if self.gain is None:
            raise self._off("gain")
        rows = self.gain.numpy()
        envs, n = environments(envs_idx, len(rows)), self.info.n_taxels
        gains = np.asarray(gain, dtype=np.float64)
        gains = gains.reshape(n) if gains.shape == self.info.layout else gains
        if gains.shape not in ((), (n,), (len(envs), n)) or not np.all(np.isfinite(gains)):
            raise SceneError(
                f"sensor {self.info.name!r}: gains must be finite, one number, ({n},) or ({len(envs)}, {n}); got shape"
                f" {gains.shape}"
            )
        rows[envs] = gains
        self.gain.assign(rows)

    def set_dead(self, taxels, dead: bool = True, value: float | None = None, envs_idx=None) -> None:
        """Kills taxels, or revives them; without a value they are stuck at their last reading."""
        if self.stuck is None:
            raise self._off("dead")
        taxels = np.atleast_1d(np.asarray(taxels, dtype=np.int64))
        if taxels.size and not 0 <= taxels.min() <= taxels.max() < self.info.n_taxels:
            raise SceneError(f"sensor {self.info.name!r}: taxels must be 0..{self.info.n_taxels - 1}, got {taxels}")
        if value is not None and not np.isfinite(value):
            raise SceneError(f"sensor {self.info.name!r}: a dead taxel reads a finite number, got {value!r}")
        flat = self.stuck.numpy()
        stuck = flat.reshape(len(flat), self.info.n_taxels, self.info.n_channels)
        fate = (DIES if value is None else float(value)) if dead else ALIVE
        stuck[np.ix_(environments(envs_idx, len(stuck)), taxels)] = fate
        self.stuck.assign(flat)

    @property
    def dead(self) -> np.ndarray:
        """Which taxels are dead, bool, shape ``(n_envs, n_taxels)``."""
        if self.stuck is None:
            raise self._off("dead")
        shape = (-1, self.info.n_taxels, self.info.n_channels)
        return self.stuck.numpy().reshape(shape)[:, :, 0] != ALIVE

    def _off(self, law: str) -> SceneError:
        return SceneError(
            f"sensor {self.info.name!r} was built without {law}: set it when building, or list it in `adjustable`"
        )
