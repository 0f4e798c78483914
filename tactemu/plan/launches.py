"""Launches over environments, in shares: on a CPU each thread runs its own share of all stages.

An environment touches no other, so a thread may run ahead of the others through any number of launches, and what comes
out does not depend on how many threads there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import warp as wp

Launch = Callable[[], None]
BLOCK = 256
"""Threads of a block on a GPU, unless said."""


class Launches:
    """Launches one after another, each cut in the same shares of the environments. Called, it runs all of them.

    Args:
        shares: the launches of each share; no share at all: there is nothing to launch.
    """

    def __init__(self, shares: Sequence[Sequence[Launch]] = ()):
        self.shares = tuple(tuple(share) for share in shares)

    def __call__(self) -> None:
        """Run all, share by share."""
        for share in self.shares:
            for launch in share:
                launch()


def in_turn(*launches: Launch) -> Launch:
    """All of them, one after another; in shares if each of them is."""
    cut = [each for each in launches if isinstance(each, Launches)]
    if len(cut) == len(launches):
        cut = [each for each in cut if each.shares]
        return Launches([sum(parts, ()) for parts in zip(*(each.shares for each in cut))])

    def launch() -> None:
        for each in launches:
            each()

    return launch


def record(kernel, dim, inputs: list, outputs: list, device, block_dim: int = BLOCK) -> Launch:
    """A recorded launch of ``kernel``: calling it costs a fraction of ``wp.launch``. Nothing for no threads."""
    block = {"block_dim": block_dim} if block_dim != BLOCK and wp.get_device(device).is_cuda else {}
    command = wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, record_cmd=True, **block)
    return command.launch if command is not None else lambda: None


def record_blocks(kernel, n_blocks: int, inputs: list, outputs: list, block_dim: int, device) -> Launch:
    """As :func:`record`, with a block of ``block_dim`` threads for each of ``n_blocks`` (on a CPU: one thread)."""
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
    return command.launch
