"""The tables of a body's texture in a scene file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from firmware_protocols.bounds import Bounds
from tactemu.base.units import LENGTH_UNIT, MAX_SIZE_M, Number, Whole
from tactemu.geometry.shapes.texture import HeightMap, HeightSpectrum, Texture
from tactemu.scene.table import Table

Spacing = Annotated[float, Bounds(unit=LENGTH_UNIT, low=1e-7, below=MAX_SIZE_M)]
"""A wavelength, or the distance of samples of a map."""
Height = Annotated[float, Bounds(unit=LENGTH_UNIT, low=-0.1, high=0.1)]
"""A height of a texture."""


class MapTable(Table):
    """Heights on a grid that repeats, linear between its samples."""

    kind: Literal["map"]
    path: str = Field(description="a .npy of heights, or a picture; relative to the scene file")
    cell: Spacing = Field(description="distance of samples [m]")
    scale: Annotated[float, Bounds(unit="m", above=0)] = Field(
        default=1.0, description="metres per unit of the file; for a picture the height of its brightest value [m]"
    )

    def make(self, folder: Path) -> Texture:
        """Return the texture; its path is relative to ``folder``."""
        return HeightMap(heights=folder / self.path, cell=self.cell, scale=self.scale)


class SpectrumTable(Table):
    """A sum of waves."""

    kind: Literal["spectrum"]
    amplitudes: tuple[Height, ...] = Field(min_length=1, description="amplitude of each wave [m]")
    wavelengths: tuple[Spacing, ...] = Field(min_length=1, description="wavelength of each wave [m]")
    angles: tuple[Number, ...] | None = Field(
        default=None, description="direction of each wave [rad]; default: drawn with the seed"
    )
    phases: tuple[Number, ...] | None = Field(
        default=None, description="phase of each wave at the body's origin [rad]; default: drawn with the seed"
    )
    seed: Whole = Field(default=0, description="seed of the directions and phases that are drawn")

    def make(self, folder: Path) -> Texture:
        """Return the texture."""
        return HeightSpectrum(**self.model_dump(exclude={"kind"}))


TextureTable = Annotated[MapTable | SpectrumTable, Field(discriminator="kind")]
