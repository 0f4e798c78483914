"""The setters by which imperfections change while the scene runs, in chosen environments only."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, TypeAlias

from numpy.typing import ArrayLike, NDArray

from tactemu.base.keywords import takes_words
from tactemu.base.words import Names

Chosen: TypeAlias = Sequence[int] | Sequence[bool] | NDArray[Any]
"""Chosen environments or taxels: indices, or a mask."""


class Adjustments(ABC):
    """The setters of a sensor's handle, and of its ``imperfections``.

    ``envs`` is ``None`` (all environments), a list of numbers or a mask. A value is one number, one per column, or
    one of these for each chosen environment. Each setter raises :class:`~tactemu.base.errors.SceneError` if the option
    was off when the scene was built and is not in ``adjustable``, or if the value does not fit.
    """

    names: Names = "tactemu"
    """The words that they take."""

    @abstractmethod
    def set(self, option: str, value: Any, envs: Chosen | None = None, taxels: Chosen | None = None) -> None:
        """Change an option by its name: ``noise_density``, ``temperature_offset``, ``saturation_range`` ...

        With ``taxels`` only these change, to one number or one for each, if the option has a number per column.
        """

    @abstractmethod
    def set_dead(
        self, taxels: int | Chosen, dead: bool = True, value: float | None = None, envs: Chosen | None = None
    ) -> None:
        """Make taxels dead, or revive them; without a value they are stuck at their last reading."""

    @takes_words
    def set_bias(self, bias: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the constant offset [unit]."""
        self.set("bias", bias, envs)

    @takes_words
    def set_noise(self, noise: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the standard deviation of white noise in each sample [unit]."""
        self.set("noise", noise, envs)

    @takes_words
    def set_random_walk(self, random_walk: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the standard deviation of the walk's increment at each step [unit]; its present value stays."""
        self.set("random_walk", random_walk, envs)

    @takes_words
    def set_resolution(self, resolution: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the step of the quantiser [unit]; 0 switches it off."""
        self.set("resolution", resolution, envs)

    @takes_words
    def set_radius_noise(self, half_width: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the half-width of the noise on the probe radius [m]."""
        self.set("radius_noise", half_width, envs)

    @takes_words
    def set_saturation_range(self, low: ArrayLike, high: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the range that readings are clipped to [unit]."""
        self.set("saturation_range", (low, high), envs)

    @takes_words
    def set_jitter(self, jitter: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the further delay, uniform between 0 and ``jitter`` [s]: one number, or one per chosen environment."""
        self.set("jitter", jitter, envs)

    @takes_words
    def set_gain(self, gain: ArrayLike, envs: Chosen | None = None) -> None:
        """Set the gains of the taxels: one number, ``(n_taxels,)``, or ``(len(envs), n_taxels)``."""
        self.set("gain", gain, envs)
