"""``tactemu run --device cuda:0``: the whole chain feels on a GPU what it feels on the CPU."""

import json

import numpy as np
import pytest

from tests.cli.command import tactemu


def felt(path) -> np.ndarray:
    """Measured readings of every sample, shape ``(n_samples, n_taxels, 3)``."""
    rows = map(json.loads, path.read_text().splitlines())
    return np.array([row["measured"] for row in rows if row["kind"] == "sample"])


@pytest.mark.gpu
@pytest.mark.parametrize("device", ["anyskin", "linker_hand_l6"])
def test_the_chain_on_a_gpu_is_that_on_the_cpu(device, tmp_path):
    readings = []
    for compute in ("cpu", "cuda:0"):
        log = tmp_path / f"{compute.replace(':', '')}.jsonl"
        done = tactemu(
            "run", device, "--port", "memory:", "--clock=virtual", "--seconds", "3.5", "--device", compute,
            "--truth", str(log), timeout=110,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        readings.append(felt(log))
    assert np.abs(readings[0]).max() > 0
    np.testing.assert_allclose(readings[1], readings[0], atol=2e-5 * np.abs(readings[0]).max())
