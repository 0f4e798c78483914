"""Magnetic transducers: dipoles that move with the skin, and their field at every chip (AnySkin, eFlesh, uSkin).

With the position ``x_j`` of magnet j, its moment ``m_j``, and the displacement ``u_i`` of the skin at taxel i::

    u_i = c F_i                              c compliance; the model's own u_i if it provides displacement
    x_j = x_j⁰ + Σ_i w_ij u_i          w_ij = g_ij / max(1, Σ_i g_ij), g_ij = exp(−|x_j⁰ − x_i|²/2s²), 0 beyond 4 s
    B_k = µ0/4π Σ_j (3 (m_j·r) r/|r|⁵ − m_j/|r|³) + R⁻¹ B_earth + neighbours,   r = chip_k − x_j

A chip lies ``chip_depth`` below each taxel. All chips measure the field of all magnets, which causes crosstalk. Magnets
far from every taxel do not move with the skin. A magnet is a ball of 1e6 A/m: outside, its field is the dipole's;
inside, it is ``µ0/4π 2 m/a³`` with the ball's radius ``a``. Neighbours are dipoles fixed to other bodies, which move
with those; the earth's field turns in the link's frame as the link does.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import warp as wp

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError, no_such, shown
from tactemu.base.kernels import warp_kernel
from tactemu.base.options import numbers, triple
from tactemu.base.units import Length, NonNegative
from tactemu.plan.plan import Stage
from tactemu.transducers.transducer import FIELD, SignalType, Transducer, TransducerSite

REACH_SPREADS = 4.0
"""The distance from which on a taxel does not move a magnet, in multiples of ``spread``."""
MAGNETISATION_A_PER_M = 1e6
"""The magnetisation of a magnet, about that of neodymium; it determines the size of a magnet of a given moment."""
MAX_GRID_SIDE = 256
"""Most magnets along a side of ``grid``; bounds memory."""
GridSide = Annotated[int, Bounds(low=1, high=MAX_GRID_SIDE)]


def radius_of(moments: np.ndarray) -> np.ndarray:
    """Return the radius [m] of the ball of :data:`MAGNETISATION_A_PER_M` that has each moment, shape ``(m,)``."""
    return np.cbrt(np.linalg.norm(moments, axis=-1) * 3 / (4 * np.pi * MAGNETISATION_A_PER_M))


@functools.cache
def magnets_type(real):
    """Return the Warp struct of the magnets in the skin, and of those fixed to other bodies."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Magnets:
        unloaded: wp.array(dtype=vec3)  # positions without a load
        taxels: wp.array2d(dtype=wp.int32)  # that move each magnet
        shares: wp.array2d(dtype=real)  # of their displacement
        places: wp.array2d(dtype=vec3)  # positions, (n_envs, n_magnets)
        moments: wp.array(dtype=vec3)
        radii: wp.array(dtype=real)
        bodies: wp.array(dtype=wp.int32)  # of the other magnets
        other_places: wp.array(dtype=vec3)
        other_moments: wp.array(dtype=vec3)
        other_radii: wp.array(dtype=real)

    return Magnets


@functools.cache
def move_kernel(real):
    """Return the kernel that computes the positions of the magnets."""
    vec3, magnets_struct = wp.types.vector(3, real), magnets_type(real)

    @warp_kernel
    def move_magnets(first_env: int, moved: wp.array3d(dtype=real), magnets: magnets_struct):
        e, j = wp.tid()
        e += first_env
        x = magnets.unloaded[j]
        for k in range(magnets.taxels.shape[1]):
            i = magnets.taxels[j, k]
            w = magnets.shares[j, k]
            if w != real(0.0):
                x += w * vec3(moved[e, i, 0], moved[e, i, 1], moved[e, i, 2])
        magnets.places[e, j] = x

    return move_magnets


@functools.cache
def field_kernel(real, earth: bool, neighbours: bool):
    """Return the kernel that computes the field at the chips."""
    vec3, transform, magnets_struct = wp.types.vector(3, real), wp.types.transformation(real), magnets_type(real)

    @wp.func
    def dipole(r: vec3, m: vec3, radius: real):
        square = wp.dot(r, r)
        if square < radius * radius:
            return real(2.0) / (radius * radius * radius) * m
        near = real(1.0) / (square * wp.sqrt(square))
        return near * (real(3.0) * wp.dot(m, r) / square * r - m)

    @warp_kernel
    def fields_at_chips(
        first_env: int,
        magnets: magnets_struct,
        chips: wp.array(dtype=vec3),
        world: wp.array3d(dtype=wp.float64),
        link: int,
        earth_field: wp.vec3d,
        pose: wp.array2d(dtype=transform),
        field: wp.array3d(dtype=real),
    ):
        e, k = wp.tid()
        e += first_env
        chip = chips[k]
        total = vec3(real(0.0))
        for j in range(magnets.moments.shape[0]):
            total += dipole(chip - magnets.places[e, j], magnets.moments[j], magnets.radii[j])
        if wp.static(neighbours):
            for j in range(magnets.bodies.shape[0]):
                at = pose[e, magnets.bodies[j]]
                place = wp.transform_point(at, magnets.other_places[j])
                total += dipole(chip - place, wp.transform_vector(at, magnets.other_moments[j]), magnets.other_radii[j])
        if wp.static(earth):
            q = wp.quatd(world[e, link, 4], world[e, link, 5], world[e, link, 6], world[e, link, 3])
            b = wp.quat_rotate_inv(wp.normalize(q), earth_field)
            total += vec3(real(b[0]), real(b[1]), real(b[2]))
        for axis in range(3):
            field[e, k, axis] = total[axis]

    return fields_at_chips


@dataclass(frozen=True, kw_only=True)
class Magnetic(Transducer):
    """A transducer that provides the field at each chip [T], one chip below each taxel."""

    magnets: Sequence = ()
    """Positions of the magnets in the unloaded skin [m], ``(m, 3)``, in the link's frame, or with ``about_taxels``
    relative to the middle of the taxels; empty: a grid over the taxels."""
    moments: Sequence = ((0.0, 0.0, 2e-4),)
    """Moments of the magnets [A m²], ``(m, 3)``, or one for all."""
    about_taxels: bool = True
    """Positions are relative to the middle of the taxels."""
    grid: tuple[GridSide, GridSide] = (10, 10)
    """Rows and columns of magnets if ``magnets`` is empty, on a sheet ``1.5`` times as wide as the taxels."""
    chip_depth: Annotated[float, Bounds(unit="m", low=0)] = 2e-3
    """Distance of a chip below its taxel, against the normal [m]."""
    compliance: NonNegative = 1e-4
    """Displacement of the skin per force on a taxel [m/N], for a model that provides force."""
    spread: Length = 4e-3
    """Standard deviation of the Gaussian by which a taxel's displacement moves the magnets around it [m]."""
    earth: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Field of the earth in the world [T]; its magnitude is about 50e-6."""
    neighbours: Sequence[Any] = ()
    """Magnets on other bodies: ``(body, (x, y, z), (mx, my, mz))``, in that body's frame [m, A m²]."""

    takes = ("displacement", "force")
    valid = (
        "Chips outside the magnets, each a ball of 1e6 A/m. Magnets keep their direction as the skin tilts, and "
        "the skin between taxels follows them by a Gaussian."
    )
    source = "Field of a point dipole. Skins: AnySkin (arXiv:2409.08276), eFlesh (arXiv:2506.09994)."

    def check(self, where: str) -> None:
        for name in ("magnets", "moments"):
            given = numbers(where, name, getattr(self, name))
            if given.shape != (0,) and (given.ndim != 2 or given.shape[1] != 3):
                raise SceneError(f"{where}: {name} must be a list of three numbers each, got shape {given.shape}")
        for each in self.neighbours:
            if not isinstance(each, Sequence) or len(each) != 3 or not isinstance(each[0], str):
                raise SceneError(f"{where}: neighbours must be (body, place, moment) each, got {shown(each)}")
            for vector in each[1:]:
                triple(where, f"neighbours of {each[0]!r}", vector)
        if not len(self.moments):
            raise SceneError(f"{where}: moments must be one for all, or one for each magnet; there is none")
        n = len(self.magnets) or round(self.grid[0] * self.grid[1])
        if len(self.moments) not in (1, n):
            raise SceneError(f"{where}: {len(self.moments)} moments for {n} magnets; one, or one each")

    def gives(self, taken: SignalType) -> SignalType:
        return FIELD

    def places(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and moments of all magnets of the unloaded skin in the link's frame.

        ``positions`` are those of the taxels.
        """
        middle = positions.mean(axis=0)
        if len(self.magnets):
            places = np.asarray(self.magnets, float) + (middle if self.about_taxels else 0.0)
        else:
            reach = 0.75 * np.maximum(np.ptp(positions, axis=0), 1e-3)
            x, y = (np.linspace(-reach[k], reach[k], n) for k, n in enumerate(self.grid))
            places = middle + np.array([(a, b, 0.0) for a in x for b in y])
        return places, np.broadcast_to(np.asarray(self.moments, float), places.shape).copy()

    def shares(self, places: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the taxels that move each magnet, nearest first, and the share of each one's displacement.

        Both have shape ``(m, k)``, with as many columns as any magnet needs.
        """
        apart = np.linalg.norm(places[:, None] - positions[None], axis=-1)
        most = max(1, int((apart <= REACH_SPREADS * self.spread).sum(axis=1).max(initial=0)))
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :most]
        away = np.take_along_axis(apart, nearest, axis=1)
        weights = np.where(away <= REACH_SPREADS * self.spread, np.exp(-0.5 * (away / self.spread) ** 2), 0.0)
        # A magnet between taxels moves in full, one far from all taxels not at all.
        total = np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
        return nearest.astype(np.int32), weights / total

    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        context, real = site.context, site.context.real
        vec3 = wp.types.vector(3, real)
        unloaded, moments = self.places(site.positions)
        taxels, shares = self.shares(unloaded, site.positions)
        factor = self.compliance if taken.quantity == "force" else 1.0
        magnets, per_moment = magnets_type(real)(), 1e-7  # µ0/4π
        magnets.unloaded, magnets.taxels = site.constant(unloaded, vec3), site.constant(taxels, wp.int32)
        magnets.shares, magnets.radii = site.constant(shares * factor), site.constant(radius_of(moments))
        magnets.moments = site.constant(per_moment * moments, vec3)
        magnets.places = wp.zeros((context.n_envs, len(unloaded)), dtype=vec3, device=context.device)
        bodies, other_places, other_moments = self._others(site)
        magnets.bodies, magnets.other_radii = site.constant(bodies, wp.int32), site.constant(radius_of(other_moments))
        magnets.other_places = site.constant(other_places, vec3)
        magnets.other_moments = site.constant(per_moment * other_moments, vec3)
        move = context.record(move_kernel(real), magnets.places.shape, [x, magnets], [])
        field = site.zeros(3)
        chips = site.positions - self.chip_depth * site.normals
        kernel = field_kernel(real, any(self.earth), bool(len(self.neighbours)))
        inputs = [magnets, site.constant(chips, vec3), site.world, site.link, wp.vec3d(*self.earth), site.pose]
        launch = context.record(kernel, field.shape[:2], inputs, [field])
        why = f"{len(unloaded)} dipoles at {len(chips)} chips"
        return field, [
            Stage(name=f"{site.name}: magnets", reason="they move with the skin", launch=move),
            Stage(name=f"{site.name}: field", reason=why, launch=launch, cheaper="fewer magnets"),
        ]

    def _others(self, site: TransducerSite) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        for body, *_ in self.neighbours:
            if body not in site.bodies:
                raise SceneError(f"sensor {site.name!r}: neighbours: {no_such('body', body, site.bodies, 'bodies')}")
        at = np.array([each[1] for each in self.neighbours], float).reshape(-1, 3)
        moments = np.array([each[2] for each in self.neighbours], float).reshape(-1, 3)
        return np.array([site.bodies[each[0]] for each in self.neighbours], np.int32), at, moments
