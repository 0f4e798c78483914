"""Lists of the groups that are not empty, in rising order, so that sums visit only those and are always the same.

Parallel threads list entries in groups of fixed size; one warp per environment then lists the groups.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.warp_collectives import ballot_count, lanes_per_environment, rank
from tactemu.plan.plan import Context


@dataclass(frozen=True, kw_only=True)
class ActiveGroups:
    """The groups that are not empty."""

    n_active: wp.array
    """Number of groups that are not empty, int32, shape ``(n_envs,)``."""
    active: wp.array
    """Indices of these groups, rising, int32, shape ``(n_envs, n_groups)``; valid up to ``n_active``."""


@functools.cache
def _list_kernel(lanes: int):
    @warp_kernel
    def list_groups(
        first_env: int,
        counts: wp.array2d(dtype=wp.int32),
        # outputs
        n_active: wp.array(dtype=wp.int32),
        active: wp.array2d(dtype=wp.int32),
    ):
        env, lane = wp.tid()
        env += first_env
        found = int(0)
        for first in range(0, counts.shape[1], wp.static(lanes)):
            g = first + lane
            wanted = bool(False)
            if g < counts.shape[1]:
                wanted = counts[env, g] > 0
            at = found + rank(wanted)
            found += ballot_count(wanted)
            if wanted:
                active[env, at] = g
        if lane == 0:
            n_active[env] = found

    return list_groups


def active_groups(context: Context, counts: wp.array) -> tuple[ActiveGroups, Callable[[], None]]:
    """Allocate the lists and record their update from ``counts``, int32, shape ``(n_envs, n_groups)``."""
    groups = ActiveGroups(
        n_active=context.zeros(counts.shape[0], wp.int32),
        active=context.zeros(counts.shape, wp.int32),
    )
    side = lanes_per_environment(context.device)
    outputs = [groups.n_active, groups.active]
    return groups, context.record(_list_kernel(side), (counts.shape[0], side), [counts], outputs)
