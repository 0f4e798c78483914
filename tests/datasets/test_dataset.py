"""Tests of datasets: wire logs agree with shards, and neither a kill nor partitions change the rows."""

import re
import signal
import subprocess
import sys
import time
from contextlib import chdir
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import TactemuError
from tactemu.datasets import generation
from tactemu.datasets.generation import begin, make
from tactemu.datasets.partition import Partition, load_scene
from tactemu.datasets.spec import DatasetSpec
from tactemu.datasets.start_poses import StartPoses
from tests.cli.command import here
from tests.scenes import ball, pad

pq = pytest.importorskip("pyarrow.parquet")

SCENE = (
    """
[scene]
dt = 0.002
"""
    + pad(0.04, 0.04, 0.02, more="position = [0.0, 0.0, -0.01]")
    + ball(0.01, [0.0, 0.0, 0.0105], 'motion = { kind = "press", depth = 0.002, speed = 0.02 }')
    + """

[[skin]]
device = "flexitac"
link = "pad"
options = { noise = 0.02, gain_range = [0.8, 1.2], dead_taxel_probability = 0.05 }
"""
)
COLUMN = "flexitac.force"
FIELD = (
    SCENE.split("[[skin]]")[0]
    + """[[skin]]
device = "anyskin"
link = "pad"
transducer = [{ kind = "magnetic" }]
"""
)
MODEL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="ball" pos="0 0 0.012"><freejoint/><geom name="ball" type="sphere" size=".01" mass=".1"/></body>
    <body name="door" pos="1 0 1"><joint name="hinge"/><geom name="handle" type="sphere" size=".01"/></body>
  </worldbody>
</mujoco>
"""
MOVED = """
[scene]
dt = 0.004
[engine]
kind = "{kind}"
file = "model.xml"
[[skin]]
device = "flexitac"
link = "{link}"
options = {{ noise = 0.02 }}
"""


@pytest.fixture
def spec(tmp_path) -> DatasetSpec:
    path = tmp_path / "press.toml"
    path.write_text(SCENE)
    return DatasetSpec(target=str(path), envs=6, steps=200, every=4, seed=5, bytes_envs=0, shift_m=(2e-3, 2e-3, 2e-4))


def made(spec: DatasetSpec, folder: Path, **how) -> dict[str, np.ndarray]:
    """Generate a dataset and read it with PyArrow."""
    begin(spec, folder)
    for _ in make(spec, folder, **how):
        pass
    return read(folder)


def read(folder: Path) -> dict[str, np.ndarray]:
    """Read all columns of all shards with PyArrow, sorted by time and environment."""
    columns: dict[str, list[np.ndarray]] = {}
    for path in sorted((folder / "readings").rglob("*.parquet")):
        table = pq.read_table(path)
        for field in table.schema:
            values = table[field.name].to_pylist()
            if field.metadata:
                values = np.frombuffer(b"".join(values), field.metadata[b"dtype"].decode())
            columns.setdefault(field.name, []).append(np.reshape(values, (len(table), -1)))
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    order = np.lexsort((joined["env"][:, 0], joined["step"][:, 0]))
    return {name: values[order] for name, values in joined.items()}


def run_card_code(folder: Path) -> dict:
    """Run the code of the dataset card in the dataset's folder, and return its variables."""
    names = {}
    with chdir(folder):
        for code in re.findall(r"```python\n(.*?)```", Path("README.md").read_text(), re.DOTALL):
            exec(code, names)
    return names


def same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_wire_logs_agree_with_the_shards(spec, tmp_path):
    spec = replace(spec, bytes_envs=2, every=1, turn_rad=0.1)
    rows = made(spec, tmp_path / "out")
    for env in range(2):
        log = tt.read_log(tmp_path / "out" / "wire" / f"env-{env:06d}.mcap")["flexitac"]
        assert len(log.frames) > 10 and log.measured.any() and log.counts.any()
        mine = rows["env"][:, 0] == env
        for k, t_ns in enumerate(log.t_ns):
            here = mine & (rows["t_ns"][:, 0] == t_ns // 2_000_000 * 2_000_000)
            if t_ns >= 2_000_000:
                for kind in ("ideal", "measured"):
                    values = rows[f"{COLUMN}.{kind}"][here]
                    np.testing.assert_allclose(values, [getattr(log, kind)[k].ravel()], rtol=1e-5, atol=1e-6)
    variables = run_card_code(tmp_path / "out")
    log = tt.read_log(tmp_path / "out" / "wire" / "env-000000.mcap")["flexitac"]
    assert len(variables["counts"]) == len(variables["when"]) == len(log.counts) and variables["counts"].any()
    assert variables["frames"] and all(isinstance(frame, bytes) for _when, frame in variables["frames"])
    assert set(variables["values"].shape[1:]) == {384, 3} and len(variables["values"]) == 2 * spec.steps
    np.testing.assert_array_equal(
        variables["numbers"].reshape(spec.steps, -1), rows[f"{COLUMN}.ideal"][rows["env"][:, 0] == 3]
    )
    starts = rows["pose.ball"][:6, :3]
    mine = tt.read_dataset(tmp_path / "out", columns=[f"{COLUMN}.ideal"], envs=[1])
    assert list(mine) == ["env", "step", "t_ns", f"{COLUMN}.ideal"] and mine[f"{COLUMN}.ideal"].shape[-1] == 3
    np.testing.assert_array_equal(
        mine[f"{COLUMN}.ideal"].reshape(spec.steps, -1), rows[f"{COLUMN}.ideal"][rows["env"][:, 0] == 1]
    )
    with pytest.raises(TactemuError, match=r"no column 'flexitac\.warmth' \(columns: "):
        tt.read_dataset(tmp_path / "out", columns=["flexitac.warmth"])
    with pytest.raises(TactemuError, match="no dataset is there"):
        tt.read_dataset(tmp_path)
    assert np.ptp(starts[:, 0]) > 1e-3 and np.ptp(starts[:, 2]) > 1e-5


def moved(spec: DatasetSpec, folder: Path, kind: str = "mujoco-warp", link: str = "floor") -> DatasetSpec:
    """Return the same specification for a scene that an engine moves."""
    (folder / "model.xml").write_text(MODEL)
    path = folder / f"{kind}-{link}.toml"
    path.write_text(MOVED.format(kind=kind, link=link))
    return replace(spec, target=str(path), steps=60, every=1, turn_rad=0.5)


def test_free_bodies_of_an_engine_start_elsewhere_too(spec, tmp_path):
    pytest.importorskip("mujoco_warp")
    spec = moved(spec, tmp_path)
    starts = StartPoses(load_scene(spec), spec)
    assert starts.names == ["ball"], "and not the door, which hangs on a hinge"
    places, turns = starts.of(3).starts["ball"]
    assert len(places) == len(turns) == 6 and len(np.unique(places[:, 0])) == 6
    off = np.abs(places - (0.0, 0.0, 0.012))
    assert (off <= spec.shift_m).all() and off.max() > 1e-3
    np.testing.assert_array_equal(turns[:, 1:3], 0.0)
    assert np.ptp(turns[:, 3]) > 0.1
    assert StartPoses(load_scene(spec), replace(spec, shift_m=(0.0,) * 3, turn_rad=0.0)).of_engine == {}
    for link in ("ball", "handle"):  # the ball carries the skin: no body is left to press
        other = moved(spec, tmp_path, link=link)
        assert (
            StartPoses(load_scene(other), replace(other, shift_m=(0.0,) * 3, turn_rad=0.0)).names
            == ["ball"][link == "ball" :]
        )
    with pytest.raises(TactemuError, match=r"no body can start elsewhere.*--shift 0 0 0"):
        begin(moved(spec, tmp_path, link="ball"), tmp_path / "out")
    with pytest.raises(TactemuError, match="no geom or body 'bal'"):
        begin(moved(spec, tmp_path, link="bal"), tmp_path / "out")


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["mujoco-warp", "newton"])
def test_partitions_do_not_change_the_rows_of_an_engine(spec, tmp_path, kind):
    pytest.importorskip(kind.replace("-", "_"))
    spec = replace(moved(spec, tmp_path, kind), bytes_envs=2)
    rows = made(spec, tmp_path / "one")
    same(made(replace(spec, partitions=3), tmp_path / "three"), rows)
    places, turns = StartPoses(load_scene(spec), spec).of_engine["ball"]
    begun = rows["step"][:, 0] == 1
    np.testing.assert_allclose(rows["pose.ball"][begun, :2], places[:, :2], atol=1e-5)
    np.testing.assert_allclose(np.abs((rows["pose.ball"][begun, 3:] * turns).sum(1)), 1.0, atol=1e-5)
    assert len(np.unique(rows[f"{COLUMN}.ideal"][rows["step"][:, 0] == 60], axis=0)) == 6, (
        "each environment is pressed elsewhere"
    )
    for env in range(2):
        log = tt.read_log(tmp_path / "one" / "wire" / f"env-{env:06d}.mcap")["flexitac"]
        mine, k = rows["env"][:, 0] == env, len(log.t_ns) - 1
        last = mine & (rows["t_ns"][:, 0] == log.t_ns[k] // 4_000_000 * 4_000_000)
        assert log.ideal[k].any()
        np.testing.assert_allclose(rows[f"{COLUMN}.ideal"][last], [log.ideal[k].ravel()], rtol=1e-5, atol=1e-6)


@pytest.fixture
def small_shards(monkeypatch):
    monkeypatch.setattr("tactemu.datasets.shards.SHARD_BYTES", 300_000)


def test_partitions_do_not_change_the_rows(spec, tmp_path, small_shards):
    rows = made(spec, tmp_path / "one")
    assert len(list((tmp_path / "one").rglob("*.parquet"))) > 2
    assert rows["step"][::6, 0].tolist() == list(range(4, 201, 4))
    assert rows[f"{COLUMN}.measured"].any() and (rows[f"{COLUMN}.measured"] != rows[f"{COLUMN}.ideal"]).any()
    same(made(replace(spec, partitions=3), tmp_path / "three"), rows)


def test_a_killed_run_is_resumed(spec, tmp_path):
    spec = replace(spec, steps=1500, every=1)
    script = (
        "import sys; from tactemu.datasets import shards; shards.SHARD_BYTES = 500_000\n"
        "from tactemu.datasets.generation import begin, make; from tactemu.datasets.spec import DatasetSpec\n"
        f"from pathlib import Path; spec = DatasetSpec(**{vars(spec)!r})\n"
        "begin(spec, Path(sys.argv[1]))\n"
        "for _ in make(spec, Path(sys.argv[1])): print('shard', flush=True)"
    )

    def run(folder: str) -> subprocess.Popen:
        return subprocess.Popen([sys.executable, "-c", script, str(tmp_path / folder)], stdout=subprocess.PIPE)

    begun = run("killed")
    assert begun.stdout
    assert len(list(islice((line for line in begun.stdout if line == b"shard\n"), 3))) == 3
    while not list((tmp_path / "killed").rglob("*.parquet")):  # threads write the shards
        time.sleep(1e-3)
    begun.send_signal(signal.SIGKILL)
    begun.wait()
    begun.stdout.close()
    there = list((tmp_path / "killed").rglob("*.parquet"))
    for folder in ("killed", "unbroken"):
        with run(folder) as process:
            process.communicate()
        assert process.returncode == 0
    assert 0 < len(there) < len(list((tmp_path / "killed").rglob("*.parquet")))
    same(read(tmp_path / "killed"), read(tmp_path / "unbroken"))


@pytest.mark.nightly
def test_two_workers_generate_the_same(spec, tmp_path):
    distributed = pytest.importorskip("distributed")
    with pytest.raises(TactemuError, match="no scheduler answers"):
        made(spec, tmp_path / "nowhere", cluster="tcp://127.0.0.1:9")
    spec = replace(spec, partitions=3, bytes_envs=2)
    here = made(spec, tmp_path / "here")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        same(made(spec, tmp_path / "there", cluster=cluster.scheduler_address), here)
    for env in range(2):
        paths = [tmp_path / place / "wire" / f"env-{env:06d}.mcap" for place in ("here", "there")]
        frames = [[each.frame for each in tt.read_log(path)["flexitac"].frames] for path in paths]
        assert frames[0] and frames[0] == frames[1]


def test_a_disk_that_is_too_small(spec, tmp_path, monkeypatch):
    full = generation.shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(generation.shutil, "disk_usage", lambda _place: full)
    with pytest.raises(TactemuError, match=r"1\.0 kB are free on that disk"):
        begin(spec, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_another_dataset_is_not_written_over(spec, tmp_path):
    begin(spec, tmp_path / "out")
    with pytest.raises(TactemuError, match=r"order\.seed: 5 then, 6 now"):
        begin(replace(spec, seed=6), tmp_path / "out")
    Path(spec.target).write_text(SCENE.replace("0.0105", "0.0115"))
    with pytest.raises(TactemuError, match=r"scene\.body"):
        begin(spec, tmp_path / "out")
    with pytest.raises(TactemuError, match="other files"):
        begin(spec, tmp_path)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--steps", "0"], "steps: expected a whole number from 1"),
        (["--steps", "10", "--every", "11"], "every: expected a whole number from 1 to 10"),
        (["--steps", "10", "--partitions", "100"], "partitions: expected a whole number from 1 to 64"),
        (["--steps", "10", "--shift", "1", "1", "-1"], "shift"),
        (["--steps", "10", "--compression", "gzip"], "no compression 'gzip' (compressions: lz4, zstd, none)"),
    ],
)
def test_invalid_options_are_refused(spec, tmp_path, words, message):
    done = here("dataset", spec.target, "--out", str(tmp_path / "out"), *words)
    assert done.returncode == 2 and message in done.stderr


def test_the_command(spec, tmp_path):
    out = tmp_path / "out"
    words = "dataset", spec.target, "--envs", "4", "--steps", "50", "--bytes-envs", "1", "--out", str(out)
    for _ in range(2):  # the second run finds all shards
        done = here(*words)
        assert done.returncode == 0, done.stderr
        assert "1 shards, at most" in done.stdout and "done" in done.stdout
    assert "ball by up to" in (out / "README.md").read_text()
    assert len(read(out)["env"]) == 200


def test_a_field_has_its_unit(tmp_path):
    path = tmp_path / "field.toml"
    path.write_text(FIELD)
    columns = Partition(DatasetSpec(target=str(path), envs=1, steps=1, bytes_envs=0), 0, 1).columns
    assert {each.name: each.unit for each in columns if "field" in each.name} == {
        "anyskin.field.ideal": "T",
        "anyskin.field.measured": "T",
    }
