"""Recordings: each format gives back what went in, and other people's readers and writers agree."""

import can
import numpy as np
import pytest

from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError
from tactemu.base.formats import CAN_FRAMES, RECORDABLE
from tactemu.base.frame_text import parse, text
from tactemu.emulator.playback import RecordedReadings
from tactemu.truth import Truth
from tactemu.truth.recorder import Recorder
from tactemu.truth.recording import load
from tests.truth.telling import passed

CANDUMP = """\
(1700000000.000000) can0 027#B100010203040506
(1700000000.000250) can0 18FF0001#AA
(1700000000.001000) can0 123##1{fd}
(1700000000.002000) can0 7FF#R
""".format(fd="11" * 16)

FRAMES = [
    CanFrame(arbitration_id=0x27, data=bytes.fromhex("b100010203040506")),
    CanFrame(arbitration_id=0x18FF0001, data=b"\xaa", is_extended_id=True),
    CanFrame(arbitration_id=0x123, data=b"\x11" * 16, is_fd=True, bitrate_switch=True),
    CanFrame(arbitration_id=0x7FF, is_remote_frame=True),
]
TIMES = [0, 250_000, 1_000_000, 2_000_000]


@pytest.mark.parametrize("suffix", [each.suffix for each in RECORDABLE])
def test_can_comes_back_as_it_was(tmp_path, suffix):
    entries = [
        passed(1_000_000 + t, frame, "rx" if k == 1 else "tx") for k, (t, frame) in enumerate(zip(TIMES, FRAMES))
    ]
    if suffix == ".log":
        entries = [entry for entry in entries if entry.kind == "tx"]
    with Recorder(tmp_path / f"x{suffix}") as recorder:
        for entry in entries:
            recorder.add(entry)
    back = load(tmp_path / f"x{suffix}")
    assert [entry.frame for entry in back.entries] == [entry.frame for entry in entries]
    assert [entry.kind for entry in back.entries] == [entry.kind for entry in entries]
    assert [entry.t_ns for entry in back.entries] == pytest.approx(
        [entry.t_ns - 1_000_000 for entry in entries], abs=1000
    )
    assert back.kind == "can"


def test_a_candump_log(tmp_path):
    """Read the format of can-utils' `candump -L`."""
    (tmp_path / "x.log").write_text(CANDUMP)
    recording = load(tmp_path / "x.log")
    assert [entry.frame for entry in recording.entries] == FRAMES
    assert [entry.t_ns for entry in recording.entries] == pytest.approx(TIMES, abs=1000)
    assert recording.towards_driver() == recording.entries


@pytest.mark.parametrize("suffix", [each.suffix for each in RECORDABLE if each.holds == CAN_FRAMES])
def test_python_can_reads_what_we_write(tmp_path, suffix):
    with Recorder(tmp_path / f"x{suffix}") as recorder:
        for t, frame in zip(TIMES, FRAMES[:2]):
            recorder.add(passed(t, frame))
    with can.LogReader(tmp_path / f"x{suffix}") as reader:
        messages = list(reader)
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in messages] == [
        (frame.arbitration_id, frame.data, frame.is_extended_id) for frame in FRAMES[:2]
    ]


@pytest.mark.parametrize("suffix", [".jsonl", ".mcap"])
def test_serial_comes_back_as_it_was_with_its_speed(tmp_path, suffix):
    rng = np.random.default_rng(1)
    entries = [passed(k * 10_000_000, rng.bytes(k % 50 + 1), "rx" if k % 7 == 0 else "tx") for k in range(100)]
    with Recorder(tmp_path / f"x{suffix}", line="baud 460800", device="hand") as recorder:
        for entry in entries:
            recorder.add(entry)
    back = load(tmp_path / f"x{suffix}")
    assert back.baud == 460_800 and back.kind == "serial"
    assert [(e.t_ns, e.frame, e.kind, e.device) for e in back.entries] == [
        (e.t_ns, e.frame, e.kind, "hand") for e in entries
    ]


@pytest.mark.parametrize("suffix", [".jsonl", ".mcap"])
def test_a_truth_log_is_a_recording_and_a_source(tmp_path, suffix):
    path = tmp_path / f"truth{suffix}"
    truth = Truth(path)
    readings = np.random.default_rng(2).normal(size=(5, 4, 3)).astype(np.float32)
    for k, reading in enumerate(readings):
        truth.sample(k * 10, "pad", reading, 2 * reading, np.zeros(4))
        truth.wrote(k * 10 + 1, "pad", bytes([k]))
    truth.close()
    assert [entry.frame for entry in load(path).entries] == [bytes([k]) for k in range(5)]
    source = RecordedReadings(path)
    for t, k in ((0, 0), (9, 0), (10, 1), (19, 1), (1000, 4), (20, 2)):
        source.advance_to(t)
        assert np.array_equal(np.float32(source.quantity("force", ground_truth=True)), readings[k])
        assert np.array_equal(np.float32(source.quantity("force")), 2 * readings[k])
    with pytest.raises(TactemuError, match=r"no skin 'thumb' \(skins: pad\)"):
        RecordedReadings(path, "thumb")


@pytest.mark.parametrize(
    "frame", [*FRAMES, b"", b"\x00\xff", CanFrame(arbitration_id=8, is_error_frame=True)], ids=text
)
def test_text_of_a_frame_and_back(frame):
    assert parse(text(frame)) == frame


@pytest.mark.parametrize(
    ("switch", "now", "formerly"), [(True, "18FF0001##5AABB", "18FF0001##1AABB"), (False, "123##4", "123##0")]
)
def test_flags_of_an_fd_frame_are_those_of_candump_and_those_of_before_are_read(switch, now, formerly):
    frame = parse(formerly)
    assert (frame.is_fd, frame.bitrate_switch, text(frame)) == (True, switch, now)
    assert parse(now) == frame


def test_an_error_frame_is_written_as_candump_shows_it(tmp_path):
    """Write what ``candump -L`` writes: the class of the error (8: protocol) with the error flag, and eight bytes."""
    disturbed = CanFrame(arbitration_id=0x27, data=b"\x01", is_error_frame=True)
    assert text(disturbed) == "20000008#0000000000000000"
    (tmp_path / "x.log").write_text(f"(1.0) can0 {text(disturbed)}\n{CANDUMP}")
    assert [entry.frame for entry in load(tmp_path / "x.log").entries] == FRAMES, "nobody sends an error frame"


@pytest.mark.parametrize("suffix", [".dump", ".candump"])
def test_a_candump_log_by_its_other_names(tmp_path, suffix):
    (tmp_path / f"x{suffix}").write_text(CANDUMP)
    assert [entry.frame for entry in load(tmp_path / f"x{suffix}").entries] == FRAMES


@pytest.mark.parametrize("suffix", [".trc", ".csv"])
def test_more_formats_of_python_can(tmp_path, suffix):
    with can.Logger(tmp_path / f"x{suffix}") as logger:
        for k in range(3):
            logger.on_message_received(
                can.Message(timestamp=1 + k / 10, arbitration_id=0x100 + k, data=[k], is_extended_id=False)
            )
    back = load(tmp_path / f"x{suffix}")
    assert [(e.frame.arbitration_id, e.frame.data) for e in back.entries] == [(0x100 + k, bytes([k])) for k in range(3)]
    assert [e.t_ns for e in back.entries] == pytest.approx([0, 100_000_000, 200_000_000], abs=1_000_000)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("x.txt", "", "expected .mcap, .jsonl, .csv, .log"),
        ("x.jsonl", "{]\n", "not a"),
        ("x.jsonl", '{"kind": "tx", "t_ns": 1}\n', "line 1: data: expected a text, got nothing"),
        ("x.jsonl", '{"kind": "tx", "t_ns": 1, "data": "0g"}\n', "not a truth log: line 1"),
        ("x.asc", "nonsense\n", "no CAN frame in it"),
        ("x.csv", "nonsense\n", "no CAN frame in it"),
        ("x.blf", "nonsense" * 100, "not a recording: Unexpected file format"),
        ("x.mf4", "nonsense", "not a recording"),
        ("x.log", "nonsense\n", "not a recording"),
        ("missing.log", None, "No such file"),
        ("missing.jsonl", None, "No such file"),
    ],
)
def test_wrong_files_say_what_is_wrong(tmp_path, name, content, complaint):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(TactemuError, match=complaint):
        load(tmp_path / name)


def test_bytes_do_not_fit_into_a_can_format(tmp_path):
    with (
        Recorder(tmp_path / "x.log") as recorder,
        pytest.raises(TactemuError, match=r"bytes to \.mcap or \.jsonl"),
    ):
        recorder.add(passed(0, b"bytes"))
    with pytest.raises(TactemuError, match=r"'\.mcp'; did you mean '\.mcap'\?; expected \.mcap, "):
        Recorder(tmp_path / "x.mcp")
    with pytest.raises(TactemuError, match="cannot write"):
        Recorder(tmp_path / "no" / "x.jsonl")
