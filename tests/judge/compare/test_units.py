"""The parts of a comparison: sums, cuts, counters, byte orders, presses, settings and numbers of a specimen."""

import json
import random

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Rollover
from firmware_protocols.sums import crc16_modbus, sum8
from tactemu.base.errors import TactemuError
from tactemu.base.sum_search import FrameSum
from tactemu.judge.compare import presses as pressing
from tactemu.judge.compare import sum_rules
from tactemu.judge.compare.answer_check import heads_of
from tactemu.judge.compare.asking import join, literal_bytes
from tactemu.judge.compare.bench import Readings
from tactemu.judge.compare.cutting import ByteStream, cut
from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_checks import check_frames, width_of
from tactemu.judge.compare.frame_classes import CounterField, FrameClass, NumberField
from tactemu.judge.compare.link import RealUdp, buffering_s
from tactemu.judge.compare.presses import Course, Press
from tactemu.judge.compare.report import CompareReport
from tactemu.judge.compare.specimen import measured_table
from tactemu.scene.measured_defaults import measured_defaults
from tactemu.scene.schema import SkinTable
from tests.judge.compare.captures import compared, model_of
from tests.judge.compare.sensors import SPECIMEN


def frames_with(function, size, order, start, *, n=20, change=0):
    rng = random.Random(1)
    bodies = [b"\xaa\x55" + rng.randbytes(9) for _ in range(n)]
    return [body + (function(body[start:]) + change & 256**size - 1).to_bytes(size, order) for body in bodies]


@pytest.mark.parametrize(("start", "order"), [(2, "little"), (0, "big"), (4, "little")])
def test_the_sum_of_frames_is_found(start, order):
    rule = sum_rules.find(frames_with(crc16_modbus, 2, order, start))
    assert (rule.name, rule.start, rule.order) == ("crc16_modbus", start, "<" if order == "little" else ">")


def test_no_sum_is_found_where_there_is_none():
    rng = random.Random(2)
    assert sum_rules.find([rng.randbytes(12) for _ in range(20)]) is None
    assert sum_rules.find([bytes(12)] * 20) is None, "constants prove nothing"


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        (frames_with(sum8, 1, "big", 3), "sum8 from byte 3"),
        (frames_with(sum8, 1, "big", 2, change=0x21), "sum8 from byte 2, plus 21"),
    ],
)
def test_the_sum_that_holds_instead_is_named(frames, words):
    model = sum_rules.find(frames_with(sum8, 1, "big", 2))
    assert words in sum_rules.words(sum_rules.find_instead(model, frames))


def test_a_sum_that_holds_in_some_frames_is_named_with_their_share():
    frames = frames_with(sum8, 1, "big", 2, n=100)
    made = FrameClass("frames", size=len(frames[0]), sum=sum_rules.find(frames))
    damaged = [frame[:-1] + bytes([frame[-1] ^ 0xFF]) for frame in frames[50:54]] + frames[:50] + frames[54:]
    check_frames(made, frames, [], whole := Verdicts())
    check_frames(made, damaged, [], noisy := Verdicts())
    assert whole.agrees == ["frames: sum8 from byte 2"]
    assert noisy.agrees == ["frames: sum8 from byte 2, in 96.0% of 100 frames"]
    other = frames_with(sum8, 1, "big", 3, n=100)
    check_frames(made, other[:98] + damaged[:2], [], differs := Verdicts())
    assert "; sum8 from byte 3 holds in 98%" in str(differs.protocol)


@pytest.mark.parametrize(
    ("name", "constant", "words"),
    [("sum", 0, "sum16"), ("neg", 0, "negative sum16"), ("neg", 0x1234, "negative sum16 from byte 2, plus 1234")],
)
def test_a_sum_of_two_bytes_has_a_name(name, constant, words):
    assert sum_rules.words(FrameSum(-2, 2, 2, -2, name, constant=constant)).startswith(words)


def test_a_stream_is_cut_into_frames_and_what_is_between_them():
    made = FrameClass("frames", size=4, const={0: 0xAA, 1: 0x55}, fixed={0, 1})
    data = b"\x01" + b"\xaa\x55\x01\x02" * 3 + b"\x07\x07" + b"\xaa\x55\x03\x04" * 2 + b"\xaa\x55"
    pieces = cut(data, [made])
    assert [piece.content for piece in pieces if piece.made is None] == [b"\x01", b"\x07\x07", b"\xaa\x55"]
    assert sum(piece.made is made for piece in pieces) == 5


def test_a_byte_has_the_time_of_its_piece():
    view = ByteStream.of([(10, b"ab"), (20, b"c"), (30, b"def")])
    assert [view.time_ns(end) for end in range(1, 7)] == [10, 10, 20, 30, 30, 30]


@pytest.mark.parametrize(("bits", "seen"), [(8, 8), (12, 12), (16, 16)])
def test_the_width_of_a_counter_is_where_it_starts_again(bits, seen):
    values = np.arange(0, 3 << bits, 1 + (1 << bits) // 300) % (1 << bits)
    assert width_of(values, 16)[0] == seen
    assert width_of(np.arange(100), 16) == (None, 0)


def test_a_counter_that_carries_into_a_constant_is_wider():
    made = FrameClass("frames", size=4, const={0: 0xAA, 3: 0}, fixed={0})
    made.counters = [CounterField(Rollover(name="n", bits=8, step=1), 2, "u1")]
    contents = [bytes([0xAA, k % 7, k % 256, k // 256]) for k in range(700)]
    check_frames(made, contents, [], verdicts := Verdicts())
    assert [each.kind for each in verdicts.protocol] == ["counter"]
    assert "carries into byte 3, so that it has 16" in str(verdicts.protocol[0])


@pytest.mark.parametrize("rest", [0, 1000, 30000])
def test_a_byte_order_shows_in_the_noise(rest):
    rng = np.random.default_rng(1)
    values = (rest + rng.normal(0, 3, (200, 4)).round()).astype(">i2")
    made = FrameClass("frames", size=8, numbers=[NumberField(k, 2 * k, "<i2") for k in range(4)])
    check_frames(made, [row.tobytes() for row in values], [(-32768, 32767)] * 4, verdicts := Verdicts())
    assert [each.kind for each in verdicts.protocol] == ["byte order"]
    check_frames(made, [row.astype("<i2").tobytes() for row in values], [(-32768, 32767)] * 4, good := Verdicts())
    assert good.protocol == [] and "byte order of 4 values" in str(good.agrees)


def test_values_that_stand_still_show_no_byte_order():
    made = FrameClass("frames", size=2, numbers=[NumberField(0, 0, "<u2")])
    check_frames(made, [b"\1\0"] * 50, [(0, 4095)], verdicts := Verdicts())
    assert verdicts.protocol == [] and "none changed" in verdicts.unjudged[0]
    check_frames(made, [b"\xff\xff"] * 50, [(0, 4095)], verdicts := Verdicts())
    assert [each.kind for each in verdicts.protocol] == ["range"], "no order has it in range"
    check_frames(made, [b"\x0f\xff"] * 50, [(0, 4095)], verdicts := Verdicts())
    assert [each.kind for each in verdicts.protocol] == ["byte order"], "only the other order has it in range"


def test_literal_bytes_are_those_that_a_documented_answer_states():
    command = fp.Command(name="a", request="00", reply="AA ..{2} 05{2} * 07")
    assert literal_bytes(command) == {0: 0xAA, 3: 5, 4: 5}
    command = fp.Command(name="a", request="200#", reply=["201#05 ..", "202#"])
    joined = join([fp.CanFrame(arbitration_id=0x201, data=b"\5\6"), fp.CanFrame(arbitration_id=0x202)])
    assert all(joined[at] == value for at, value in literal_bytes(command).items())
    assert heads_of(joined) == [(0x201, 0, 2), (0x202, 0, 0)]


# -- presses -----------------------------------------------------------------------------------------------------------


def courses(order, n=5, seconds=12.0, size=500.0):
    """Return the course of n taxels pressed one after the other, as the taxels of ``order``."""
    times = np.arange(0, seconds, 0.01)
    rng = np.random.default_rng(1)
    found = {}
    for taxel in range(n):
        press = order.index(taxel)
        held = (times >= 1 + 2 * press) & (times < 2 + 2 * press)
        found[taxel] = [Course(times, 100 + size * held + rng.normal(0, 2, len(times)))]
    return found, [Press(k, 1 + 2 * k, 2.5 + 2 * k) for k in range(n)]


def test_exchanged_taxels_are_named_by_presses():
    of, pressed = courses([0, 3, 2, 1, 4])
    pressing.check_presses(pressed, of, verdicts := Verdicts())
    assert [each.text for each in verdicts.protocol] == ["taxels 1 and 3 are exchanged"]
    of, pressed = courses([0, 1, 2, 3, 4])
    peaks = pressing.check_presses(pressed, of, verdicts := Verdicts())
    assert verdicts.protocol == [] and all(400 < peak < 600 for peak in peaks.values()) and len(peaks) == 5


def test_other_orders_are_listed_and_soft_presses_are_not_judged():
    of, pressed = courses([1, 2, 0, 3, 4])
    pressing.check_presses(pressed, of, verdicts := Verdicts())
    assert "a press on 0 shows as 1" in str(verdicts.protocol[0])
    of, pressed = courses([0, 1, 2, 3, 4], size=3.0)
    pressing.check_presses(pressed, of, verdicts := Verdicts())
    assert verdicts.protocol == [] and "press harder" in verdicts.unjudged[0]


def test_presses_are_written_and_read(tmp_path):
    pressed = [Press(3, 1.5, 2.25)]
    pressing.write(tmp_path / "p.csv", pressed)
    assert pressing.read(tmp_path / "p.csv") == pressed
    (tmp_path / "p.csv").write_text("taxel,begin\n1,2\n")
    with pytest.raises(TactemuError, match="taxel,begin_s,end_s"):
        pressing.read(tmp_path / "p.csv")


def test_few_taxels_are_all_pressed_and_many_are_sampled_by_patch():
    assert pressing.to_press(fp.create("eflesh_binary")) == [0, 1, 2, 3, 4]
    hand = fp.create("inspire_rh56dftp")
    chosen = pressing.to_press(hand)
    assert 17 <= len(chosen) <= 24 and "row" in pressing.place_of(hand, chosen[0])


# -- results -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def agreed():
    return compared(model_of("optoforce"), lambda: fp.create("optoforce"), Readings(7, noise_n=2.0), skew_ppm=400.0)


def test_the_numbers_of_a_specimen_are_measured(agreed):
    assert agreed.specimen.clock_ppm["frames of 16 bytes"] == pytest.approx(400, abs=5)
    scale = fp.create("optoforce").columns[2].counts_per_unit
    z = next(each for each in agreed.specimen.channels if each.name.endswith("Fz"))
    assert z.noise / scale == pytest.approx(2.0 * 0.6, rel=0.3), "its filter of 15 Hz leaves about 0.6 of it"


def test_the_table_of_a_specimen_is_read_as_measured(agreed, tmp_path, monkeypatch):
    device = fp.create("optoforce")
    (tmp_path / "measured").mkdir()
    (tmp_path / "measured/optoforce.toml").write_text(measured_table(device, agreed.specimen, "here"))
    monkeypatch.chdir(tmp_path)
    skin = measured_defaults(SkinTable.model_validate({"device": "optoforce", "measured": True}))
    assert skin.clock.skew_ppm == pytest.approx(400, abs=5) and skin.options["noise"] > 0


def test_a_report_has_all_and_only_what_agrees_is_evidence(agreed, tmp_path):
    capture = tmp_path / "capture.mcap"
    capture.write_bytes(b"x")
    report = CompareReport("optoforce", "<OMD>", "/dev/ttyACM0", agreed, capture, ["stop"], date="2026-01-01")
    report.write_json(tmp_path / "r.json")
    report.write_html(tmp_path / "r.html")
    read, page = json.loads((tmp_path / "r.json").read_text()), (tmp_path / "r.html").read_text()
    assert read["agrees"] and read["capture"]["sha256"][:4] == "2d71" and read["not_asked"] == ["stop"]
    assert "&lt;OMD&gt;" in page and "measured(" in page
    scope = {}
    exec(f"from firmware_protocols import measured\nfact = {report.evidence().rstrip(',')}", scope)
    assert scope["fact"].basis == "measured" and "SHA-256 2d71" in scope["fact"].where
    agreed.verdicts.find("sum", "frames", "no")
    assert report.evidence() == "" and "1 difference of" in report.verdict
    agreed.verdicts.protocol.clear()


def test_a_setting_is_no_finding_of_the_protocol():
    result = compared(model_of("weiss_wts"), lambda: fp.create("weiss_wts", serial=77, tag="left"), SPECIMEN)
    assert [str(each) for each in result.verdicts.protocol] == [], "a serial number and a tag are the specimen's"
    assert "option `serial`" in str(result.verdicts.notes)


def test_another_device_altogether_is_no_frame_of_the_model():
    made = model_of("optoforce")

    def other(**options):
        device = fp.create("anyskin", **options)
        device.receive = lambda data, t_ns, port: []
        return device

    result = compared(made, other, SPECIMEN)
    assert [each.kind for each in result.verdicts.protocol] == ["framing"]
    assert "cannot be told" in str(result.verdicts.unjudged)


def test_a_stream_that_was_started_before_is_a_note():
    def started(**options):
        device = fp.create("weiss_wts", **options)
        device.pushing = True
        return device

    result = compared(model_of("weiss_wts"), started, SPECIMEN)
    assert result.verdicts.protocol == [] and "switch it off and on" in str(result.verdicts.notes)


def test_a_port_that_cannot_be_reached_is_one_sentence():
    with pytest.raises(TactemuError, match="expected udp:HOST:PORT"):
        RealUdp("udp:nowhere")
    assert buffering_s("/dev/no-such-port") == 0.0


def test_frames_of_varying_length_are_not_judged_by_their_contents():
    result = compared(model_of("matsense"), lambda: fp.create("matsense"), SPECIMEN)
    assert result.verdicts.protocol == [] and "vary in length" in str(result.verdicts.unjudged)


def test_frames_that_nothing_marks_follow_each_other():
    model = model_of("resense_hex")
    (only,) = model.unasked
    assert only.is_unmarked
    pieces = cut(bytes(2 * 28 + 3), [only])
    assert [(each.start, each.end, each.made is only) for each in pieces] == [
        (0, 28, True), (28, 56, True), (56, 59, False),
    ]  # fmt: skip


@pytest.mark.nightly
def test_an_answer_with_the_identifier_of_a_stream_cannot_be_judged():
    model = model_of("linker_hand_o20")
    found = compared(model, lambda: fp.create("linker_hand_o20"), SPECIMEN).verdicts
    assert not found.protocol
    assert "answer to `thumb's touch`: it has the identifier of frames that come unasked" in found.unjudged
