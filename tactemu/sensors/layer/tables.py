"""The layer's kernels as the solvers use them: spectra for every size of window, in one array per kernel.

Everything is dimensionless: lengths in pitches, pressures relative to the one that presses a single cell in by one
pitch. A scene of nanometres and one of kilometres give the solvers the same numbers.
"""

# pyright: reportArgumentType=false

import functools
from typing import NamedTuple

import numpy as np
import warp as wp

from tactemu.sensors.layer.block import SMALLEST_TRANSFORM
from tactemu.sensors.layer.compliance import sample_kernels, spectrum, transfer
from tactemu.sensors.layer.soft_object import add_object

HARTLEY_GAIN = 16.0
"""Gain of a convolution's transforms: a factor of two per pass, four passes."""

_ODD = {"nn": (False, False), "xx": (False, False), "yy": (False, False), "xy": (True, True)}
_ODD |= {"nx": (False, True), "ny": (True, False)}
COMPLIANCES = tuple(_ODD)
"""Spectra of displacements by loads; those after the first are built for tangential loads."""
INVERSES = ("soften", "soften_x", "soften_y")
"""Spectra of preconditioners, likewise."""


@functools.cache
def tables_type(real):
    """Return the Warp struct of the spectra."""

    @wp.struct
    class Tables:
        start: wp.array2d(dtype=wp.int32)  # [level of rows, level of columns] -> first number of the spectrum
        nn: wp.array(dtype=real)  # displacement into the skin by pressure
        soften: wp.array(dtype=real)  # its approximate inverse, the preconditioner
        xx: wp.array(dtype=real)  # tangential displacement by traction
        yy: wp.array(dtype=real)
        xy: wp.array(dtype=real)
        soften_x: wp.array(dtype=real)
        soften_y: wp.array(dtype=real)
        nx: wp.array(dtype=real)  # tangential displacement by pressure
        ny: wp.array(dtype=real)

    return Tables


@functools.cache
def layer_type(real):
    """Return the Warp struct of a layer and of its solvers' options."""

    @wp.struct
    class Layer:
        tables: tables_type(real)
        bulge: real  # rise of the skin beside a contact, as a share of the deepest overlap
        friction: real  # coefficient of friction, of a cell that sticks
        kinetic: real  # coefficient of a cell that has slipped by slip_distance; used if it is another
        slip_distance: real  # [pitches]
        cap: wp.int32  # most iterations of a solver
        tolerance: wp.float64  # residual at which a solver stops
        reach: wp.vec2i  # cells over which a load moves the surface, along rows and columns

    return Layer


class LayerMaterial(NamedTuple):
    """The material of an elastic layer on a rigid base, and of the objects that press on it."""

    shear_modulus: float
    """Shear modulus [Pa]."""
    poisson_ratio: float
    """Poisson's ratio, 0 to 0.5."""
    thickness: float
    """Thickness [m], > 0; ``inf``: a half-space."""
    object_ratio: float = 0.0
    """Shear modulus of the layer over that of the objects; 0: rigid objects."""
    object_poisson_ratio: float = 0.5
    """Poisson's ratio of the objects, 0 to 0.5."""
    object_radius: float = np.inf
    """Radius of the objects [m], which are balls; ``inf``: half-spaces."""


class LayerTables:
    """The spectra of a layer for windows of up to ``cells`` on a grid of ``pitch``.

    Args:
        material: the layer.
        cells: size ``(ny, nx)`` of the largest window.
        pitch: distance of neighbours ``(dy, dx)`` [m].
        tangential: build the tangential kernels too.
        unit_compliance: displacement of a cell by a pressure on it that is the unit [m/Pa]; default: the layer's own.
    """

    def __init__(self, material: LayerMaterial, cells, pitch, *, tangential: bool, real, device, unit_compliance=None):
        self.sizes = tuple(_transform_sizes(n) for n in cells)
        self.n_max = max(sizes[-1] for sizes in self.sizes)
        shape = tuple(sizes[-1] // 2 + 1 for sizes in self.sizes)
        self.kernels = kernels = sample_kernels(shape, pitch, *material)
        self.length_scale = float(min(pitch))
        """Unit of length of the solvers, one pitch [m]."""
        self.unit_compliance = float(kernels.nn[0, 0]) if unit_compliance is None else unit_compliance
        self.pressure_scale = self.length_scale / self.unit_compliance
        """Unit of pressure of the solvers [Pa]."""
        self.material, self.pitch = material, pitch
        unit = 1.0 / self.unit_compliance
        self.struct = tables_type(real)()
        self.struct.start = wp.array(self._starts(), dtype=wp.int32, device=device)
        for name in COMPLIANCES if tangential else COMPLIANCES[:1]:
            kernel = getattr(kernels, name) * unit
            flat = self._every_size(lambda n, kernel=kernel, odd=_ODD[name]: spectrum(kernel, n, odd))
            self._store(name, flat, real, device)
        for name in INVERSES if tangential else INVERSES[:1]:
            flat = self._every_size(lambda n, name=name: 1.0 / (unit * self._compliance(n, name)))
            self._store(name, flat, real, device)

    def _starts(self) -> np.ndarray:
        lengths = [[ny * nx for nx in self.sizes[1]] for ny in self.sizes[0]]
        return (np.cumsum(np.ravel(lengths)) - np.ravel(lengths)).reshape(np.shape(lengths))

    def _every_size(self, factors) -> np.ndarray:
        parts = []
        for ny in self.sizes[0]:
            for nx in self.sizes[1]:
                parts.append(np.ravel(factors((ny, nx))) / (HARTLEY_GAIN * ny * nx))
        return np.concatenate(parts)

    def _store(self, name: str, flat: np.ndarray, real, device) -> None:
        setattr(self.struct, name, wp.array(flat, dtype=real, device=device))

    def _compliance(self, shape, name: str) -> np.ndarray:
        """Return the compliance at the wave numbers of a transform [m/Pa]; the mean takes that at half the lowest wave
        number."""
        (ny, nx), (dy, dx) = shape, self.pitch
        shear_modulus, nu, thickness, object_ratio, object_nu, _radius = self.material
        ky = 2 * np.pi * np.fft.fftfreq(ny, dy)[:, None]
        kx = 2 * np.pi * np.fft.fftfreq(nx, dx)[None, :]
        k = np.hypot(kx, ky)
        k[0, 0] = np.pi * min(1 / (ny * dy), 1 / (nx * dx))
        modes = add_object(transfer(k * thickness, nu), object_ratio, object_nu)
        if name == "soften":
            return modes.nn / (shear_modulus * k)
        along = (kx if name == "soften_x" else ky) / k
        return 1.0 / ((along**2 / modes.ll + (1 - along**2) / modes.tt) * shear_modulus * k)


def _transform_sizes(cells: int) -> list[int]:
    """Return the powers of two from the smallest transform to the one that holds a window of ``cells`` without
    wrapping."""
    sizes = [SMALLEST_TRANSFORM]
    while sizes[-1] < 2 * cells:
        sizes.append(2 * sizes[-1])
    return sizes
