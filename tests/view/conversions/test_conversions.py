"""A truth log converted: programs of others open the files and find the values of the truth, bit for bit."""

import contextlib
import importlib.util
import json
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import TactemuError
from tactemu.base.frame_text import text
from tactemu.emulator.assembly import assemble
from tactemu.geometry import rotation
from tactemu.scene.file import parse
from tactemu.truth import Truth
from tactemu.truth.conversion import convert
from tests.cli.command import environment, tactemu
from tests.truth.telling import tell

SCENE = """
[[body]]
name = "finger"
shape = "capsule"
radius = 0.005
length = 0.02
position = [0, 0, 0.0125]
motion = { kind = "press", approach = 0.001, depth = 0.001, speed = 0.05, repeat = 0, dwell = 0.05, pause = 0.05 }

[[body]]
name = "pad"
shape = "box"
size = [0.05, 0.05, 0.01]
position = [0, 0, -0.005]
fixed = true

[[body]]
name = "table top"
shape = "plane"
position = [0.2, 0, 0]
fixed = true

[[skin]]
name = "matrix"
device = "flexitac"
device_options = { rows = 3, cols = 4 }
link = "pad"
position = [0, 0, 0.005]
quaternion = [0.70710678, 0, 0, 0.70710678]
model = "proximity_taxel"
options = { radius = 0.004, n_sample_points = 40, sense = "finger", noise = 0.01, draw_debug = true }
port = "memory:a"
faults = ["drop 20%"]

[[skin]]
name = "tip"
device = "bota_sensone"
link = "table top"
port = "memory:b"
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "truth.mcap"
    emulator = assemble(parse(SCENE), clock=VirtualClock(), truth=Truth(path)).emulator
    with emulator:
        emulator.run(0.3)
    return path


@pytest.fixture(scope="module")
def truth(log):
    found = tt.read_log(log)
    assert len(found["matrix"].t_ns) > 10 and np.abs(found["matrix"].ideal).max() > 0
    assert found["matrix"].injects and len(found.bodies["finger"].t_ns) > 5 and len(found["tip"].senses) == 2
    return found


def values_of(sample_of, skin):
    """What the rows of a cloud must hold, for each sample of a sense."""
    parts = [np.asarray(each, float).reshape(len(each), -1) for each in sample_of(skin)]
    return np.concatenate(parts, axis=1)


def clouds_equal(found, skin, columns):
    """Clouds by time, as structured arrays, against the samples of a skin."""
    assert sorted(found) == skin.t_ns.tolist()
    for k, t_ns in enumerate(skin.t_ns.tolist()):
        rows = found[t_ns]
        got = np.stack([rows[name].astype(float) for name in rows.dtype.names[3:]], axis=1)
        expected = values_of(lambda s, k=k: (s.ideal[k], s.measured[k], s.counts[k]), skin)
        assert np.array_equal(got, expected)
        assert rows.dtype.names[3:] == columns


MATRIX = ("ideal_x", "ideal_y", "ideal_z", "measured_x", "measured_y", "measured_z", "counts_touch")


def test_foxglove_schemas(log, truth):
    """Judge: mcap and mcap-protobuf-support, by the schemas in the file."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    types = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<f4", 8: "<f8"}
    (path,) = convert(log, "foxglove.mcap")[1]
    assert path.name == "truth.foxglove.mcap"
    topics: dict[str, dict] = {}
    with path.open("rb") as file:
        for schema, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, {}).setdefault(message.log_time, []).append((schema.name, decoded))

    def rows(decoded, stride):
        dtype = np.dtype([(f.name, types[f.type]) for f in decoded.fields])
        assert dtype.itemsize == stride and [f.offset for f in decoded.fields] == [o for _, o in dtype.fields.values()]
        return np.frombuffer(decoded.data, dtype)

    clouds = {t: each[0][1] for t, each in topics["/matrix/taxels"].items()}
    clouds_equal({t: rows(each, each.point_stride) for t, each in clouds.items()}, truth["matrix"], MATRIX)
    one = clouds[0]
    assert one.frame_id == "pad" and one.pose.position.z == 0.005 and one.pose.orientation.w == 0.70710678
    (name, grid), *_ = topics["/matrix/grid/matrix"][0]
    assert name == "foxglove.Grid" and grid.column_count == 4 and grid.row_stride == 4 * grid.cell_stride
    assert np.array_equal(rows(grid, grid.cell_stride), rows(one, one.point_stride))
    # A cell's middle is where its taxel is: the grid's own frame, which it turns and shifts by its pose.
    q, p = grid.pose.orientation, grid.pose.position
    cell = np.array([1.5 * grid.cell_size.x, 2.5 * grid.cell_size.y, 0])  # column 1, row 2
    at = np.array(rows(one, one.point_stride)[["x", "y", "z"]][2 * 4 + 1].tolist())
    turn = rotation.rotate
    there = turn((q.w, q.x, q.y, q.z), cell) + np.array([p.x, p.y, p.z])
    assert there == pytest.approx(turn((0.70710678, 0, 0, 0.70710678), at) + np.array([0, 0, 0.005]), abs=1e-6)

    moves = [
        (t, transform)
        for t, each in topics["/tf"].items()
        for _, tf in each
        for transform in tf.transforms
        if transform.child_frame_id == "finger"
    ]
    finger = truth.bodies["finger"]
    assert [(t, m.translation.z) for t, m in moves] == list(zip(finger.t_ns.tolist(), finger.position[:, 2]))
    assert {e.id: len(e.cubes) + len(e.spheres) + len(e.cylinders) for e in topics["/bodies"][0][0][1].entities} == {
        "finger": 3, "pad": 1, "table top": 1,
    }  # fmt: skip
    said = [(entry.level, entry.message) for each in topics["/matrix/log"].values() for _, entry in each]
    frames = [frame for frame in truth["matrix"].frames if frame.kind == "tx"]
    assert [words.split("  ")[1] for _, words in said if words.startswith("tx")] == [text(f.frame) for f in frames]
    assert sum(level == 3 for level, _ in said) >= len(truth["matrix"].injects) > 0


def test_messages_of_ros(log, truth, tmp_path):
    """Judges: rosbags opens the file, mcap-ros2-support decodes it by the definitions in it."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from rosbags.rosbag2 import Reader

    _, (path,) = convert(log, str(tmp_path / "bag.ros2.mcap"))
    types = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
    topics: dict[str, list] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            topics.setdefault(channel.topic, []).append((message.log_time, schema.name, decoded))
    found = {}
    for t_ns, _, cloud in topics["/matrix/taxels"]:
        assert cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec == t_ns and cloud.width == 12
        dtype = np.dtype([(field.name, types[field.datatype]) for field in cloud.fields])
        found[t_ns] = np.frombuffer(bytes(cloud.data), dtype)
    clouds_equal(found, truth["matrix"], MATRIX)
    assert "/tip/temperature/taxels" in topics and "/tip/wrench/taxels" in topics
    finger = truth.bodies["finger"]
    moves = [(t, tf) for t, _, m in topics["/tf"] for tf in m.transforms if tf.child_frame_id == "finger"]
    assert [(t, m.transform.translation.z) for t, m in moves] == list(zip(finger.t_ns.tolist(), finger.position[:, 2]))
    (static,) = [m.transforms[0] for _, _, m in topics["/tf_static"] if m.transforms[0].header.frame_id == "pad"]
    assert static.child_frame_id == topics["/matrix/taxels"][0][2].header.frame_id
    sent = [frame for frame in truth["matrix"].frames if frame.kind == "tx"]
    assert [bytes(m.data) for _, _, m in topics["/matrix/tx"]] == [frame.frame for frame in sent]
    assert [m.level for _, _, m in topics["/matrix/log"]].count(30) == len(truth["matrix"].injects)
    assert {marker.ns for marker in topics["/bodies"][0][2].markers} == {"finger", "pad", "table top"}
    with Reader(path) as bag:
        assert {connection.topic: connection.msgcount for connection in bag.connections} == {
            topic: len(messages) for topic, messages in topics.items()
        }
        assert bag.message_count == sum(map(len, topics.values()))


def test_a_recording_of_rerun(log, truth):
    """Judge: Rerun's own reader."""
    from rerun.chunk import RrdReader

    (path,) = convert(log, "rrd")[1]
    found: dict[str, list] = {}
    for chunk in RrdReader(path).stream():
        found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())

    def column(entity, ending):
        batches = [batch for batch in found[entity] if any(name.endswith(ending) for name in batch.schema.names)]
        (name,) = {name for batch in batches for name in batch.schema.names if name.endswith(ending)}
        times = [
            batch.column("time").cast("int64").to_pylist() if "time" in batch.schema.names else [] for batch in batches
        ]
        values = [batch.column(name).to_pylist() for batch in batches]
        return [t for each in times for t in each], [value for each in values for value in each]

    skin = truth["matrix"]
    for name in ("ideal", "measured", "counts"):
        times, values = column(f"/values/matrix/{name}", "Scalars:scalars")
        expected = np.asarray(getattr(skin, name), float).reshape(len(skin.t_ns), -1)
        assert times == skin.t_ns.tolist() and np.array_equal(np.array(values), expected)
    assert "/values/tip/wrench/measured" in found
    times, moved = column("/bodies/finger", "translation")
    finger = truth.bodies["finger"]
    assert times == finger.t_ns.tolist()
    assert np.array_equal(np.array(moved)[:, 0], finger.position.astype(np.float32))
    texts = column("/wire/matrix", "TextLog:text")[1]
    assert sum(words[0].startswith("inject drop") for words in texts) == len(skin.injects)
    # Probes change their colour where they are touched, from Genesis's blue to its red.
    colours = np.array(column("/bodies/pad/matrix/probes", "Points3D:colors")[1], np.uint32)
    touched = (skin.ideal != 0).any(axis=2)
    assert touched.any() and not touched.all()
    assert np.array_equal(colours, np.where(touched, 0xFF3300FF, 0x3366FFFF))
    (points,) = column("/bodies/finger/points", "Points3D:positions")[1]
    assert len(points) == 40
    assert column("/bodies/pad/matrix/probes", "Points3D:radii")[1] == [[np.float32(0.0008)]]
    assert list(RrdReader(path).blueprints()), "it is laid out"


def test_data_frames(log, truth):
    """Judge: pyarrow."""
    import pyarrow.parquet as pq

    _, paths = convert(log, "parquet")
    assert [path.name for path in paths] == [
        "truth.matrix.parquet", "truth.tip.temperature.parquet", "truth.tip.wrench.parquet",
    ]  # fmt: skip
    (path,) = convert(log, "parquet", skin="matrix")[1]
    assert path.name == "truth.parquet"
    table, skin = pq.read_table(path), truth["matrix"]
    assert table["t_ns"].to_pylist() == skin.t_ns.tolist() and table["sample"].to_pylist() == skin.sample.tolist()
    for name in ("ideal", "measured", "counts"):
        field = table.schema.field(name)
        shape = [int(word) for word in field.metadata[b"shape"].split()]
        values = table[name].combine_chunks().flatten().to_numpy().reshape(-1, *shape)
        assert values.dtype == getattr(skin, name).dtype and np.array_equal(values, getattr(skin, name))
    assert json.loads(table.schema.metadata[b"tactemu.skin"])["device"] == "flexitac"


def test_a_log_that_says_nothing_of_its_scene(tmp_path):
    """As logs did before version 2, and as recordings do."""
    told = Truth(tmp_path / "t.mcap")
    tell(told)
    told.close()
    for kind in ("foxglove.mcap", "ros2.mcap", "rrd", "parquet"):
        count, files = convert(tmp_path / "t.mcap", kind)
        assert count == 13 and all(path.stat().st_size for path in files)


@pytest.mark.parametrize(
    ("to", "options", "complaint"),
    [
        ("foxglove", {}, "did you mean 'foxglove.mcap'"),
        ("x.txt", {}, "expected one of foxglove.mcap, ros2.mcap, rrd, parquet, csv"),
        ("none/x.rrd", {}, "cannot write it: there is no folder .*none; make it first"),
        ("rrd", {"skin": "ring"}, "no skin 'ring' "),
        ("parquet", {"skin": "ring", "sense": "heat"}, "no skin 'ring' "),
    ],
)
def test_mistakes(log, tmp_path, to, options, complaint):
    before = sorted(log.parent.iterdir())
    with pytest.raises(TactemuError, match=complaint):
        convert(log, to if "/" not in to else str(tmp_path / to), **options)
    assert sorted(log.parent.iterdir()) == before


def test_the_command(log, tmp_path):
    done = tactemu("truth", str(log), "--to", str(tmp_path / "x.rrd"))
    assert done.returncode == 0 and (tmp_path / "x.rrd").is_file() and "rows written to" in done.stdout, done.stderr


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_run_is_shown_as_it_goes_on(tmp_path):
    """Judge: the ``rerun`` program, which receives the stream and keeps it."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    saved, log = tmp_path / "seen.rrd", tmp_path / "truth.mcap"
    program = Path(importlib.util.find_spec("rerun_cli").origin).with_name("rerun")
    command = [program, "--save", str(saved), "--port", str(port), "--bind", "127.0.0.1"]
    said = tmp_path / "said.txt"
    with said.open("wb") as out:
        viewer = subprocess.Popen(command, env=environment(), stdout=out, stderr=out)
    try:
        in_time(lambda: "Listening for" in said.read_text())
        run = ("run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", "3")
        done = tactemu(*run, "--truth", str(log), "--rerun-to", f"rerun+http://127.0.0.1:{port}/proxy")
        assert done.returncode == 0, done.stderr
        truth = tt.read_log(log)["anyskin"]
        seen = in_time(lambda: curves(saved, "/values/anyskin/measured", len(truth.t_ns)))
    finally:
        viewer.kill()
        viewer.wait()
    assert sorted(seen) == truth.t_ns.tolist() and np.abs(truth.measured).max() > 0
    assert np.array_equal([seen[t] for t in truth.t_ns.tolist()], truth.measured.reshape(len(seen), -1).astype(float))


def curves(path, entity, count):
    """Values by time, when there are so many."""
    from rerun.chunk import RrdReader

    batches = [chunk.to_record_batch() for chunk in RrdReader(path).stream() if chunk.entity_path == entity]
    times = [t for batch in batches for t in batch.column("time").cast("int64").to_pylist()]
    values = [value for batch in batches for value in batch.column("Scalars:scalars").to_pylist()]
    return dict(zip(times, values)) if len(times) == count else None


def in_time(attempt):
    """Try until it says something, and does not fail."""
    end = time.monotonic() + 30
    while True:
        with contextlib.suppress(OSError, RuntimeError, ValueError):
            if found := attempt():
                return found
        assert time.monotonic() < end
        time.sleep(0.1)
