"""Launches over environments, in shares: on a CPU each thread runs its own share of all stages.

Environments are independent, so a thread may run ahead of the others through any number of launches, and the results do
not depend on the number of threads.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import warp as wp

Launch = Callable[[], None]


class Launches:
    """Launches one after another, each cut into the same shares of the environments. Calling the object runs all of
    them.

    Args:
        shares: the launches of each share; empty if there is nothing to launch.
    """

    def __init__(self, shares: Sequence[Sequence[Launch]] = ()):
        self.shares = tuple(tuple(share) for share in shares)

    def __call__(self) -> None:
        """Run all launches, share by share."""
        for share in self.shares:
            for launch in share:
                launch()


def in_turn(*launches: Launch) -> Launch:
    """Return a launch that runs ``launches`` one after another; it is cut into shares if each of them is."""
    cut = [each for each in launches if isinstance(each, Launches)]
    if len(cut) == len(launches):
        cut = [each for each in cut if each.shares]
        return Launches([sum(parts, ()) for parts in zip(*(each.shares for each in cut))])

    def launch() -> None:
        for each in launches:
            each()

    return launch


def record(kernel, dim, inputs: list, outputs: list, device, block_dim: int | None = None) -> Launch:
    """Return a recorded launch of ``kernel``, which costs a fraction of ``wp.launch``. Without threads it does
    nothing."""
    block = block_dim if wp.get_device(device).is_cuda else None
    command = wp.launch(kernel, dim, inputs=inputs, outputs=outputs, device=device, record_cmd=True, block_dim=block)
    return _ready(command) if command is not None else lambda: None


def record_blocks(kernel, n_blocks: int, inputs: list, outputs: list, block_dim: int, device) -> Launch:
    """Record a launch like :func:`record`, with a block of ``block_dim`` threads for each of ``n_blocks`` (on a CPU:
    one thread)."""
    command = wp.launch_tiled(
        kernel,
        dim=[n_blocks],
        inputs=inputs,
        outputs=outputs,
        block_dim=block_dim,
        device=device,
        record_cmd=True,
    )
    assert command is not None
    return _ready(command)


def _ready(command: Any) -> Launch:
    """Return a function that calls a CPU kernel with arguments packed once: Warp's own ``launch`` packs them on each
    call, which takes longer than many kernels and holds the interpreter's lock."""
    forward = getattr(getattr(command, "hooks", None), "forward", None)
    if (
        not command.device.is_cpu or command.block_dim > 1 or forward is None
    ):  # other versions of Warp keep it elsewhere
        return command.launch
    bounds, *given = command.params
    fields = [(f"argument_{k}", type(value)) for k, value in enumerate(given)]
    arguments = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*given)
    launch = partial(forward, ctypes.byref(bounds), ctypes.byref(arguments))
    launch.command = command  # pyright: ignore[reportAttributeAccessIssue] - keeps the module loaded
    return launch
