"""How long random input is tried: quickly, and always the same, unless ``TACTEMU_FUZZ=long`` asks for the night's run.

The long run (``scripts/nightly``) draws other examples each time; a failure prints the example to add to its test.
"""

import os

from hypothesis import HealthCheck, settings

LONG = os.environ.get("TACTEMU_FUZZ") == "long"
TIMES = 50 if LONG else 1
_ON_A_BUSY_MACHINE = [HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large]

settings.register_profile("tactemu", derandomize=not LONG, deadline=None, suppress_health_check=_ON_A_BUSY_MACHINE)
settings.load_profile("tactemu")


def examples(quick: int) -> settings:
    """Decorates a test that tries ``quick`` examples, and 50 times as many in the long run."""
    return settings(max_examples=quick * TIMES)
