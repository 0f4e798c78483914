"""The laws' coefficients that depend on time, computed once a step per sensor: a few float64 numbers on the device, and
the temperature of each environment."""

# pyright: reportIndexIssue=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections.material import decay, grown, ramp_share
from tactemu.imperfections.options import ChainOptions
from tactemu.plan.clock import Clock
from tactemu.plan.launches import record
from tactemu.plan.plan import Context, Stage

# Indices into the array of coefficients.
OVERSHOOT = wp.constant(0)
"""Share of the overshoot that remains after the step."""
UNDERSHOOT = wp.constant(1)
"""Share of the unloading's overshoot that remains after the step."""
CREEP = wp.constant(2)
"""Share of the remaining creep that the step completes under constant load."""
CREEP_RAMP = wp.constant(3)
"""Share of a linear change of load that creep has followed at the end of the step."""
NOISE = wp.constant(4)
"""Standard deviation of a sample per noise density [sqrt(Hz)]."""
WALK = wp.constant(5)
"""Share of a bounded walk that remains after the step."""
WALK_STEP = wp.constant(6)
"""Standard deviation of the walk's increment per density [sqrt(s)]."""
COUNT = 7
"""Number of coefficients."""


@functools.cache
def _kernel(material: bool, walk: bool, noise: bool, temperature: bool):
    f64 = wp.float64

    @warp_kernel
    def imperfection_coefficients(
        clock: Clock,
        taus: wp.vec4d,
        frames: wp.array2d(dtype=wp.float64),
        reference: wp.float64,
        out: wp.array(dtype=wp.float64),
        warmth: wp.array(dtype=wp.float64),
    ):
        e = wp.tid()
        if e == 0:
            dt = wp.max(clock.dt[0], f64(0.0))
            if wp.static(material):
                out[OVERSHOOT] = decay(dt, taus[0])
                out[UNDERSHOOT] = decay(dt, taus[1])
                h = wp.where(dt > f64(0.0), dt / taus[2], f64(0.0))
                out[CREEP] = grown(h)
                out[CREEP_RAMP] = ramp_share(h)
            if wp.static(noise):
                out[NOISE] = wp.where(dt > f64(0.0), wp.sqrt(f64(0.5) / dt), f64(0.0))
            if wp.static(walk):
                tau = taus[3]
                if tau > f64(0.0):
                    out[WALK] = decay(dt, tau)
                    out[WALK_STEP] = wp.sqrt(tau * f64(0.5) * grown(f64(2.0) * dt / tau))
                else:
                    out[WALK] = f64(1.0)
                    out[WALK_STEP] = wp.sqrt(dt)
        if wp.static(temperature):
            t = f64(clock.time_ns[0] - clock.began_ns[e]) * f64(1e-9)
            last = frames.shape[0] - 1
            k = int(0)
            while k < last and frames[k + 1, 0] < t:
                k += 1
            value = frames[k, 1]
            if k < last and t > frames[k, 0]:
                share = (t - frames[k, 0]) / (frames[k + 1, 0] - frames[k, 0])
                value = value + share * (frames[k + 1, 1] - value)
            warmth[e] = value - reference

    return imperfection_coefficients


def compile_coefficients(
    options: ChainOptions, laws: frozenset[str], name: str, context: Context
) -> tuple[tuple[wp.array | None, wp.array | None], list[Stage]]:
    """Return two arrays and the stage that fills them: the coefficients, and temperatures above the reference [K].

    Each environment has a temperature, of its own time; they share one that never changes. Where no law depends on
    time there are no arrays and no stage, and no temperatures where no law depends on them.
    """
    material = bool(laws & {"hysteresis", "creep"})
    walk, noise, temperature = "random_walk" in laws, "noise_density" in laws, "temperature" in laws
    if not (material or walk or noise or temperature):
        return (None, None), []
    out = context.zeros(COUNT, wp.float64)
    unloading = options.hysteresis_tau_unloading
    taus = wp.vec4d(
        options.hysteresis_tau,
        options.hysteresis_tau if unloading is None else unloading,
        options.creep_tau,
        options.random_walk_tau or 0.0,
    )
    frames = np.asarray(options.temperature_course if temperature else [(0.0, 0.0)], dtype=np.float64)
    warmth = context.zeros(context.n_envs if len(frames) > 1 else 1, wp.float64) if temperature else None
    launch = record(
        _kernel(material, walk, noise, temperature),
        1 if warmth is None else warmth.shape,
        [context.clock, taus, wp.array(frames, device=context.device), options.temperature_reference],
        [out, warmth],
        context.device,
    )
    return (out, warmth), [Stage(name=f"{name}: coefficients", reason="laws that depend on time", launch=launch)]
