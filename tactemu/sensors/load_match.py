"""The match of a skin's total force with a load that is known from elsewhere, such as a simulator's contact forces.

The model determines how a load is distributed over the taxels; the sum of their normal forces is made the load by one
factor on all of them, before imperfections. Where the model reads no force at all, there is nothing to scale.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false, reportCallIssue=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.plan.plan import Stage

if TYPE_CHECKING:
    from tactemu.sensors.sensor_model import Site


MIN_NET_SHARE = wp.constant(wp.float64(0.1))
"""Smallest sum of all normal forces, as a share of those that push, that is matched; below it those that push are."""


class LoadMatch:
    """The load that a skin carries; ``reason`` is that of its stage."""

    def __init__(self, reason: str):
        self.reason = reason
        self._load: wp.array | None = None
        self._host: np.ndarray | None = None
        """The load in memory that the device shares, on a CPU."""
        self._modelled: wp.array | None = None
        self._target = 0.0

    def set(self, newtons: float) -> None:
        """Set the load of the next step [N]."""
        self._target = newtons
        if self._host is not None:
            self._host[0] = newtons
        elif self._load is not None:
            self._load.fill_(newtons)

    def restore(self, newtons: float, modelled: float) -> None:
        """Restore the load and the modelled force of a last step that was not computed here [N]."""
        self.set(newtons)
        if self._modelled is not None:
            self._modelled.fill_(modelled)

    @property
    def modelled(self) -> float:
        """The total normal force of the last step as the model has it [N], before it was scaled."""
        return 0.0 if self._modelled is None else float(self._modelled.numpy()[0])

    @property
    def factor(self) -> float:
        """The factor of the last step."""
        modelled = self.modelled
        return self._target / modelled if modelled > 0 else 1.0

    def stage(self, site: "Site", truth: wp.array, raw: wp.array) -> Stage:
        """Return the stage that scales a model's readings, of the true branch and of the measured one.

        The factor is that of the true branch.
        """
        model, context, real = site.model, site.context, site.context.real
        fields = {**model.layouts, **model.more_fields}
        columns = np.concatenate([np.arange(model.n_channels)[fields[name]] for name in model.load_fields])
        self._load = context.array(np.array([self._target]), wp.float64)
        self._host = self._load.numpy() if context.device.is_cpu else None
        self._modelled = context.array(np.zeros(context.n_envs), wp.float64)
        used = wp.array(columns, dtype=wp.int32, device=context.device)
        measured = wp.zeros((0, 0, 0), dtype=real, device=context.device) if raw is truth else raw
        inputs: list[Any] = [self._load, site.normals, fields["force"].start, used]
        launch = context.record(match_kernel(real), context.n_envs, inputs, [truth, measured, self._modelled])
        return Stage(name=f"{site.name}: load", reason=self.reason, launch=launch)


@functools.cache
def match_kernel(real):
    """Return the kernel that sums up a skin's normal forces, and scales the columns ``used`` of its readings."""
    readings = wp.array3d(dtype=real)

    @warp_kernel
    def match_load(
        first_env: int,
        load: wp.array(dtype=wp.float64),
        normals: wp.array(dtype=wp.types.vector(3, real)),
        force: int,
        used: wp.array(dtype=wp.int32),
        truth: readings,
        measured: readings,
        modelled: wp.array(dtype=wp.float64),
    ):
        e = wp.tid()
        e += first_env
        total = wp.float64(0.0)
        pushes = wp.float64(0.0)
        for i in range(truth.shape[1]):
            n = normals[i]
            push = -(truth[e, i, force] * n[0] + truth[e, i, force + 1] * n[1] + truth[e, i, force + 2] * n[2])
            total += wp.float64(push)
            if not (push <= real(0.0)):  # a form of the test that lets NaN pass
                pushes += wp.float64(push)
        if total < MIN_NET_SHARE * pushes:  # dampers and walls may pull as hard as the rest pushes
            total = pushes
        modelled[e] = total
        if total <= wp.float64(0.0):
            return
        factor = load[0] / total
        for i in range(truth.shape[1]):
            for k in range(used.shape[0]):
                column = used[k]
                truth[e, i, column] = real(wp.float64(truth[e, i, column]) * factor)
                if measured.shape[0] > 0:
                    measured[e, i, column] = real(wp.float64(measured[e, i, column]) * factor)

    return match_load
