"""iCub skin: set-up, the two frames of a triangle, compensation, range, geometry."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from firmware_protocols.devices.icub_triangles import FOREARM_RADIUS_M, PAD_PLACES_M, PITCH_M, SIDE_M, TAXEL_PADS
from tests.firmware.feeding import sample, send

START = "0700"


def cdist(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a[:, None] - b[None], axis=-1)


def tell(device: fp.Device, board: int, *messages: str) -> None:
    for message in messages:
        assert send(device, f"{0x200 | board:03X}#{message}") == []


def forearm(period_ms: int = 20, kind: int = 0, shift: int = 2) -> fp.Device:
    """Set up as the robot's driver does: all boards 4D, all 50, then 07 00."""
    device = fp.create("icub_skin")
    set_up = (f"4D{kind:02X}{period_ms:02X}F0", f"500002{shift:02X}010022", START)
    sample(device, 0.0, 0)
    for message in set_up:
        for board in range(1, 9):
            tell(device, board, message)
    return device


def decoded(frames) -> dict[str, np.ndarray]:
    """``{"board.triangle": 12 pads}`` as the robot's driver takes them apart: id split, head 40, tail C0."""
    skin: dict[str, np.ndarray] = {}
    for frame in frames:
        assert frame.arbitration_id >> 8 == 4 and len(frame.data) == 8
        name = f"{frame.arbitration_id >> 4 & 15}.{frame.arbitration_id & 15}"
        if frame.data[0] == 0x40:
            skin[name] = np.zeros(12, int)
            skin[name][:7] = list(frame.data[1:])
        else:
            assert frame.data[0] == 0xC0
            skin[name][7:] = list(frame.data[1:6])
    return skin


# -- set-up -----------------------------------------------------------------------------------------------------------


def test_forearm_at_50_hz_is_48_frames_of_8_boards_in_pairs():
    device = forearm()
    frames = sample(device, 0.0, 0)
    assert set(device.periods.values()) == {20_000_000} and len(frames) == 48
    assert [f.arbitration_id for f in frames[::2]] == [f.arbitration_id for f in frames[1::2]]
    assert [f.data[0] for f in frames[:4]] == [0x40, 0xC0, 0x40, 0xC0]
    assert {f.arbitration_id >> 4 & 15 for f in frames} == set(range(1, 9))
    assert all(set(pads) == {240} for pads in decoded(frames).values())


def test_silent_until_started_and_after_stop_and_during_set_up():
    device = fp.create("icub_skin")
    assert sample(device, 0, 0) == []
    tell(device, 1, START)
    sent = sample(device, 0, 0)
    assert len(sent) == 32, "the sixteen triangles of board 1 alone"
    assert {f.arbitration_id & 15: f.data[7] for f in sent[1::2]} == {t: 2 * (t > 2) for t in range(16)}, "3 are fitted"
    tell(device, 1, "50000202010022")
    assert sample(device, 0, 50_000_000) == [], "50 stops transmission"
    tell(device, 1, START)
    tell(device, 1, "0701")
    assert sample(device, 0, 100_000_000) == []


def test_set_up_clears_then_enables_a_range():
    device = fp.create("icub_skin")
    tell(device, 2, "4D0014F0", START)
    assert sample(device, 0, 0) == []
    tell(device, 2, "50010202010022", START)
    assert list(decoded(sample(device, 0, 20_000_000))) == ["2.1", "2.2"]
    tell(device, 2, "50010102000022", START)
    assert list(decoded(sample(device, 0, 40_000_000))) == ["2.2"]


def test_old_set_up_starts_at_once_every_40_ms():
    device = fp.create("icub_skin")
    tell(device, 3, "4C000000")
    assert device.periods["board 3"] == 40_000_000
    assert len(sample(device, 0, 0)) == 32


def test_two_full_boards_hold_the_forearm():
    device = fp.create("icub_skin", triangles_per_board=16)
    for board in (1, 2):
        tell(device, board, "4D0014F0", "50000F02010022", START)
    names = list(decoded(sample(device, 0, 0)))
    assert names == [f"{board}.{t}" for board in (1, 2) for t in range(16)]


def test_boards_keep_their_own_period_also_where_one_is_no_multiple_of_another():
    device = fp.create("icub_skin")
    for board, period in ((1, "14"), (2, "1E")):
        tell(device, board, f"4D00{period}F0", "50000002010022", START)
    assert [device.periods[f"board {board}"] for board in (1, 2, 3)] == [20_000_000, 30_000_000, 50_000_000]
    device.measure(reading_of(device, 0.2, "board 2"), 0)
    assert list(decoded(device.stream(0, "board 2"))) == ["2.0"] and device.stream(0, "board 3") == ()
    assert set(device.counts[:30]) == {245} and set(device.counts[30:60]) == {210}, "a board converts its own triangles"


def test_bytes_behind_a_message_are_ignored():
    device = fp.create("icub_skin")
    tell(device, 1, "4D0014F000000000", "5000020201002200", "070000")
    assert len(sample(device)) == 6 and device.counters["requests"] == 3


@pytest.mark.parametrize("request_", ["201#", "201#0702", "201#4D0014", "201#50020102010022", "209#0700", "201##00700"])
def test_what_is_no_message_changes_nothing(request_):
    device = fp.create("icub_skin")
    assert send(device, request_) == [] == sample(device)
    assert device.counters["unknown_command"] + device.counters["ignored"] == 1


def test_the_controller_takes_what_is_for_its_boards():
    hears = fp.create("icub_skin", triangles=6).ports[0].filters
    assert hears == tuple((klass << 8 | to, 0x70F) for klass in (2, 7) for to in (1, 2, 15))


def test_all_boards_obey_what_is_for_all():
    device = fp.create("icub_skin", triangles=6)
    assert send(device, "20F#500000020100220700") == []
    assert send(device, "20F#0700") == [] and len(sample(device)) == 64


def test_boards_say_who_they_are_to_whoever_asks():
    device = fp.create("icub_skin", triangles=6)
    assert [str(f) for f in send(device, "202#1C0200")] == ["220#1C0B011900020001"]
    assert [str(f) for f in send(device, "23F#1C")] == ["213#1C0B011900020000", "223#1C0B011900020000"]
    assert [str(f) for f in send(device, "70F#FF")] == ["710#FF0B011900", "720#FF0B011900"]


# -- values -----------------------------------------------------------------------------------------------------------


def test_only_the_pressed_patch_falls_and_by_its_shift():
    newtons = np.zeros(240)
    pressed = 10 * 7 + np.arange(4)
    newtons[pressed] = [0.1, 0.2, 0.3, 9.0]
    for shift, expected in ((2, [225, 210, 195, 0]), (3, [233, 225, 218, 0])):
        device = forearm(shift=shift)
        skin = decoded(sample(device, newtons, 0))
        name = device.layout.patches[7].name
        assert name == "3.1" and skin[name][list(TAXEL_PADS[:4])].tolist() == expected
        others = np.concatenate([pads for key, pads in skin.items() if key != name])
        assert set(others) == {240} and set(skin[name][[4, 5, 6, 7, 8, 9, 10, 11]]) == {240}
        flat = np.concatenate([skin[patch.name][list(TAXEL_PADS)] for patch in device.layout.patches])
        assert np.array_equal(flat, device.counts), "the truth is what a perfect driver decodes"


def test_less_than_no_load_reads_above_it():
    """Noise goes both ways; of a real hand 0.7 % of readings are at 255."""
    device = forearm()
    for pull, expected in ((0.02, 243), (3.0, 255)):
        sample(device, -pull)
        assert set(device.counts.tolist()) == {expected}


def test_set_up_while_pressed_makes_the_press_no_load():
    device = forearm()
    sample(device, 0.3, 0)
    tell(device, 1, "50000202010022")
    sample(device, 0.3)
    assert device.counts[0] == 240 and device.counts[239] == 195
    sample(device)
    assert device.counts[0] == 255, "240 + 180 / 4 is more than a byte holds"


GAIN = np.array([70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77])
GAIN_V2 = np.array([58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86])
WARMER = np.where(np.isin(np.arange(12), (6, 10)), 128, GAIN) * 20 / 128
"""Raw counts per degree."""


@pytest.mark.parametrize(("kind", "gain"), [(0, GAIN), (1, 0 * GAIN), (2, 0 * GAIN), (8, GAIN_V2), (5, 0 * GAIN)])
@pytest.mark.parametrize("degrees", [10, -10])
def test_what_is_compensated_is_the_thermal_pad_times_a_gain(kind, gain, degrees):
    device = forearm(kind=kind)
    pads = decoded(sample(device, temperature=25.0 + degrees))["1.0"]
    change, thermal = np.round(WARMER * degrees).astype(int), 20 * degrees
    drift = (thermal // 4 * gain) >> 5 if thermal > 0 else -(-thermal // 4 * gain) >> 5
    assert pads.tolist() == np.clip(240 - ((change - drift) >> 2), 0, 255).tolist()
    if kind == 0:
        assert set(pads[list(TAXEL_PADS)]) <= {239, 240, 241} and set(pads[[6, 10]]) == {
            240 - degrees * 5 if degrees > 0 else 255
        }


def test_a_compensated_press_on_a_warm_skin_reads_nearly_as_on_a_cold_one():
    device = forearm()
    cold, warm = (
        decoded(sample(device, 0.2, temperature=degrees))["1.0"][list(TAXEL_PADS)] for degrees in (25.0, 40.0)
    )
    assert np.abs(cold - warm).max() <= 1


def test_test_mode_is_the_low_byte_of_the_raw_value():
    device = forearm(kind=7)
    frames = sample(device, 0.3)
    assert set(decoded(frames)["1.0"][list(TAXEL_PADS)]) == {180} and {f.data[7] for f in frames[1::2]} == {0}


def test_an_ergo_hand_is_sent_in_another_order_with_fingertips_as_they_are():
    device = fp.create("icub_skin", part="upper_arm")
    tell(device, 1, "4D0314F0", "50000F02010022", START)
    warm = decoded(sample(device, temperature=35.0))
    change = np.round(WARMER * 10).astype(int)
    for name, gain in (("1.1", 0 * GAIN), ("1.12", GAIN_V2)):
        assert warm[name].tolist() == (240 - ((change - (50 * gain >> 5)) >> 2)).tolist()
    newtons = np.zeros(350)
    newtons[10 * 4] = 0.1  # chip 4, sent as 1
    pressed = decoded(sample(device, newtons))
    assert [name for name, pads in pressed.items() if (pads < 240).any()] == ["1.1"]


@pytest.mark.parametrize(
    ("newtons", "is_out"), [(3.15, False), (3.25, True), (-0.15, False), (-0.25, True), (1e3, True)]
)
def test_out_of_range_is_twice_the_change_that_reaches_an_end(newtons, is_out):
    device = forearm()
    pushes = np.zeros(240)
    pushes[[0, 6]] = newtons  # pads 0 and 7 of triangle 1.0
    tail = next(f for f in sample(device, pushes, 0) if f.arbitration_id == 0x410 and f.data[0] == 0xC0)
    mask = tail.data[6] << 4 | tail.data[7] >> 4
    assert mask == is_out * (1 << 0 | 1 << 7) and tail.data[7] & 0xF == 0


def test_faulty_triangles_say_so_and_every_fifth_that_is_unheard_recalibrates():
    device = fp.create("icub_skin", no_ack=["1.1"], not_connected=["1.2"])
    tell(device, 1, "4D0214F0", "50000202010022", START)
    frames = sample(device, 0.2, 0)
    flags = {f.arbitration_id & 15: f.data[7] & 15 for f in frames if f.data[0] == 0xC0}
    assert flags == {0: 0, 1: 1, 2: 2}
    assert set(decoded(frames)["1.1"]) == {255} and set(decoded(frames)["1.2"]) == {240}
    felt = [decoded(sample(device, 0.2, 0))["1.0"][0] for _ in range(6)]
    assert felt == [210, 210, 210, 210, 240, 240], "what was pressed is no load from then on"


# -- geometry ---------------------------------------------------------------------------------------------------------


def test_triangle_is_a_lattice_of_ten_with_thermal_pads_in_its_gaps():
    taxels = PAD_PLACES_M[list(TAXEL_PADS)]
    assert np.allclose(taxels.mean(axis=0), 0, atol=1e-9)
    nearest = np.sort(cdist(taxels, taxels) + 9 * np.eye(10), axis=1)[:, 0]
    assert np.allclose(nearest, PITCH_M)
    assert np.allclose(cdist(PAD_PLACES_M[[1, 5, 9]], PAD_PLACES_M[[1, 5, 9]])[np.triu_indices(3, 1)], 3 * PITCH_M)
    assert cdist(PAD_PLACES_M[[6, 10]], taxels).min() > 0.5 * PITCH_M


def test_forearm_taxels_keep_their_distance_and_normals_point_out():
    layout = fp.create("icub_skin").layout
    assert len(layout) == 240 and len(layout.patches) == 24
    radial = layout.positions * [1, 1, 0]
    assert np.allclose(np.linalg.norm(radial, axis=1), FOREARM_RADIUS_M)
    assert np.allclose(layout.normals, radial / FOREARM_RADIUS_M)
    distances = cdist(layout.positions, layout.positions) + np.eye(240)
    assert 0.9 * PITCH_M < distances.min() < PITCH_M
    assert np.sort(distances, axis=1)[:, 0].max() < 1.01 * PITCH_M
    centres = np.array([layout.positions[p.taxels].mean(axis=0) for p in layout.patches])
    apart = np.sort(cdist(centres, centres) + np.eye(24), axis=1)[:, 0]
    assert np.allclose(apart, SIDE_M / np.sqrt(3), rtol=0.05), "neighbours share a side"


def test_one_flat_triangle():
    device = fp.create("icub_skin", part="triangle", first_board=9)
    assert len(device.layout) == 10 and device.layout.patches[0].name == "9.0"
    assert np.allclose(device.layout.normals, [0, 0, 1])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"part": "leg"}, "part"),
        ({"triangles_per_board": 0}, "triangles_per_board"),
        ({"triangles_per_board": 1}, "more triangles"),
        ({"first_board": 9}, "9..16"),
        ({"no_ack": ["1.9"]}, "no triangle '1.9'"),
    ],
)
def test_bad_options_are_refused(options, match):
    with pytest.raises(ValueError, match=match):
        fp.create("icub_skin", **options)


# -- other parts and old firmware -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("part", "taxels", "boards"), [("upper_arm", 350, 3), ("torso", 440, 3), ("hand", 100, 1), ("triangle", 10, 1)]
)
def test_taxels_of_the_parts_and_their_boards(part, taxels, boards):
    device = fp.create("icub_skin", part=part)
    assert len(device.layout) == taxels and len(device.boards) == boards
    distances = cdist(device.layout.positions, device.layout.positions)
    assert distances[~np.eye(taxels, dtype=bool)].min() > 0.0035


def test_all_pads_of_a_fingertip_feel_and_a_palm_has_numbers_8_to_11():
    device = fp.create("icub_skin", part="hand", first_board=5)
    tell(device, 5, "4D0114F0", "50000F02010022", START)
    skin = decoded(sample(device, {"5.4": np.full((4, 3), 0.1), "5.11": np.full(10, 0.2)}))
    assert list(skin) == [f"5.{number}" for number in range(16)]
    assert set(skin["5.4"]) == {225} and set(skin["5.11"]) == {210, 240} and set(skin["5.3"]) == {240}
    assert [patch.link for patch in device.layout.patches] == [*"index middle ring little thumb".split(), *["palm"] * 4]


def test_a_set_up_names_triangles_by_their_numbers():
    device = fp.create("icub_skin", part="hand")
    tell(device, 1, "4D0114F0", "50040802010022", START)
    assert list(decoded(sample(device))) == [f"1.{t}" for t in range(4, 9)]


def test_old_firmware_sends_under_class_3_and_knows_no_new_set_up():
    device = fp.create("icub_skin", firmware="old")
    tell(device, 3, "4E000000", "4C000000")
    assert [f"{f.arbitration_id:03X}" for f in sample(device)[:6]] == ["330", "330", "331", "331", "332", "332"]
    tell(device, 3, "4D0014F0", "50000202010022")
    assert device.counters["unknown_command"] == 2 and len(sample(device)) == 32
    tell(device, 3, "0701")
    assert sample(device) == []


def test_a_hand_rests_as_a_real_one_and_falls_from_there():
    """A dataset of grasps: 241.9 counts on average where nothing presses, 3.4 from pad to pad."""
    device = fp.create("icub_skin", part="hand", pattern="measured")
    board = device.boards["board 1"]
    for after in ((bytes.fromhex("4D0114F0"),), (bytes.fromhex("5000040201" + "0022"),)):
        for data in after:
            board.obey(data)
        tips = board.convert(np.zeros(len(board.taxels)), np.full(len(board.taxels), 25.0))[:5].astype(float)
        assert tips.mean() == pytest.approx(241.9, abs=0.5) and tips.std() == pytest.approx(3.4, abs=0.2)
    pressed = board.convert(np.full(len(board.taxels), 0.1), np.full(len(board.taxels), 25.0))[:5]
    assert (tips - pressed == 15).all()
