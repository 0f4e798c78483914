"""A log of 5 GB, converted to everything: how much memory that takes, and how long.

``python -m tests.view.conversions.large [GB]``, nightly.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tactemu.truth import Truth

TAXELS, PERIOD_NS = 256, 1_000_000
KINDS = ("foxglove.mcap", "ros2.mcap", "rrd", "parquet", "csv")
CONVERT = """
import resource, sys
from tactemu.truth.conversion import convert
convert(sys.argv[1], sys.argv[2])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def write(path: Path, size: int) -> int:
    """A log of about ``size`` bytes of noise, which does not compress; how many samples it has."""
    rng, truth = np.random.default_rng(0), Truth(path, keep=0)
    truth.begin(block_when_full=True)
    values = rng.normal(size=(64, TAXELS, 3)).astype(np.float32)
    samples = size // (2 * values[0].nbytes + TAXELS * 2 + 200)
    for k in range(samples):
        counts = (values[k % 64, :, 2] * 1000 + k % 7).astype(np.int16)
        truth.sample(k * PERIOD_NS, "a", values[k % 64] + np.float32(k), values[(k + 1) % 64] - np.float32(k), counts)
        truth.wrote(k * PERIOD_NS, "a", counts.tobytes()[:100], sample=k)
    truth.close()
    return samples


def main() -> int:
    """Print memory and time of each conversion; 1 where one takes more than 200 MB."""
    gigabytes, worst = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0, 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.mcap"
        samples = write(path, int(gigabytes * 1e9))
        print(f"{path.stat().st_size / 1e9:.2f} GB, {samples} samples of {TAXELS} taxels")
        for kind in KINDS:
            start = time.monotonic()
            command = [sys.executable, "-c", CONVERT, str(path), kind]
            done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
            megabytes = int(done.stdout) / 1000
            worst = max(worst, megabytes)
            (made,) = [each for each in path.parent.iterdir() if each != path]
            size = made.stat().st_size / 1e9
            print(f"{kind:14} {megabytes:6.0f} MB  {time.monotonic() - start:6.0f} s  {size:.2f} GB", flush=True)
            made.unlink()
    return int(worst > 200)


if __name__ == "__main__":
    sys.exit(main())
