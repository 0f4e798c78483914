"""The reading of each taxel: averages over its cells, in SI units and the link's frame."""

# pyright: reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.coalesced import row_writer
from tactemu.imperfections.info import Channels
from tactemu.plan.scalars import is_nan, natural
from tactemu.sensors.layer.friction_state import FREE, SLIP, STICK, friction_state_type
from tactemu.sensors.layer.pressure import pressure_state_type
from tactemu.sensors.layer.surface import surface_type

CHANNELS: tuple[Channels, ...] = ("scalar", "force", "displacement", "scalar", "scalar")
"""The channels of a taxel: pressure, force, displacement, slip state, residual."""
PRESSURE = slice(0, 1)
FORCE = slice(1, 4)
DISPLACEMENT = slice(4, 7)
SLIP_STATE = 7
RESIDUAL = 8
N_CHANNELS = 9


@functools.cache
def skin_type(real):
    """Return the Warp struct of the axes and units of a layer's grid."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Skin:
        u: vec3
        v: vec3
        normal: vec3
        length: real  # one pitch of cells [m]
        pressure: real  # unit of the solvers' pressures [Pa]
        area: real  # area of a taxel [m²]
        columns: wp.int32  # columns of taxels
        split: wp.int32
        place: wp.array(dtype=wp.int32)  # place of each taxel in the grid; -1: a filler
        axes: wp.array2d(dtype=vec3)  # u, v and n of each taxel of a bent skin

    return Skin


@functools.cache
def reading_kernel(real, with_surface: bool, with_friction: bool, is_bent: bool = False):
    """Return the kernel that averages all quantities over each taxel, with the larger residual of the two solvers."""
    vec3 = wp.types.vector(3, real)
    skin_struct, surface_struct = skin_type(real), surface_type(real)
    pressed_struct, friction_state = pressure_state_type(real), friction_state_type(real)
    row_type, write = wp.types.vector(N_CHANNELS, real), row_writer(real, N_CHANNELS)

    @warp_kernel
    def read_taxels(
        first_env: int,
        skin: skin_struct,
        pressed: pressed_struct,
        friction: friction_state,
        surface: surface_struct,
        reading_out: wp.array3d(dtype=real),
    ):
        env, taxel = wp.tid()
        env = natural(env + first_env)
        taxel = natural(taxel)
        place = skin.place[taxel]
        line = place // skin.columns
        row = line * skin.split
        column = (place - line * skin.columns) * skin.split
        box = pressed.dirty[env]
        changed = pressed.changed[env]
        if wp.static(with_friction):
            changed = friction.changed[env]
        wanted = place >= 0 and changed > 0
        wanted = wanted and row + skin.split > box[0] and row < box[0] + box[2]
        wanted = wanted and column + skin.split > box[1] and column < box[1] + box[3]
        values = row_type()
        if wanted:
            load = vec3(real(0.0))  # along u, v and into the skin
            moved = vec3(real(0.0))
            slip = int(FREE)
            y = row
            while y < row + skin.split:  # while loops: Warp's ranges take longer on a CPU
                y = natural(y)
                x = column
                while x < column + skin.split:
                    x = natural(x)
                    load[2] = load[2] + pressed.pressure[env, y, x]
                    if wp.static(with_friction):
                        load[0] = load[0] + friction.x[env, y, x]
                        load[1] = load[1] + friction.y[env, y, x]
                        state = friction.slip[env, y, x]
                        if state == STICK or (state == SLIP and slip == FREE):
                            slip = state
                    if wp.static(with_surface):
                        moved += vec3(surface.u[env, y, x], surface.v[env, y, x], surface.w[env, y, x])
                    x += 1
                y += 1
            share = real(1.0) / real(skin.split * skin.split)
            load *= share * skin.pressure
            moved *= share * skin.length
            worst = pressed.residual[env]
            if wp.static(with_friction):
                worst = wp.where(friction.residual[env] > worst, friction.residual[env], worst)
            if is_nan(worst):
                load = vec3(real(wp.nan))
                moved = vec3(real(wp.nan))
            u = skin.u
            v = skin.v
            n = skin.normal
            if wp.static(is_bent):
                u = skin.axes[0, taxel]
                v = skin.axes[1, taxel]
                n = skin.axes[2, taxel]
            force = skin.area * (load[0] * u + load[1] * v - load[2] * n)
            shift = moved[0] * u + moved[1] * v - moved[2] * n
            values[0] = load[2]
            for k in range(3):
                values[1 + k] = force[k]
                values[4 + k] = shift[k]
            values[wp.static(SLIP_STATE)] = real(slip)
            values[wp.static(RESIDUAL)] = real(worst)
        write(reading_out, env, taxel, values, wanted)

    return read_taxels


@functools.cache
def traction_kernel(real):
    """Return the kernel that computes the force per area along the surface from the force on each taxel."""
    vec3 = wp.types.vector(3, real)

    @warp_kernel
    def find_traction(
        reading: wp.array3d(dtype=real),
        normals: wp.array(dtype=vec3),
        areas: wp.array(dtype=real),
        traction_out: wp.array3d(dtype=real),
    ):
        env, taxel = wp.tid()
        first = wp.static(FORCE.start)
        force = vec3(reading[env, taxel, first], reading[env, taxel, first + 1], reading[env, taxel, first + 2])
        n = normals[taxel]
        along = (force - wp.dot(force, n) * n) / areas[taxel]
        for i in range(3):
            traction_out[env, taxel, i] = along[i]

    return find_traction


@functools.cache
def status_kernel(real):
    """Return the kernel that copies slip state and residual, which are no measurements, into a reading after
    imperfections."""

    @warp_kernel
    def copy_status(first_env: int, truth: wp.array3d(dtype=real), reading_out: wp.array3d(dtype=real)):
        env, taxel = wp.tid()
        env += first_env
        for channel in range(wp.static(SLIP_STATE), wp.static(RESIDUAL + 1)):
            reading_out[env, taxel, channel] = truth[env, taxel, channel]

    return copy_status
