"""Dilation for taxels in any layout: each taxel sums over those in contact, offsets projected on its own tangent plane.

The pressed taxels are listed chunk by chunk, in a fixed order, so that the sums skip the others and are reproducible.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.active_groups import active_groups
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Context
from tactemu.sensors.elastomer.dilation_kernels import DilationArrays, DilationOptions, radial_weight

CHUNK = 64
"""Number of taxels that one thread searches for pressed ones."""
_MAX_ESTIMATED_TAXELS = 20_000
"""Maximum number of taxels whose areas are estimated; bounds memory and time, which grow with its square."""


def free_spacing(positions: np.ndarray) -> float:
    """Return Genesis' length for layouts that are no grid: root of the area per taxel of the bounding box [m].

    The area is the product of the two largest extents, or the square of the largest if the second is nearly zero.
    """
    longest, second = sorted(np.ptp(positions, axis=0), reverse=True)[:2]
    area = longest * (second if second > 1e-12 else longest)
    return float(np.sqrt(area / len(positions))) if area > 0 else 1.0


def free_areas(positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the area of skin that each taxel stands for [m^2], from the density of taxels around it, shape ``(n,)``.

    The density is a Gaussian average over 0.8 of the distance between neighbours: exact to 1e-4 inside a regular
    layout; at its border it is up to half as large again, since the skin is assumed to continue.

    Raises:
        SceneError: the layout has too many taxels for this estimate.
    """
    n = len(positions)
    if n > _MAX_ESTIMATED_TAXELS:
        raise SceneError(
            f"area_weighted: {n} taxels in a free layout; give taxel_area= for more than {_MAX_ESTIMATED_TAXELS}"
        )
    if n == 1:
        return np.ones(1)
    squared = np.empty((n, n))
    for i in range(n):
        offset = positions - positions[i]
        squared[i] = np.square(offset - (offset @ normals[i])[:, None] * normals[i]).sum(axis=1)
    nearest = np.sqrt(np.median(np.min(squared + np.diag(np.full(n, np.inf)), axis=1)))
    variance = (0.8 * nearest) ** 2
    return 2.0 * np.pi * variance / np.exp(-0.5 * squared / variance).sum(axis=1)


@functools.cache
def taxels_type(real):
    """Return the Warp struct of the taxels, which do not change from step to step."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Taxels:
        positions: wp.array(dtype=vec3)
        normals: wp.array(dtype=vec3)
        areas: wp.array(dtype=real)
        is_sensing: wp.array(dtype=wp.bool)

    return Taxels


@functools.cache
def pressed_type(real):
    """Return the Warp struct of the depths and of the list of pressed taxels, chunk by chunk."""

    @wp.struct
    class Pressed:
        depth: wp.array2d(dtype=real)
        power: wp.array2d(dtype=real)  # depth ** normal_exponent
        n_pressed: wp.array2d(dtype=wp.int32)  # of each chunk
        pressed: wp.array2d(dtype=wp.int32)  # their indices, from place chunk * CHUNK
        n_active: wp.array(dtype=wp.int32)  # chunks with pressed taxels
        active: wp.array2d(dtype=wp.int32)

    return Pressed


@functools.cache
def weights_type(real):
    """Return the Warp struct of the weights of pressed taxels (:class:`~.dilation_kernels.RadialWeight`)."""

    @wp.struct
    class Weights:
        scale: real
        lambda_d: real
        gaussian: real
        far: real
        eps: real
        table: wp.array(dtype=real)
        table_step: real

    return Weights


@functools.cache
def _kernels(real, quick: bool):
    """Return the kernels that list pressed taxels and sum over them; ``quick`` selects a GPU's short exponential and
    quotient, accurate to 1e-6."""
    taxels_struct, pressed_struct, weights_struct = taxels_type(real), pressed_type(real), weights_type(real)
    vec3 = wp.types.vector(3, real)

    @warp_kernel
    def list_pressed(first_env: int, found: pressed_struct):
        env, chunk = wp.tid()
        env += first_env
        first = chunk * CHUNK
        count = int(0)
        for j in range(first, wp.min(first + CHUNK, found.depth.shape[1])):
            if not (found.depth[env, j] <= real(0.0)):
                found.pressed[env, first + count] = j
                count += 1
        found.n_pressed[env, chunk] = count

    @warp_kernel(module_options={"fast_math": quick})
    def sum_pressed(
        first_env: int,
        found: pressed_struct,
        taxels: taxels_struct,
        weights: weights_struct,
        motion: wp.array2d(dtype=vec3),
    ):
        env, i = wp.tid()
        env += first_env
        r = taxels.positions[i]
        n = taxels.normals[i]
        plane = vec3(real(0.0))
        bulge = real(0.0)
        if taxels.is_sensing[i]:
            for a in range(found.n_active[env]):
                chunk = found.active[env, a]
                first = chunk * CHUNK
                for slot in range(first, first + found.n_pressed[env, chunk]):
                    j = found.pressed[env, slot]
                    o = r - taxels.positions[j]
                    o -= wp.dot(o, n) * n
                    squared = wp.dot(o, o)
                    g = wp.exp(-weights.lambda_d * squared)
                    w = weights.gaussian * g
                    if weights.far != real(0.0):
                        if weights.table.shape[0] > 0:
                            x = wp.sqrt(squared) / weights.table_step
                            k = wp.min(int(x), weights.table.shape[0] - 2)
                            w += weights.far * wp.lerp(weights.table[k], weights.table[k + 1], x - real(k))
                        else:
                            w += weights.far / (squared + weights.eps * weights.eps)
                    plane += found.depth[env, j] * taxels.areas[j] * w * o
                    bulge += found.power[env, j] * taxels.areas[j] * g
        motion[env, i] = weights.scale * (plane + bulge * n)

    return list_pressed, sum_pressed


def direct_dilation(
    context: Context,
    options: DilationOptions,
    *,
    host_positions: np.ndarray,
    areas: np.ndarray,
    scale: float,
    arrays: DilationArrays,
    positions: wp.array,
    normals: wp.array,
) -> Callable[[], None]:
    """Record the sums.

    Args:
        host_positions: positions of the taxels [m], shape ``(n_taxels, 3)``.
        areas: weight of each taxel, shape ``(n_taxels,)``: areas [m^2], or ones.
        scale: factor on the motion (``dilate_scale``).
        arrays: the input and the output.
        positions: ``host_positions`` on the device.
        normals: unit normals on the device.
    """
    real, device, n_envs = context.real, context.device, context.n_envs
    n = len(host_positions)
    n_chunks = -(-n // CHUNK)
    reach = float(np.linalg.norm(np.ptp(host_positions, axis=0))) + 1e-9
    weight = radial_weight(options, free_spacing(host_positions), reach)
    found, taxels, weights = pressed_type(real)(), taxels_type(real)(), weights_type(real)()
    found.depth, found.power = arrays.depth, arrays.power
    found.n_pressed = context.zeros((n_envs, n_chunks), wp.int32)
    found.pressed = context.zeros((n_envs, n_chunks * CHUNK), wp.int32)
    groups, list_chunks = active_groups(context, found.n_pressed)
    found.n_active, found.active = groups.n_active, groups.active
    taxels.positions, taxels.normals, taxels.is_sensing = positions, normals, arrays.is_sensing
    taxels.areas = wp.array(areas, dtype=real, device=device)
    weights.scale, weights.lambda_d = scale, options.lambda_d
    weights.gaussian, weights.far, weights.eps = weight.gaussian, weight.far, weight.eps
    table = np.zeros(0) if weight.table is None else weight.table
    weights.table, weights.table_step = wp.array(table, dtype=real, device=device), weight.table_step
    list_pressed, sum_pressed = _kernels(real, not device.is_cpu)
    first = context.record(list_pressed, (n_envs, n_chunks), [found], [])
    second = context.record(sum_pressed, (n_envs, n), [found, taxels, weights], [arrays.motion])
    return in_turn(first, list_chunks, second)
