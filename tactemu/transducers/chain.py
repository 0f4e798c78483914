"""The transducers of one sensor, one after another, between its model and its electronics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from tactemu.base.errors import SceneError
from tactemu.plan.plan import Stage
from tactemu.transducers.transducer import SIGNAL_TYPES, SignalType, Transducer, TransducerSite


class Chain:
    """A sequence of transducers in which each accepts the signal of the one before.

    Args:
        where: the place that error messages name.
        transducers: one or more, in their order.
        layouts: the quantities that the sensor model provides, and the channels that hold each.

    Raises:
        SceneError: a transducer does not accept the signal before it.
    """

    def __init__(self, where: str, transducers: Sequence[Transducer], layouts: Mapping[str, slice]):
        self.transducers = tuple(transducers)
        has = [name for name in transducers[0].takes if name in layouts]
        if not has:
            kind = type(transducers[0]).__name__
            raise SceneError(
                f"{where}: {kind} takes {' or '.join(transducers[0].takes)}; the model gives {', '.join(layouts)}"
            )
        wanted = [name for name in has if _passes(self.transducers, SIGNAL_TYPES[name])]
        self.taken = SIGNAL_TYPES[(wanted or has)[0]]
        self.columns = layouts[self.taken.quantity]
        kind = self.taken
        for each in self.transducers:
            if kind.quantity not in each.takes:
                raise SceneError(
                    f"{where}: {type(each).__name__} takes {' or '.join(each.takes)}, not the {kind.quantity} before it"
                )
            kind = each.gives(kind)
        self.output: SignalType = kind
        """The type of the signal that the last transducer provides."""

    def compile(self, site: TransducerSite, array: wp.array) -> tuple[wp.array, list[Stage]]:
        """Return the last transducer's array and all stages, for the model's array ``(n_envs, n_taxels, channels)``."""
        kind, stages = self.taken, []
        x: Any = array[:, :, self.columns]
        for each in self.transducers:
            x, more = each.compile(site, x, kind)
            stages += more
            kind = each.gives(kind)
        return x, stages


def _passes(transducers: Sequence[Transducer], kind: SignalType) -> bool:
    for each in transducers:
        if kind.quantity not in each.takes:
            return False
        kind = each.gives(kind)
    return True
