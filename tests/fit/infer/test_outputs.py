"""What an inference writes: a device file that the check takes, a DBC file, a picture, a report."""

import json
import struct
from dataclasses import replace

import cantools
import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import sums
from firmware_protocols.check import check
from firmware_protocols.check.host import Host, Subject
from tactemu.base.errors import TactemuError
from tactemu.fit.infer.analysis import infer
from tactemu.fit.infer.captures import Capture, Chunk
from tactemu.fit.infer.catalogue import Match, match_catalogue
from tactemu.fit.infer.commands import InferFiles, run_infer
from tactemu.fit.infer.device_file import device_file
from tactemu.fit.infer.frame_texts import Coverage
from tactemu.fit.infer.report import as_dict, report_lines
from tactemu.fit.infer.running import read_and_infer
from tests.cli.command import here
from tests.fit.infer.captures import dialogue, slow, stream

N = 800


def _frames():
    columns = [slow(N, seed, high=60000, noise=40.0).tolist() for seed in range(6)]
    bodies = [b"\xaa\x55" + struct.pack("<6H", *row) for row in zip(*columns)]
    return [body + struct.pack("<H", sums.crc16_modbus(body)) for body in bodies]


def _written(tmp_path, chunks):
    path = tmp_path / "presses.txt"
    lines = [
        f"{chunk.t_ns / 1e9:.6f} {'>' if chunk.direction == 'rx' else '<'} {chunk.data.hex(' ')}" for chunk in chunks
    ]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("kind", ["stream", "answers", "can"])
def test_the_device_file_passes_the_check(tmp_path, kind):
    frames = _frames()
    if kind == "stream":
        chunks = stream(frames)
    elif kind == "answers":
        chunks = dialogue([(b"\x01\x03\x10", frame) for frame in frames])
    else:
        chunks = [Chunk(k * 10_000_000, "tx", frame[2:10], id=0x201) for k, frame in enumerate(frames)]
    path = tmp_path / "my_sensor.py"
    path.write_text(device_file(infer(chunks), path, [tmp_path / "presses.mcap"]))
    report = check(f"{path}:MySensor", {}, fuzz=50)
    assert report.ok, report.lines()
    assert ("@command('01 03 10'" in path.read_text()) == (kind == "answers")


def test_every_byte_of_a_capture_comes_back(tmp_path):
    draft, coverage = read_and_infer([_written(tmp_path, stream(_frames()))])
    assert coverage.encoded == coverage.sent == sum(map(len, _frames()))
    assert coverage.values / coverage.sent == pytest.approx(12 / 16)
    assert draft.framing.is_certain


def test_a_long_capture_is_read_in_pieces(tmp_path, monkeypatch):
    monkeypatch.setattr("tactemu.fit.infer.running.LEARNT_BYTES", 8000)
    monkeypatch.setattr("tactemu.fit.infer.running.BLOCK_BYTES", 1000)
    draft, coverage = read_and_infer([_written(tmp_path, stream(_frames()))])
    assert len(draft.chunks) < N
    assert coverage.sent == sum(map(len, _frames()))
    assert coverage.encoded > 0.9 * coverage.sent
    assert coverage.values / coverage.encoded == pytest.approx(12 / 16, abs=0.02)


def test_the_command_writes_all_files(tmp_path):
    capture = _written(tmp_path, stream(_frames()))
    out, picture = tmp_path / "my_sensor.py", tmp_path / "channels.svg"
    said: list[str] = []
    files = InferFiles(out, picture=picture, command="tactemu infer a & b")
    run_infer([capture], catalogue=False, shown=None, files=files, json=True, say=said.append)
    report = json.loads(said[0])
    assert report["framing"]["is_certain"] and report["catalogue"] is None
    assert "class MySensor(Device)" in out.read_text()
    assert picture.read_text().startswith("<svg") and "tactemu infer a &amp; b" in picture.read_text()
    done = here("infer", str(capture), "--no-catalogue", f"--out={out}")
    assert done.returncode == 0 and f"wrote {out}\nnext: `tactemu run {out}:MySensor`" in done.stdout


def test_a_dbc_file_is_of_can_only(tmp_path):
    with pytest.raises(TactemuError, match="a DBC file is of CAN frames"):
        run_infer(
            [_written(tmp_path, stream(_frames()))], catalogue=False, shown=None, json=False, say=lambda _: None,
            files=InferFiles(dbc=tmp_path / "x.dbc"),
        )  # fmt: skip


def test_cantools_reads_the_dbc_file_and_decodes_the_values(tmp_path):
    from tactemu.fit.infer.dbc import dbc_text

    columns = [slow(N, seed, high=60000, noise=40.0).tolist() for seed in range(3)]
    chunks = []
    for k, row in enumerate(zip(*columns)):
        chunks.append(Chunk(k * 10_000_000, "tx", struct.pack(">3H", *row), id=0x123))
    database = cantools.database.load_string(dbc_text(infer(chunks)), "dbc")
    decoded = database.decode_message(0x123, chunks[7].data)
    assert [int(decoded[name]) for name in sorted(decoded)] == [column[7] for column in columns]


def test_what_the_vendors_program_showed_names_its_field(tmp_path):
    from tactemu.fit.infer.channels import read_shown, shown_fields

    frames = _frames()
    values = np.array([struct.unpack_from("<H", frame, 4)[0] for frame in frames[::4]]) * 0.002 + 1
    csv = tmp_path / "vendor.csv"
    csv.write_text("\n".join(["t,Fx", *(f"{k},{value}" for k, value in enumerate(values))]))
    (line,) = shown_fields(infer(stream(frames)), *read_shown(csv))
    assert line.startswith("Fx: byte 4 of")


def _warm_and_pressed(name, seed=1):
    """Return the chunks of a device that streams, warmed and pressed as its own catalogue's model is not."""
    host = Host(Subject(name, fp.device_class(name)).make())
    rng, chunks = np.random.default_rng(seed), []
    for k in range(200):
        host.t_ns += 5_000_000
        host.pushes = 1 + np.sin(k / 9 + np.arange(len(host.device.layout))) + 0.02 * rng.standard_normal()
        for name in host.device.periods:
            senses = host.device.senses_of(name)
            warm = {sense.key: 31 + k / 200 for sense in senses if sense.quantity == "temperature"}
            host.measure(name, **warm)
            for frame in host.streamed(name):
                is_can = isinstance(frame, fp.CanFrame)
                identifier = frame.arbitration_id if is_can else None
                chunks.append(Chunk(host.t_ns, "tx", bytes(frame.data) if is_can else frame, identifier))
    return chunks


@pytest.mark.parametrize("name", ["contactile_papillarray", "eflesh_binary", "nibotics_prvs01", "optoforce_can"])
def test_the_catalogue_recognises_a_warm_and_pressed_sensor(name):
    match = match_catalogue(infer(_warm_and_pressed(name)))
    assert match is not None and match.is_recognised and match.name == name


def test_devices_that_send_the_same_are_named_together():
    match = Match("orca_touch", 1.0, 6, ("a", "b", "c", "d", "e"))
    line = report_lines(infer(stream(_frames())), Coverage(), match)[0]
    assert line == (
        "these are the bytes of orca_touch: 100% of them are in messages like its own; "
        "as well they may be of a, b, c, d and 1 more"
    )


def test_the_nearest_device_is_named_where_none_is_recognised():
    """Half of the bytes have identifiers of no device."""
    own = _warm_and_pressed("optoforce_can")
    chunks = [each for chunk in own for each in (chunk, replace(chunk, id=0x7C0 + (chunk.id or 0) % 8))]
    draft = infer(chunks)
    match = match_catalogue(draft)
    assert match is not None and not match.is_recognised and match.name == "optoforce_can"
    line = report_lines(draft, Coverage(), match)[0]
    assert line.startswith(f"no device of the catalogue is recognised; nearest is optoforce_can: {match.share:.0%} of ")
    assert line.endswith("; `tactemu compare optoforce_can --from CAPTURE` tells what differs")
    report = as_dict(draft, Coverage(), match)
    assert report["catalogue"] is None and report["nearest"]["device"] == "optoforce_can"


def test_bytes_of_no_device_are_near_none():
    rng = np.random.default_rng(3)
    assert match_catalogue(infer(stream([b"\xd3\x91" + rng.bytes(17) for _ in range(200)]))) is None


def test_captures_that_are_none_say_why(tmp_path):
    bad = tmp_path / "bad.hex"
    bad.write_text("no hex")
    with pytest.raises(TactemuError, match="line 1: expected"):
        list(Capture((bad,)).chunks())
    with pytest.raises(TactemuError, match="cannot read the capture"):
        list(Capture((tmp_path / "missing.bin",)).chunks())


def test_candumps_screen_is_read(tmp_path):
    path = tmp_path / "screen.log"
    path.write_text("can1  7F2   [8]  3F 40 25 6A C1 DA D5 F4\ncan1  7F0   [0]\n")
    assert [(chunk.id, len(chunk.data)) for chunk in Capture((path,)).chunks()] == [(0x7F2, 8), (0x7F0, 0)]
