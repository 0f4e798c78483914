"""`tactemu fit`: known parameters are found back, real recordings are read, and what cannot be told is said."""

import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tactemu.base.errors import TactemuError
from tactemu.cli.app import app
from tactemu.fit import fitting
from tactemu.fit.estimates import Findings, inflation
from tactemu.fit.recording import Recorded, read
from tactemu.fit.untouched import find_clock, step_of
from tactemu.scene.file import parse
from tests.fit import synthetic

EFLESH = Path(__file__).parents[1] / "data" / "real" / "eflesh"
COLUMNS = {"t": "t_sensor_s", "z": "z_mm", "mass": "mass_g", "field": "b0x:b4z"}
UNITS = {"z": "mm", "mass": "g", "field": "uT"}


def hits(kind, seeds):
    """How often the truth lies within the interval, by parameter."""
    found = {}
    for seed in seeds:
        recording, truth = synthetic.recorded(kind, seed)
        told = fitting.find(recording)
        assert any("wrong does not follow" in note for note in told.notes), "a column that is not the sensor's"
        for name, value in truth.items():
            each = told.estimates.get(name) or told.estimates[f"{name} x"]
            found.setdefault(name, []).append(each.contains(value))
    return found


@pytest.mark.parametrize("kind", synthetic.MAKERS)
def test_known_parameters_are_found_back(kind):
    for name, inside in hits(kind, range(5)).items():
        assert sum(inside) >= 3, name  # of a right interval one test of 900 fails


@pytest.mark.nightly
@pytest.mark.parametrize("kind", synthetic.MAKERS)
def test_intervals_hold_the_truth_in_ninety_of_a_hundred(kind):
    for name, inside in hits(kind, range(100)).items():
        assert sum(inside) >= 90, f"{name}: {sum(inside)} of 100"


def test_the_same_recording_gives_the_same_fit():
    first, second = (fitting.find(synthetic.recorded("field", 3)[0]) for _ in range(2))
    assert first.estimates == second.estimates and first.notes == second.notes


def test_two_days_of_a_real_skin_give_a_scene_that_loads_and_predict_one_another(tmp_path):
    out, page = tmp_path / "skin.toml", tmp_path / "skin.html"
    said = []
    found = fitting.run_fit(
        [read(EFLESH / name, COLUMNS, UNITS) for name in ("normal_1.csv.gz", "normal_2.csv.gz")],
        device="anyskin", out=out, report=page, command="tactemu fit & more", say=said.append,
    )  # fmt: skip
    assert found.value("resolution x") == pytest.approx(2.4e-6)  # as measured by hand
    assert found.value("resolution z") == pytest.approx(3.872e-6)
    assert found.value("white noise x") == pytest.approx(2.3e-6, rel=0.4)  # here also while it is hardly touched
    assert found.value("rate") == pytest.approx(13.7, rel=0.05)
    scene = parse(out.read_text())
    assert scene.tables.skin[0].device_options == {"step_scale": 16}
    assert {table["kind"] for table in scene.tables.skin[0].transducer} >= {"magnetic"}
    text, html = out.read_text(), page.read_text()
    digest = read(EFLESH / "normal_1.csv.gz", COLUMNS, UNITS).sha256
    assert (
        digest in text
        and digest in html
        and html.count("<figcaption") == html.count("<code>tactemu fit &amp; more") - 1 > 1
        and "http" not in html
    )
    scored = fitting.scores([read(EFLESH / f"normal_{k}.csv.gz", COLUMNS, UNITS) for k in (1, 2)])
    assert all(score.skill.skill > 0 for score in scored)
    assert any("not determined: temperature terms" in line for line in said)


def test_a_fitted_scene_runs(tmp_path):
    from tactemu.base.clock import VirtualClock
    from tactemu.emulator.assembly import assemble

    recording, _ = synthetic.recorded("field", 1)
    path = tmp_path / "skin.npz"
    np.savez(path, t=recording.t, force=recording.truth["force"], field=recording.readings[:, :6])
    out = tmp_path / "skin.toml"
    fitting.run_fit([read(path)], device="anyskin", out=out, say=lambda _: None)
    made = assemble(parse(out.read_text().replace('device = "anyskin"', 'device = "anyskin"\nport = "memory:"')),
                    clock=VirtualClock())  # fmt: skip
    with made.emulator as emulator:
        emulator.run(0.2)
    names = [stage.name for stage in made.simulation.plan.stages]
    assert "anyskin: soft skin" in names and "anyskin: field" in names and "anyskin: electronics" in names


@pytest.mark.parametrize(
    "clock", [{"jitter_s": 2e-3}, {"missed": 0.06, "jitter_s": 1e-3}, {"refresh_s": 0.032}, {}], ids=str
)
def test_the_clock_of_a_scene_is_found_in_what_it_sent(clock):
    from firmware_protocols import device_class
    from tactemu.base.clock import VirtualClock
    from tactemu.emulator.assembly import AssemblyOptions, assemble
    from tactemu.fit.writing import clock_of
    from tactemu.scene.default import tables_for
    from tactemu.scene.file import check

    tables = tables_for("anyskin", device_class("anyskin"))
    tables["scene"]["dt"] = 0.01
    tables["skin"][0] |= {"clock": clock, "options": {"noise": 0.1}}
    made = assemble(check(tables), AssemblyOptions(port="memory:"), clock=VirtualClock())
    with made.emulator as emulator:
        emulator.run(15.0)
        frames = emulator.truth.frames
    t = np.array([t_ns for t_ns, _, _ in frames]) * 1e-9
    counts = np.array([np.frombuffer(frame[:80], "<f4") for _, _, frame in frames], float)
    found = Findings()
    find_clock(Recorded(Path("a"), "0", t, counts, tuple(map(str, range(20))), "counts", "1"), found)
    assert clock_of(found) == pytest.approx(clock, rel=0.2)


def table(tmp_path, **columns):
    path = tmp_path / "a.csv"
    rows = np.column_stack(list(columns.values()))
    path.write_text(",".join(columns) + "\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist()) + "\n")
    return path


def test_what_is_missing_is_said_and_what_is_wrong_is_refused(tmp_path):
    n = np.arange(300)
    noise = np.random.default_rng(0).normal(0, 1, 300)
    untouched = fitting.find(read(table(tmp_path, t=n / 50, counts=np.rint(5 * noise))))
    assert untouched.estimates["resolution"].value == 1.0
    assert untouched.estimates["white noise"].contains(5.0)
    assert any(text.startswith("gains, curve, loop, creep") for text in untouched.unknown)
    assert any("temperature terms" in text for text in untouched.unknown)
    few = fitting.find(read(table(tmp_path, t=n[:60] / 50, counts=noise[:60])))
    assert any("rows at rest, 100 are needed" in text for text in few.unknown)
    bare = fitting.find(read(table(tmp_path, counts=noise)))
    assert any("has no clock" in text for text in bare.unknown)
    with pytest.raises(TactemuError, match=r"--unit field=uT"):
        fitting.find(read(table(tmp_path, t=n / 50, field=noise + 400)))
    with pytest.raises(TactemuError, match="is the unit of t right"):
        read(table(tmp_path, t=n * 1e9, counts=noise))
    with pytest.raises(TactemuError, match=r"presses of .* N; is the unit right"):
        fitting.find(read(table(tmp_path, t=n / 50, force=3000 * np.abs(noise), counts=noise)))
    with pytest.raises(TactemuError, match="did you mean 'counts'"):
        read(table(tmp_path, t=n / 50, counts=noise), {"t": "t", "counts": "count"})
    with pytest.raises(TactemuError, match="field cannot be in 'uV'"):
        read(table(tmp_path, t=n / 50, field=noise), units={"field": "uV"})
    with pytest.raises(TactemuError, match=r"name the columns .*--columns .*t, b"):
        read(table(tmp_path, t=n / 50, b=noise))


def test_rows_that_go_back_in_time_or_are_no_numbers_are_left_out(tmp_path):
    t = np.arange(300) / 50
    t[100:103] = t[99]
    values = np.random.default_rng(0).normal(0, 1, 300)
    values[7] = np.nan
    made = read(table(tmp_path, t=t, counts=values))
    assert len(made.readings) == 296 and "go back in time" in made.notes[0]


def test_a_log_of_ours_and_a_parquet_are_recordings(tmp_path):
    from tactemu.base.clock import VirtualClock
    from tactemu.emulator.assembly import AssemblyOptions, assemble
    from tactemu.scene.file import load
    from tactemu.truth import Truth

    ours = assemble(
        load("anyskin"), AssemblyOptions(port="memory:"), clock=VirtualClock(), truth=Truth(tmp_path / "a.mcap")
    )
    with ours.emulator as emulator:
        emulator.run(0.5)
    made = read(tmp_path / "a.mcap")
    assert made.kind == "counts" and made.readings.shape[1] == 20 and "force" in made.truth
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table({"t": np.arange(50) / 10, "counts": np.arange(50.0)}), tmp_path / "a.parquet")
    assert read(tmp_path / "a.parquet").readings.shape == (50, 1)


@pytest.mark.nightly
def test_an_hour_at_100_hz_takes_less_than_a_minute():
    t, load = synthetic.loads(np.random.default_rng(0), seconds=3600.0, rate=100.0)
    x = load[:, None] * np.full(15, 4e-5) + np.random.default_rng(1).normal(0, 1e-6, (len(t), 15))
    long = Recorded(Path("a"), "0", t, x, tuple(map(str, range(15))), "field", "T", {"force": load})
    begin = time.perf_counter()
    fitting.fit([long])
    assert time.perf_counter() - begin < 60


def test_the_command_teaches_and_writes(tmp_path):
    path = table(tmp_path, t=np.arange(300) / 50, counts=np.rint(np.random.default_rng(0).normal(0, 5, 300)))
    out = tmp_path / "skin.toml"
    shown = CliRunner().invoke(app, ["fit", str(path), "--sensor", "robotiq_tsf85", "--out", str(out)])
    assert shown.exit_code == 0, shown.output
    assert "not determined: gains" in shown.output and out.is_file() and out.with_suffix(".html").is_file()
    assert tomllib.loads(out.read_text())["skin"][0]["options"]["noise"] > 0


def test_steps_and_correlated_residuals_are_seen():
    rng = np.random.default_rng(0)
    assert step_of(np.rint(rng.normal(0, 4, 500)) * 0.3) == pytest.approx(0.3)
    assert step_of(rng.normal(0, 4, 500)) == 0.0
    slow = np.zeros(20000)
    for k in range(1, len(slow)):
        slow[k] = 0.9 * slow[k - 1] + rng.normal()
    assert inflation(slow) == pytest.approx(np.sqrt(1.9 / 0.1), rel=0.2)
    assert inflation(rng.normal(size=5000)) < 1.1
