"""The memory of the material: overshoot that relaxes, a loop that does not depend on the rate, and creep.

State is float64 in both float widths: with a time constant of an hour and steps of a millisecond a float32 state stalls
10 % short of its end. Each law is exact for the course of the input that it assumes, so that one step equals two half
steps. Two laws in a row are only nearly exact: hysteresis outputs a curve, which creep assumes to be straight within a
step.
"""

# pyright: reportReturnType=false

import warp as wp

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.func
def decay(dt: wp.float64, tau: wp.float64) -> wp.float64:
    """Return ``exp(-dt / tau)``; 1 if no time passes, 0 if there is no time constant."""
    if dt <= _ZERO:
        return _ONE
    if tau <= _ZERO:
        return _ZERO
    return wp.exp(-dt / tau)


@wp.func
def grown(h: wp.float64) -> wp.float64:
    """Return ``1 - exp(-h)`` without cancellation, for h >= 0."""
    if h > wp.float64(0.02):
        return _ONE - wp.exp(-h)
    inner = _ONE - h / wp.float64(4.0) * (_ONE - h / wp.float64(5.0) * (_ONE - h / wp.float64(6.0)))
    return h * (_ONE - h / wp.float64(2.0) * (_ONE - h / wp.float64(3.0) * inner))


@wp.func
def ramp_share(h: wp.float64) -> wp.float64:
    """Return ``1 - (1 - exp(-h)) / h``, the share of a linear ramp that a first-order lag has followed at its end."""
    if h > wp.float64(0.02):
        return _ONE - grown(h) / h
    inner = _ONE - h / wp.float64(5.0) * (_ONE - h / wp.float64(6.0))
    return h / wp.float64(2.0) * (_ONE - h / wp.float64(3.0) * (_ONE - h / wp.float64(4.0) * inner))


@wp.func
def rise(new: wp.float64, old: wp.float64) -> wp.float64:
    """Return the part of ``new - old`` that leads away from zero; ``new - old - rise`` leads towards it."""
    if new * old < _ZERO:
        return new
    if wp.abs(new) >= wp.abs(old):
        return new - old
    return _ZERO


@wp.func
def play(x: wp.float64, last: wp.float64, half_width: wp.float64) -> wp.float64:
    """Return the play operator's output, which follows ``x`` at a distance of ``half_width`` or stays at ``last``."""
    return wp.max(x - half_width, wp.min(x + half_width, last))
