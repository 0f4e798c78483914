"""``python -m benchmarks control``: every command acts, and the other skin's frames do not change."""

import pytest

from benchmarks import control

pytestmark = pytest.mark.nightly


def test_commands_are_felt_and_harm_no_other_skin():
    said: list[str] = []
    figures = control.run(said.append, seconds=2.0)
    assert figures["commands"] == figures["felt"] == int(2 * control.COMMANDS_PER_S)
    assert figures["frames_of_the_other_skin"] > 100 and figures["frames_that_differ"] == 0
    assert figures["effect_ms_p50"] > 0 and any("lateness p99" in line for line in said)
