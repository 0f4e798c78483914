"""Textures: heights of a body's surface above its smooth shape, as a map that repeats or as a sum of waves.

To first order a texture of height ``h`` changes the signed distance ``d`` of a point by its height where the nearest
point of the smooth surface lies, and moves the place where a line enters the body along the line::

    d_textured(p) = d(p) − h(p − d n)             n: the normal of the smooth shape, out of it
    s_textured = s − h / cos θ                    θ: between the line and −n; h where the line meets the texture

Normals stay those of the smooth shape, and so does its outline. Both expressions are exact on a flat face, along its
normal. Elsewhere a distance ``D`` from a texture of slope ``g`` is wrong by up to ``D g² / 2``, since the nearest point
of the texture is another, and on a body of radius ``r`` by ``h² / (2 r)``.

The heights are a function of two coordinates: those of the point along the body's axes, without the axis along which
the normal points. Between axes the three functions are blended by the squares of the normal's components::

    h(x) = n_x² f(y, z) + n_y² f(z, x) + n_z² f(x, y)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tactemu.base.errors import SceneError, reason_of
from tactemu.base.option_groups import Options
from tactemu.base.options import numbers
from tactemu.base.units import Length, Whole

MAX_SAMPLES = 1 << 24
"""Maximum number of heights of a map; bounds memory at 64 MiB in float32."""
MAX_WAVES = 256
"""Maximum number of waves of a spectrum; each costs a cosine wherever a height is computed."""
PICTURES = (".png", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm")
"""Suffixes of files that are read as pictures."""


class TextureRow(NamedTuple):
    """One body's texture in the form that kernels read."""

    values: np.ndarray
    """Heights of a map [m], ``(rows, columns)``, or for each wave cycles per metre along both axes, cycles at the
    origin and amplitude [m], ``(count, 4)``."""
    is_map: bool
    step: float
    """Distance of the heights of a map [m]."""
    peak: float
    """Largest absolute height [m]."""
    slope: float
    """An upper bound of the slope."""


class Texture(Options):
    """The base class of textures."""

    kind: ClassVar[str]
    """The name of the texture in scene files."""

    def __post_init__(self) -> None:
        super().__post_init__()
        assert self.row  # a wrong option is an error here, not when the scene is built

    @cached_property
    def row(self) -> TextureRow:
        """The texture in the form that kernels read.

        Raises:
            SceneError: a file cannot be read, or has heights that cannot be used.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightMap(Texture):
    """Heights on a grid that repeats in both directions, linear between its samples. A wave of ``n`` samples is read
    with an error of up to ``5 / n²`` of its amplitude."""

    heights: np.ndarray | str | Path
    """Heights out of the body ``[i, j]`` at ``(i * cell, j * cell)``, an array or the file of one: ``.npy``, or a
    picture, whose rows are the first index and whose brightest value (255, or 65535 with 16 bits) is 1."""
    cell: Length
    """Distance of samples [m]."""
    scale: Length = 1.0
    """Metres per unit of ``heights``; for a picture the height of its brightest value."""

    kind = "map"

    @cached_property
    def row(self) -> TextureRow:
        given = _picture(Path(self.heights)) if isinstance(self.heights, str | Path) else self.heights
        heights = numbers("HeightMap", "heights", given) * self.scale
        if heights.ndim != 2 or not 1 <= heights.size <= MAX_SAMPLES:
            raise SceneError(
                f"HeightMap: heights must have shape (rows, columns), at most {MAX_SAMPLES} samples, "
                f"got shape {heights.shape}"
            )
        steps = [np.abs(np.roll(heights, 1, axis) - heights).max() for axis in (0, 1)]
        slope = float(np.hypot(*steps)) / self.cell
        return TextureRow(heights, True, float(self.cell), float(np.abs(heights).max()), slope)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightSpectrum(Texture):
    """A sum of waves ``amplitude cos(2 π (u cos angle + v sin angle) / wavelength + phase)``, exact everywhere."""

    amplitudes: Sequence[float]
    """Amplitude of each wave [m]."""
    wavelengths: Sequence[float]
    """Wavelength of each wave [m], > 0."""
    angles: Sequence[float] | None = None
    """Direction of each wave [rad], from the first of the two coordinates to the second; ``None``: drawn."""
    phases: Sequence[float] | None = None
    """Phase of each wave at the body's origin [rad]; ``None``: drawn."""
    seed: Whole = 0
    """Seed of the directions and phases that are drawn."""

    kind = "spectrum"

    @cached_property
    def row(self) -> TextureRow:
        amplitudes, wavelengths = (self._each(name, getattr(self, name)) for name in ("amplitudes", "wavelengths"))
        if not (wavelengths > 0).all():
            raise SceneError(f"HeightSpectrum: wavelengths must be > 0 m, got {self.wavelengths!r}")
        drawn = np.random.default_rng(int(self.seed)).uniform(0.0, 2 * np.pi, (2, len(amplitudes)))
        angles = drawn[0] if self.angles is None else self._each("angles", self.angles)
        phases = drawn[1] if self.phases is None else self._each("phases", self.phases)
        waves = [np.cos(angles) / wavelengths, np.sin(angles) / wavelengths, phases / (2 * np.pi), amplitudes]
        slope = float(np.sum(2 * np.pi * np.abs(amplitudes) / wavelengths))
        return TextureRow(np.stack(waves, axis=1), False, 1.0, float(np.abs(amplitudes).sum()), slope)

    def _each(self, name: str, value: Any) -> np.ndarray:
        array = np.atleast_1d(numbers("HeightSpectrum", name, value))
        if array.shape != np.shape(self.amplitudes) or not 1 <= array.size <= MAX_WAVES:
            raise SceneError(
                f"HeightSpectrum: {name} must have one number for each of 1 to {MAX_WAVES} amplitudes, got {value!r}"
            )
        return array


TEXTURES: dict[str, type[Texture]] = {each.kind: each for each in (HeightMap, HeightSpectrum)}
"""The textures of scene files, by their kinds."""


def _picture(path: Path) -> np.ndarray:
    """Return the heights in a file: those of an array, or the brightness of a picture from 0 to 1.

    Raises:
        SceneError: the file cannot be read.
    """
    try:
        if path.suffix.lower() not in PICTURES:
            try:
                heights = np.load(
                    path, allow_pickle=False, mmap_mode="r"
                )  # so that its size is known before it is read
            except ValueError:
                heights = None
            if not isinstance(heights, np.ndarray):
                raise ValueError("it is no array of numbers")
            if heights.size > MAX_SAMPLES:
                raise SceneError(f"texture {path}: heights have at most {MAX_SAMPLES} samples, got {heights.shape}")
            return np.array(heights)
        try:
            from PIL import Image  # an optional library, which plots need as well
        except ImportError:
            raise SceneError(f"texture {path}: pictures need Pillow: pip install 'tactemu[plots]'") from None
        try:
            picture = Image.open(path)
        except Image.DecompressionBombError:
            raise SceneError(f"texture {path}: a picture has at most {MAX_SAMPLES} pixels") from None
        with picture:
            if picture.width * picture.height > MAX_SAMPLES:
                raise SceneError(f"texture {path}: a picture has at most {MAX_SAMPLES} pixels, got {picture.size}")
            brightest = 65535.0 if picture.mode.startswith("I") else 255.0
            return np.asarray(picture if picture.mode.startswith("I") else picture.convert("L"), float) / brightest
    except (OSError, ValueError, EOFError) as error:
        raise SceneError(
            f"texture {path}: cannot read it: {reason_of(error)}; expected .npy or {', '.join(PICTURES)}"
        ) from None
