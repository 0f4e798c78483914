"""The properties of a sensor that its imperfections need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Channels = Literal["scalar", "force", "torque", "displacement"]


@dataclass(frozen=True, kw_only=True)
class ReadingInfo:
    """The shape and meaning of a raw array ``(n_envs, n_taxels, n_channels)``."""

    name: str
    """Name of the sensor: the prefix of its random streams and of its stages."""
    layout: tuple[int, ...]
    """Layout of the taxels, ``(n_taxels,)`` or ``(rows, cols)``; flat index = row * cols + col."""
    channels: tuple[Channels, ...] = ("scalar",)
    """Groups of channels in order: a scalar takes one channel, a vector three."""
    unit: str = ""
    """The unit of the numbers."""
    radius: np.ndarray
    """Nominal radius of each taxel [m], shape ``(n_taxels,)``; 0 marks a filler, which reads 0."""
    spacing: tuple[float, float] | None = None
    """Distance between columns and between rows [m], for a ``(rows, cols)`` layout."""
    normal: tuple[float, float, float] | None = None
    """Unit normal of the layout's plane in the link frame: splits vectors into normal and shear for crosstalk."""
    gain_inside: bool = True
    """True if the sensor's kernel applies the gain; if not (ElastomerTaxel), it multiplies the reading later."""

    @property
    def n_taxels(self) -> int:
        """Number of taxels, fillers included."""
        return int(np.prod(self.layout))

    @property
    def n_channels(self) -> int:
        """Channels of one taxel."""
        return sum(1 if kind == "scalar" else 3 for kind in self.channels)

    @property
    def n_columns(self) -> int:
        """Numbers of one reading."""
        return self.n_taxels * self.n_channels

    @property
    def filler(self) -> np.ndarray:
        """A mask of the fillers, bool, shape ``(n_taxels,)``."""
        return np.asarray(self.radius).reshape(-1) <= 0.0
