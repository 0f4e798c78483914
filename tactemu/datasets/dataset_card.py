"""The data sheet of a dataset: what is in it, how it was made, and how it is read."""

from __future__ import annotations

import math

from tactemu.datasets.shards import FOLDER, Column
from tactemu.datasets.spec import FILE, DatasetSpec
from tactemu.datasets.wire import FOLDER as WIRE
from tactemu.version import __version__


def data_sheet(order: DatasetSpec, columns: list[Column], dt_s: float, varied: list[str]) -> str:
    """In Markdown."""
    rows = "\n".join(
        f"| `{column.name}` | {column.dtype} {' × '.join(map(str, column.shape))} | {column.unit} | {column.meaning} |"
        for column in columns
    )
    return f"""# Tactile dataset of `{order.target}`

Simulated by tactemu {__version__}. No real sensor was read: readings are those of the scene's sensor
models, and what spoils them is what the scene says.

- {order.envs} environments of {order.rows} rows each, one every {1e3 * dt_s * order.every:g} ms; seed {order.seed}.
- Environments differ in their random numbers, and in where bodies start: {_varied(order, varied)}.
- Made again from `{FILE}` by the same version it is the same: `tactemu dataset` with the same arguments.

## Readings

`{FOLDER}/*/*.parquet`, a row for each environment at each time:

| column | numbers of a row | unit | what |
| --- | --- | --- | --- |
| `env` | int32 | | number of the environment |
| `step` | int32 | | of the simulation, each {1e3 * dt_s:g} ms |
| `t_ns` | int64 | ns | simulated time |
{rows}

Forces act on the skin. `env`, `step` and `t_ns` are numbers; the other columns hold the bytes of their arrays (little
endian, C order), whose type and shape stand in the metadata of the field:

```python
import tactemu as tt

felt = tt.read_dataset(".", columns=["{columns[0].name}"], envs=[0, 3])["{columns[0].name}"]
```

or, with PyArrow alone:

```python
import numpy as np, pyarrow.dataset as ds

table = ds.dataset("{FOLDER}").to_table(filter=ds.field("env") == 3)
numbers = np.frombuffer(b"".join(table["{columns[0].name}"].to_pylist()), "{columns[0].dtype}")
```
{_wire(order, columns[0].name.rsplit(".", 2)[0])}"""


def _varied(order: DatasetSpec, varied: list[str]) -> str:
    if not varied or not (any(order.shift_m) or order.turn_rad):
        return "none elsewhere"
    shift = ", ".join(f"{1e3 * each:g}" for each in order.shift_m)
    return (
        f"{', '.join(varied)} by up to ±({shift}) mm along x, y, z and ±{math.degrees(order.turn_rad):g}° about z, "
        "uniformly"
    )


def _wire(order: DatasetSpec, skin: str) -> str:
    if not order.bytes_envs:
        return ""
    return f"""
## The wire

`{WIRE}/env-*.mcap`, of the first {order.bytes_envs} environments: truth logs, with every frame that each device
sent, and with each sample the counts that a perfect driver decodes. A sample is of the latest step that is not after
it.

```python
log = tt.read_log("{WIRE}/env-000000.mcap")["{skin}"]
counts, when = log.counts, log.t_ns  # (n_samples, ...) as the device counts, and when they were taken [ns]
frames = [(each.t_ns, each.frame) for each in log.frames if each.kind == "tx"]  # when [ns]; bytes, or a CAN frame
```
"""
