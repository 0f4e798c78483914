"""The relaxation of rubber: the spectrum of a skin's modulus, from a list of terms or by the name of a material.

After a sudden strain the stress falls as ``G(t) = 1 - sum g_k (1 - exp(-t / tau_k))``: from 1, the instantaneous
modulus, to ``1 - sum g_k``, the modulus at rest. All moduli fall alike; Poisson's ratio stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError

MAX_TERMS = 32
"""Maximum number of terms of a spectrum; bounds memory."""
ROUNDING = 1e-9
"""Excess over 1 of a sum of shares that is taken for rounding."""

RelaxationTime = Annotated[float, Bounds(unit="s", low=1e-9, high=1e9)]
"""The time constant of a term: at least the unit of simulated time."""
SpectrumName = Literal["polyurethane"]
"""The name of a material whose spectrum has been published."""
SPECTRA: dict[str, tuple[tuple[float, float], ...]] = {
    "polyurethane": ((0.5039, 0.001), (0.1863, 0.01), (0.0181, 0.1)),
}
"""The spectra of these materials, ``(share, time constant [s])``; ``docs/sensors.md`` names their sources."""


@dataclass(frozen=True)
class Spectrum:
    """The terms of a relaxation."""

    shares: tuple[float, ...]
    """Shares ``g_k`` of the instantaneous modulus that relax."""
    times: tuple[float, ...]
    """Their time constants ``tau_k`` [s]."""

    def __str__(self) -> str:
        times = ", ".join(f"{time:g}" for time in self.times)
        return f"to {self.at_rest:.3g} of its modulus, with {times} s"

    @property
    def at_rest(self) -> float:
        """The modulus at rest, relative to the instantaneous one."""
        return max(0.0, 1.0 - sum(self.shares))

    def modulus(self, t: Any) -> np.ndarray:
        """Return the modulus at times ``t`` [s] after a sudden strain, relative to the instantaneous one."""
        decays = np.exp(-np.asarray(t, float)[..., None] / np.array(self.times))
        return 1.0 - ((1.0 - decays) * np.array(self.shares)).sum(-1)


def spectrum_of(given: SpectrumName | Sequence, where: str) -> Spectrum | None:
    """Return the spectrum of an option ``relaxation``; ``None`` where nothing relaxes.

    Args:
        given: the name of a material, or pairs ``(share, time constant [s])``; terms without a share are left out.
        where: the sensor model, for messages.

    Raises:
        SceneError: its shares add up to more than 1, or it has too many terms.
    """
    terms = [(float(share), float(time)) for share, time in (SPECTRA[given] if isinstance(given, str) else given)]
    terms = [term for term in terms if term[0] > 0]
    if len(terms) > MAX_TERMS:
        raise SceneError(f"{where}: relaxation must have at most {MAX_TERMS} terms, got {len(terms)}")
    total = sum(share for share, _ in terms)
    if total > 1.0 + ROUNDING:
        raise SceneError(
            f"{where}: the shares of relaxation must add up to at most 1, since young_modulus is the modulus before "
            f"any of it relaxes, got {total:g}"
        )
    return Spectrum(tuple(share for share, _ in terms), tuple(time for _, time in terms)) if terms else None
