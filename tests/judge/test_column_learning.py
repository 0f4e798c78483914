"""Tests of column learning on rows of known origin, and of what it must not guess."""

import numpy as np
import pytest

from tactemu.base.errors import TactemuError
from tactemu.judge.checks import (
    axis_in,
    clipped,
    frozen,
    mirrored,
    misnamed,
    misread,
    misscaled,
    side_in,
    unit_in,
    unread_channels,
)
from tactemu.judge.column_learning import UnlearnableError, learn
from tactemu.judge.columns import Channel, Column, Columns
from tactemu.judge.trial_record import DriverRow, sample_of
from tactemu.truth import Passage

PERIOD = 10_000_000
N = 330
CHANNELS = [Channel(f"pad[{k}].{axis}", axis, "N", 20.0) for k in range(3) for axis in "xyz"]


def samples(width=9, span=3000, seed=0):
    random = np.random.default_rng(seed)
    return [sample_of(k * PERIOD, k, random.integers(-span, span, width).astype(float)) for k in range(N)]


def frames(taken):
    return [Passage(sample.t_ns, "", "tx", b"", sample.number) for sample in taken]


def learned(make, *, taken=None, late=0.1, every=1, channels=CHANNELS):
    """Return the columns learned from rows that ``make`` computes from the counts.

    There is a row every ``every`` samples, ``late`` periods after its sample.
    """
    taken = taken or samples()
    lateness = late if callable(late) else lambda k: late
    rows = [
        DriverRow(round(sample.t_ns + lateness(k) * PERIOD), make(sample.counts, k))
        for k, sample in enumerate(taken)
        if not k % every
    ]
    return learn(sorted(rows, key=lambda printed: printed.t_ns), taken, frames(taken), channels)


def held(seed, width=3, length=12):
    """Return samples of which each is held for a while, as many as fit."""
    kept = np.random.default_rng(seed).integers(-1500, 1500, (N // length, width)).astype(float)
    return [sample_of(k * PERIOD, k, kept[k // length]) for k in range(N // length * length)]


@pytest.mark.parametrize("seed", range(10))
def test_random_numbers_beside_held_samples_follow_no_channel(seed):
    random, taken, channels = np.random.default_rng(seed + 100), held(seed), CHANNELS[:3]
    rows = [DriverRow(sample.t_ns + PERIOD // 10, {"0": random.random(), "1": random.random()}) for sample in taken]
    assert not learn(rows, taken, frames(taken), channels, seed, steps=True).values
    rows = [DriverRow(sample.t_ns + PERIOD // 10, {"0": 0.05 * sample.counts[1], "1": 1.0}) for sample in taken]
    assert [column.channel for column in learn(rows, taken, frames(taken), channels, seed, steps=True).values] == [1]


def permuted(x, k):
    order = [4, 2, 0, 1, 3, 5, 8, 7, 6]
    return {f"c{i}": float(0.05 * x[at] * (-1) ** i + 3 * i) for i, at in enumerate(order)}


@pytest.mark.parametrize(
    "case",
    [
        {},
        {"late": 20.3},
        {"every": 3},
        {"late": lambda k: 0.1 + 0.8 * (k % 5) / 5},
        {"late": lambda k: 3.1 - k % 4},
    ],
    ids=["at once", "200 ms late", "every third", "jitter", "four at a time"],
)
def test_channels_in_any_order_scale_and_sign(case):
    columns = learned(permuted, **case)
    assert [column.channel for column in columns.values] == [4, 2, 0, 1, 3, 5, 8, 7, 6]
    assert [column.gain for column in columns.values] == pytest.approx([0.05 * (-1) ** i for i in range(9)], rel=1e-6)
    assert all(column.how == "line" and column.share > 0.99 for column in columns.values)


def test_a_driver_that_falls_behind_is_found_by_its_sequence():
    columns = learned(permuted, late=lambda k: 0.5 * k)
    assert [column.channel for column in columns.values] == [4, 2, 0, 1, 3, 5, 8, 7, 6]


def int16(x):
    return np.int16(round(x))


@pytest.mark.parametrize(
    ("how", "made"),
    [
        ("its lowest 11 bits alone", lambda x: float(int(x) & 0x7FF)),
        ("its lowest 7 bits alone", lambda x: float(int(x) & 0x7F)),
        ("clipped", lambda x: min(x, -800.0) / 20),
        ("clipped", lambda x: float(np.clip(x, -2500, 2500))),
        ("fold", lambda x: float((x + 3000) ** 1.5 if x < 500 else (x - 500) ** 1.5)),
        ("int16 with its bytes swapped", lambda x: float(int16(x).byteswap())),
        ("uint16 with its bytes swapped", lambda x: float(np.uint16(int16(x)).byteswap())),
        ("int16 read as unsigned", lambda x: float(np.uint16(int16(x)))),
        ("absolute value", abs),
        ("absolute value", lambda x: 0.05 * abs(x - 700) + 3),
        ("curve", lambda x: float(np.sqrt(x + 3001.0))),
        ("line", lambda x: round(x / 100) * 100.0),
    ],
)
def test_one_column_of_three_is_strange(how, made):
    columns = learned(lambda x, k: {"a": x[0], "b": made(x[1]), "c": x[2]})
    assert [(column.channel, column.how) for column in columns.values] == [(0, "line"), (1, how), (2, "line")]


@pytest.mark.parametrize(
    ("how", "made"),
    [
        ("int32 read as unsigned", lambda x: float(int(x) & 0xFFFFFFFF) / 1e6),
        ("int32 with its bytes swapped", lambda x: float(np.int32(int(x)).byteswap())),
        (
            "int32 with its words swapped",
            lambda x: float(np.array([int(x)], "<i4").view("<u2")[::-1].copy().view("<i4")[0]),
        ),
        ("clipped", lambda x: float(np.clip(x / 1e6, -20, 20))),
        ("clipped", lambda x: float(np.clip(x / 1e6, -50, 50))),
    ],
)
def test_channels_of_32_bits(how, made):
    columns = learned(lambda x, k: {f"c{i}": made(x[i]) for i in range(6)}, taken=samples(6, 200_000_000))
    assert [(column.channel, column.how) for column in columns.values] == [(k, how) for k in range(6)]


@pytest.mark.parametrize("limit", [0.05, 0.3, 1.0, 2.0])
def test_a_column_with_hardly_a_row_between_its_limits_is_said_to_be_flat(limit):
    columns = learned(
        lambda x, k: {f"c{i}": float(np.clip(x[i] / 1e6, -limit, limit)) for i in range(6)},
        taken=samples(6, 200_000_000),
    )
    assert [column.channel for column in columns.values] == list(range(6)) and len(clipped(columns)) == 6


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("zero", [0, 8192])
def test_a_sign_that_is_dropped_in_every_column(zero, whole):
    taken = [sample_of(s.t_ns, s.number, s.counts * (1 if whole else 0.0137) + zero) for s in samples(6)]
    columns = learned(lambda x, k: {f"f{i}": abs(x[i] - zero) for i in range(6)}, taken=taken)
    assert [(c.channel, c.how) for c in columns.values] == [(k, "absolute value") for k in range(6)]
    assert [c.zero for c in columns.values] == pytest.approx([zero] * 6, abs=1e-6)
    assert columns.expected(taken[5].counts[None])[0] == pytest.approx(np.abs(taken[5].counts - zero), abs=1e-6)
    assert misread(columns)[1] == "column 'f1' holds pad[0].y as absolute value"
    columns = learned(lambda x, k: {f"abs_f{i}": abs(x[i] - zero) for i in range(6)}, taken=taken)
    assert not misread(columns)


def test_a_channel_of_12_bits_of_which_11_are_read():
    taken = [sample_of(s.t_ns, s.number, np.mod(s.counts, 65536.0)) for s in samples(9, 100_000)]
    columns = learned(lambda x, k: {f"c{i}": float(np.uint16(x[i]).astype(np.int16)) for i in range(9)}, taken=taken)
    assert [(c.channel, c.how) for c in columns.values] == [(k, "uint16 read as signed") for k in range(9)]
    taken = [sample_of(s.t_ns, s.number, np.mod(s.counts, 4096.0)) for s in samples(9, 100_000)]
    columns = learned(lambda x, k: {f"c{i}": float(int(x[i]) & 0x7FF) for i in range(9)}, taken=taken)
    assert [(c.channel, c.how) for c in columns.values] == [(k, "its lowest 11 bits alone") for k in range(9)]
    columns = learned(lambda x, k: {f"c{i}": min(x[i], 1600.0) for i in range(9)}, taken=taken)
    assert [(c.channel, c.how) for c in columns.values] == [(k, "clipped") for k in range(9)]
    assert "reads one value over 61% of the counts" in clipped(columns)[0]


@pytest.mark.parametrize("seed", range(4))
def test_rows_that_came_late_are_no_mistake_of_the_driver(seed):
    """Check that a mistake without effect on the counts does not win if some rows are of the previous sample."""
    random = np.random.default_rng(seed)
    taken = [sample_of(s.t_ns, s.number, np.mod(s.counts, 4096.0)) for s in samples(9, 100_000, seed)]
    older = random.random(N) < 0.06
    columns = learned(lambda x, k: {f"c{i}": taken[max(0, k - older[k])].counts[i] for i in range(9)}, taken=taken)
    assert [(column.channel, column.how) for column in columns.values] == [(k, "line") for k in range(9)]


def test_a_curve_and_a_coarse_scale_are_not_flat():
    columns = learned(lambda x, k: {"a": float(round(np.sqrt(x[0] + 3000))), "b": round(x[1] / 500) * 5.0})
    assert [column.how for column in columns.values] == ["curve", "line"] and clipped(columns) == []


def test_a_sum_of_channels():
    columns = learned(lambda x, k: {"a": 2 * x[0] + x[4] - 0.5 * x[5] + 7, "b": x[2]})
    mix = columns.values[0]
    assert mix.how == "mix" and {int(k): round(v, 6) for k, v in mix.weights.items()} == {0: 2.0, 4: 1.0, 5: -0.5}


def test_flags_counters_clocks_and_what_is_nothing():
    random = np.random.default_rng(1)
    columns = learned(
        lambda x, k: {
            "ok": 1.0,
            "n": float(k),
            "t": 0.01 * k,
            "f": x[0],
            "x": float(random.normal()),
            "nan": float("nan"),
        }
    )
    assert [column.role for column in columns.columns] == ["flag", "counter", "time", "value", "other", "other"]
    assert dict(columns.describe())["x"] == "cannot be told"


def test_many_small_numbers():
    """Check 96 channels of 8 bits, where a column alone identifies no sample."""
    random = np.random.default_rng(2)
    taken = [sample_of(k * PERIOD, k, random.integers(20, 256, 96).astype(float)) for k in range(N)]
    order = random.permutation(96)
    columns = learned(lambda x, k: dict(enumerate_names(x[order])), taken=taken, channels=[])
    assert [column.channel for column in columns.values] == order.tolist()


def enumerate_names(values):
    return ((f"v.{k}", float(value)) for k, value in enumerate(values))


def test_too_few_rows_and_rows_of_nothing():
    with pytest.raises(UnlearnableError, match="3 rows"):
        learn([DriverRow(k, {"a": 1.0}) for k in range(3)], samples(), [], CHANNELS)
    random = np.random.default_rng(3)
    assert learned(lambda x, k: {"a": float(random.normal())}).values == []


WRENCH = [Channel(f"F{axis}", axis, "N", 50.0) for axis in "xyz"]
WRENCH += [Channel(f"M{axis}", axis, "Nm", 1500.0) for axis in "xyz"]
SIX = ("fx", "fy", "fz", "tx", "ty", "tz")


def wrench_of(make=lambda six: six, names=SIX, taken=None):
    """Return the columns learned from a wrench's six columns in N and Nm, changed by ``make``."""
    scales = np.array([50.0] * 3 + [1500.0] * 3)
    taken = taken or samples(6)
    return learned(lambda x, k: dict(zip(names, make(list(x / scales)))), taken=taken, channels=WRENCH)


def exchanged(a, b):
    def make(six):
        six[a], six[b] = six[b], six[a]
        return six

    return make


def times(*factors):
    return lambda six: [value * factor for value, factor in zip(six, (*factors, *[1.0] * 6))]


def test_names_and_scales_that_contradict_the_device():
    columns = learned(lambda x, k: {"fx": x[1] / 20, "fy": x[0] / 20, "fz": 1.1 * x[2] / 20})
    assert misnamed(columns) == ["column 'fx' holds the y axis", "column 'fy' holds the x axis"]
    assert misscaled(columns) == ["column 'fz' reads 1.1 N for 1 N"]
    assert dict(columns.describe())["fx"] == "pad[0].y, in N"
    names = ("fx", "force.y", "Bz3", "axis", "x", "max", "index", "px_0", "velocity", "fx_mN", "force.z [N]", "ty.3")
    assert [axis_in(name) for name in names] == ["x", "y", "z", "", "x", "", "", "x", "", "x", "z", "y"]
    names = ("fx", "force.y", "tz", "Mx", "torque_x_Nm", "z", "Bx")
    assert [side_in(name) for name in names] == ["N", "N", "Nm", "Nm", "Nm", "", ""]


def test_a_wrench_whose_components_are_exchanged_or_mirrored():
    assert misnamed(wrench_of()) == mirrored(wrench_of()) == []
    assert misnamed(wrench_of(exchanged(3, 4))) == ["column 'tx' holds the y axis", "column 'ty' holds the x axis"]
    assert misnamed(wrench_of(exchanged(0, 3))) == ["column 'fx' holds Mx", "column 'tx' holds Fx"]
    assert mirrored(wrench_of(times(1, 1, 1, 1, 1, -1))) == ["the sign of 'tz' goes with no frame of the other columns"]
    for turned in ((1, -1, -1, 1, -1, -1), (-1, -1, -1, -1, -1, -1), (-1, 1, 1, 1, -1, 1)):
        assert mirrored(wrench_of(times(*turned))) == [], "another frame, or the reaction"


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (1000, "reads 1000 N for 1 N, looks like mN read as N"),
        (0.001, "reads 0.001 N for 1 N, looks like kN read as N"),
        (10, "reads 10 N for 1 N, a power of ten off"),
        (-0.1, "reads 0.1 N for 1 N, a power of ten off"),
        (9.80665, "reads 9.807 N for 1 N, looks like N taken for kgf"),
        (1 / 9.80665, "reads 0.102 N for 1 N, looks like kgf read as N"),
        (1000 / 9.80665, "reads 102 N for 1 N, looks like gf read as N"),
        (98.0665, "reads 98.07 N for 1 N, off by 9.80665 and a power of ten"),
        (4.4482216, "reads 4.448 N for 1 N, looks like N taken for lbf"),
        (2.204623, "reads 2.205 N for 1 N, off by 2.20462 and a power of ten"),
        (1.03, "reads 1.03 N for 1 N"),
    ],
)
def test_a_unit_that_is_wrong_by_a_power_of_ten_or_by_gravity(factor, message):
    assert misscaled(wrench_of(times(factor))) == [f"column 'fx' {message}"]


def test_a_unit_in_the_name_makes_its_factor_right_and_any_other_wrong():
    names = ("fx_mN", "fy[gf]", "fz (N)", "tx_Nmm", "ty", "tz.0")
    assert misscaled(wrench_of(times(1000, 1000 / 9.80665, 1, 1000), names)) == []
    assert misscaled(wrench_of(names=names)) == [
        "column 'fx_mN' reads 1 mN for 1000 mN, looks like N read as mN",
        "column 'fy[gf]' reads 1 gf for 102 gf, looks like N read as gf",
        "column 'tx_Nmm' reads 1 Nmm for 1000 Nmm, looks like Nm read as Nmm",
    ]
    assert misscaled(wrench_of(times(*[50.0] * 3, *[1500.0] * 3))) == [], "counts"
    assert misscaled(wrench_of(times(50.0), ("fx_N", *SIX[1:]))) == ["column 'fx_N' reads 50 N for 1 N"]
    assert misscaled(wrench_of(times(3.7))) == [], "a scale of the driver's own"
    names = ("f_n", "n", "fx", "f.g", "max_N", "f_kgf.2")
    assert [unit_in(name, "N") for name in names] == ["", "", "", "g", "N", "kgf"]


def test_channels_that_are_in_no_column_and_columns_that_never_move():
    pads = [Channel(f"pad[{k}].F{axis}", axis, "N", 10.0) for k in range(31) for axis in "xyz"]
    taken = samples(93)

    def read(make):
        return learned(lambda x, k: dict(enumerate_names(make(x))), taken=taken, channels=pads)

    columns = read(lambda x: x)
    assert unread_channels(columns) == frozen(columns) == [] and "-" not in dict(columns.describe())
    columns = read(lambda x: x[:90])
    assert [channel.name for channel in unread_channels(columns)] == ["pad[30].Fx", "pad[30].Fy", "pad[30].Fz"]
    assert dict(columns.describe())["-"] == "in no column: pad[30].Fx, pad[30].Fy, pad[30].Fz"
    assert frozen(read(lambda x: [*x[:92], 0.0])) == ["column 'v.92' always reads 0"]
    assert frozen(read(lambda x: [*x, 0.0])) == [], "a picture with a corner that holds no taxel"
    assert unread_channels(read(lambda x: x[2::3])) == [], "the pushes alone"
    assert unread_channels(read(lambda x: x[:30])) == [], "some of the taxels"
    assert len(unread_channels(read(lambda x: [*x[:91], x[90], x[90]]))) == 2, "one of them three times"


def test_half_of_one_patch_of_many_is_read_on_purpose():
    hand = [Channel(f"finger {f}[{k}].touch", "", "", None) for f in range(8) for k in range(6)]
    for n, left in ((3, 0), (45, 3)):
        columns = learned(lambda x, k, n=n: dict(enumerate_names(x[:n])), taken=samples(48), channels=hand)
        assert len(unread_channels(columns)) == left


def test_a_component_of_a_wrench_that_no_column_holds():
    assert [channel.name for channel in unread_channels(wrench_of(names=SIX[:5]))] == ["Mz"]
    assert unread_channels(wrench_of(names=SIX[:3])) == [], "forces alone"


def test_a_column_that_is_named_after_another_channel():
    hand = [Channel(f"tip[{k}].{name}", "", "N", 1.0) for k in range(4) for name in ("normal", "tangential")]
    words = (("normal", 0), ("tangential", 1))
    for first, message in ((0, []), (1, ["column 'normal.0' holds tip[0].tangential"])):
        columns = learned(
            lambda x, k, first=first: {f"{n}.{i}": x[2 * i + (at ^ first)] for n, at in words for i in range(4)},
            taken=samples(8), channels=hand,
        )  # fmt: skip
        assert misnamed(columns)[:1] == message


def test_a_resultant_that_is_frozen():
    def of(make):
        return frozen(learned(make, taken=samples(9), channels=CHANNELS))

    assert of(lambda x, k: {"f.0": x[0], "f.1": x[1], "f.2": -7.0}) == ["column 'f.2' always reads -7"]
    assert of(lambda x, k: {"v": x[0], "resultant": 3.0, "id": 7.0, "f": 0.0}) == ["column 'resultant' always reads 3"]
    found = of(lambda x, k: {"fx": 0.0, "tx": 0.0, "status": 0.0, "fz": x[2]})
    assert found == ["column 'fx' always reads 0"], "the device measures forces, and no torques"


def test_columns_are_kept_in_a_file_that_people_edit(tmp_path):
    columns = learned(lambda x, k: {"a": 2 * x[0] + x[4], "b": abs(x[1]), "ok": 1.0, "n": float(k)})
    path = tmp_path / "columns.toml"
    columns.save(path)
    assert Columns.load(path, CHANNELS).as_dict() == columns.as_dict()
    assert "# pad[0].y" in path.read_text()
    for wrong, complaint in (
        ('[[columns]]\nname = "a"\nrole = "sample"', "role"),
        ('[[columns]]\nname = "a"\nrole = "value"\nchannel = 99', "expected 0 to 8"),
        ('[[columns]]\nnam = "a"', "not a file of columns"),
        ("columns = 3", "not a file of columns"),
    ):
        path.write_text(wrong)
        with pytest.raises(TactemuError, match=complaint):
            Columns.load(path, CHANNELS)


def test_what_a_column_should_read():
    x = np.array([[1.0, -2.0], [3.0, 4.0]])
    assert Column("a", "value", 1, "absolute value", gain=2.0, offset=1.0).of(x).tolist() == [5.0, 9.0]
    assert Column("a", "value", 0, "curve", table=[[0.0, 0.0], [2.0, 10.0]]).of(x).tolist() == [5.0, 10.0]
