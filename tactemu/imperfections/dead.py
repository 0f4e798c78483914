"""Dead taxels: drawn at resets, and made dead or revived while the scene runs."""

from __future__ import annotations

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.imperfections.columns import environment_indices
from tactemu.imperfections.elementwise import ALIVE, DIES
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.options import ChainOptions
from tactemu.imperfections.random import stream_keys
from tactemu.imperfections.resets import dead_kernel
from tactemu.plan.plan import Context


class DeadTaxels:
    """The readings at which dead columns of each environment are stuck; the electronics' kernel outputs these."""

    def __init__(self, options: ChainOptions, info: ReadingInfo, context: Context):
        self._info, self._context = info, context
        self._options = options
        self.stuck = context.full((context.n_envs, info.n_columns), ALIVE, context.real)
        """Readings of dead columns, shape ``(n_envs, n_columns)``; infinite where alive."""
        self.redraw(wp.full(context.n_envs, True, dtype=wp.bool, device=context.device))

    def redraw(self, mask: wp.array) -> None:
        """Draw again which taxels are dead in the environments of the mask (bool, shape ``(n_envs,)``)."""
        options, context = self._options, self._context
        keys = stream_keys(context.seed, f"{self._info.name}/dead")
        limits, at_first = wp.vec2d(*options.dead_taxel_value_range), options.dead_taxel_mode == "last"
        drawn = [options.dead_taxel_probability, limits, at_first]
        inputs = [mask, context.clock, keys, *drawn, self._info.n_channels, self.stuck]
        wp.launch(dead_kernel(context.real), dim=self.stuck.shape, inputs=inputs, device=context.device)

    def set(self, taxels, dead: bool, value: float | None, envs) -> None:
        """Make taxels dead, stuck at a value or (``None``) at their last reading, or revive them.

        Raises:
            SceneError: there are no such taxels or environments, or the value is not finite.
        """
        info = self._info
        taxels = np.atleast_1d(np.asarray(taxels, dtype=np.int64))
        if taxels.size and not 0 <= taxels.min() <= taxels.max() < info.n_taxels:
            raise SceneError(f"sensor {info.name!r}: taxels must be 0..{info.n_taxels - 1}, got {taxels}")
        flat = self.stuck.numpy()
        if value is not None and not abs(value) <= np.finfo(np.float64 if flat.dtype == np.float64 else np.float32).max:
            raise SceneError(f"sensor {info.name!r}: a dead taxel reads a finite {flat.dtype} number, got {value!r}")
        stuck = flat.reshape(len(flat), info.n_taxels, info.n_channels)
        new = (DIES if value is None else float(value)) if dead else ALIVE
        stuck[np.ix_(environment_indices(envs, len(stuck)), taxels)] = new
        self.stuck.assign(flat)

    @property
    def mask(self) -> np.ndarray:
        """A mask of the dead taxels, bool, shape ``(n_envs, n_taxels)``."""
        return self.stuck.numpy().reshape(-1, self._info.n_taxels, self._info.n_channels)[:, :, 0] != ALIVE
