"""The dataset card: the contents of a dataset, how it was generated, and how you read it."""

from __future__ import annotations

import math

from tactemu.datasets.shards import FOLDER, Column
from tactemu.datasets.spec import FILE, DatasetSpec
from tactemu.datasets.wire_logs import FOLDER as WIRE
from tactemu.version import __version__


def dataset_card(spec: DatasetSpec, columns: list[Column], dt_s: float, varied: list[str]) -> str:
    """Return the dataset card in Markdown."""
    rows = "\n".join(
        f"| `{column.name}` | {column.dtype} {' × '.join(map(str, column.shape))} | {column.unit} | {column.meaning} |"
        for column in columns
    )
    return f"""# Tactile dataset of `{spec.target}`

Simulated by tactemu {__version__}. No real sensor was read: the readings come from the scene's sensor
models, with the imperfections that the scene declares.

- {spec.envs} environments of {spec.rows} rows each, one every {1e3 * dt_s * spec.every:g} ms; seed {spec.seed}.
- Environments differ in their random numbers and in the start poses of bodies: {_varied(spec, varied)}.
- The same version of tactemu generates the same dataset from `{FILE}`: run `tactemu dataset` with the same arguments.

## Readings

`{FOLDER}/*/*.parquet`, a row for each environment at each time:

| column | type and shape in a row | unit | meaning |
| --- | --- | --- | --- |
| `env` | int32 | | number of the environment |
| `step` | int32 | | step of the simulation, {1e3 * dt_s:g} ms each |
| `t_ns` | int64 | ns | simulated time |
{rows}

Forces act on the skin, or have the signs of Genesis where a column says so. `env`, `step` and `t_ns` are numbers; the
other columns hold the bytes of their arrays (little endian, C order), with their type and shape in the metadata of the
field:

```python
import tactemu as tt

values = tt.read_dataset(".", columns=["{columns[0].name}"], envs=[0, 3])["{columns[0].name}"]
```

or, with PyArrow alone:

```python
import numpy as np, pyarrow.dataset as ds

table = ds.dataset("{FOLDER}").to_table(filter=ds.field("env") == 3)
numbers = np.frombuffer(b"".join(table["{columns[0].name}"].to_pylist()), "{columns[0].dtype}")
```
{_wire(spec, columns[0].name.rsplit(".", 2)[0])}"""


def _varied(spec: DatasetSpec, varied: list[str]) -> str:
    if not varied or not (any(spec.shift_m) or spec.turn_rad):
        return "none, all start where the scene places them"
    shift = ", ".join(f"{1e3 * each:g}" for each in spec.shift_m)
    return (
        f"{', '.join(varied)} by up to ±({shift}) mm along x, y, z and ±{math.degrees(spec.turn_rad):g}° about z, "
        "uniformly"
    )


def _wire(spec: DatasetSpec, skin: str) -> str:
    if not spec.bytes_envs:
        return ""
    return f"""
## The wire

`{WIRE}/env-*.mcap` are the truth logs of the first {spec.bytes_envs} environments: every frame that each device
sent, and for each sample the counts that a perfect driver decodes. A sample holds the values of the latest step at or
before its time.

```python
log = tt.read_log("{WIRE}/env-000000.mcap")["{skin}"]
counts, when = log.counts, log.t_ns  # (n_samples, ...) in counts of the device, and the sampling times [ns]
frames = [(each.t_ns, each.frame) for each in log.frames if each.kind == "tx"]  # time [ns]; bytes, or a CAN frame
```
"""
