"""The setters of :class:`~tactemu.imperfections.Imperfections` on the sensor's handle, under the seed's names."""

from __future__ import annotations

from tactemu.errors import SceneError
from tactemu.imperfections.compile import Imperfections


class SensorSetters:
    """For a sensor handle with an attribute ``imperfections``, which is ``None`` until the scene is built.

    ``envs_idx``: ``None`` (all environments), a list of numbers or a mask. A value is one number, one per column, or
    one of these for each environment named. What was off when the scene was built must be listed in ``adjustable``.
    """

    name: str
    imperfections: Imperfections | None

    def set_bias(self, bias, envs_idx=None) -> None:
        """Constant offset [unit]."""
        self._built.set_bias(bias, envs_idx)

    def set_noise(self, noise, envs_idx=None) -> None:
        """Standard deviation of white noise in each sample [unit]."""
        self._built.set_noise(noise, envs_idx)

    def set_random_walk(self, random_walk, envs_idx=None) -> None:
        """Standard deviation of the walk's increment at each step [unit]."""
        self._built.set_random_walk(random_walk, envs_idx)

    def set_resolution(self, resolution, envs_idx=None) -> None:
        """Step of the quantiser [unit]; 0 is none."""
        self._built.set_resolution(resolution, envs_idx)

    def set_jitter(self, jitter, envs_idx=None) -> None:
        """Further delay, uniform in [0, jitter] [s]."""
        self._built.set_jitter(jitter, envs_idx)

    def set_probe_gain(self, gain, envs_idx=None) -> None:
        """Gains of the taxels: one number or one per taxel."""
        self._built.set_probe_gain(gain, envs_idx)

    def set_dead(self, taxels, dead: bool = True, value: float | None = None, envs_idx=None) -> None:
        """Kills taxels, or revives them; without a value they are stuck at their last reading."""
        self._built.set_dead(taxels, dead, value, envs_idx)

    @property
    def _built(self) -> Imperfections:
        if self.imperfections is None:
            raise SceneError(f"sensor {self.name!r} has nothing to set yet: build the scene (scene.build()) first")
        return self.imperfections
