"""Least squares, by scipy: imported when something is fitted."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError


def least_squares(residuals: Any, begin: Any, **options: Any) -> Any:
    """``scipy.optimize.least_squares``.

    Raises:
        TactemuError: scipy is not installed.
    """
    try:
        from scipy import optimize
    except ImportError:
        raise TactemuError("fitting needs scipy: pip install 'tactemu[fit]'") from None
    return optimize.least_squares(residuals, np.asarray(begin, float), **options)
