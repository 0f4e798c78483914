"""Memory of the material: overshoot that relaxes, a loop that does not depend on the rate, creep.

State is float64 in both float widths: with a time constant of an hour and steps of a millisecond a float32 state stalls
10 % short of its end. Each law is exact for the course of the input that it assumes, so that one step of it equals two
half steps. For two laws in a row this is nearly so only: hysteresis hands creep a curve, which creep takes as straight
within a step.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false, reportReturnType=false

import warp as wp

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.func
def decay(dt: wp.float64, tau: wp.float64) -> wp.float64:
    """``exp(-dt / tau)``; 1 when no time passes, 0 when there is no time constant."""
    if dt <= _ZERO:
        return _ONE
    if tau <= _ZERO:
        return _ZERO
    return wp.exp(-dt / tau)


@wp.func
def grown(h: wp.float64) -> wp.float64:
    """``1 - exp(-h)`` without cancellation, for h >= 0."""
    if h > wp.float64(0.02):
        return _ONE - wp.exp(-h)
    inner = _ONE - h / wp.float64(4.0) * (_ONE - h / wp.float64(5.0) * (_ONE - h / wp.float64(6.0)))
    return h * (_ONE - h / wp.float64(2.0) * (_ONE - h / wp.float64(3.0) * inner))


@wp.func
def ramp_share(h: wp.float64) -> wp.float64:
    """``1 - (1 - exp(-h)) / h``: what a first-order lag has taken over of a linear ramp at its end."""
    if h > wp.float64(0.02):
        return _ONE - grown(h) / h
    inner = _ONE - h / wp.float64(5.0) * (_ONE - h / wp.float64(6.0))
    return h / wp.float64(2.0) * (_ONE - h / wp.float64(3.0) * (_ONE - h / wp.float64(4.0) * inner))


@wp.func
def rise(new: wp.float64, old: wp.float64) -> wp.float64:
    """Return the part of ``new - old`` that leads away from zero; the rest, ``new - old - rise``, leads towards it."""
    if new * old < _ZERO:
        return new
    if wp.abs(new) >= wp.abs(old):
        return new - old
    return _ZERO


@wp.func
def play(x: wp.float64, last: wp.float64, half_width: wp.float64) -> wp.float64:
    """Return the play operator: follows ``x`` at a distance of ``half_width``, and stays where it is in between."""
    return wp.max(x - half_width, wp.min(x + half_width, last))
