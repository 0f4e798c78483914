"""Devices on real Linux CAN: candump, canbusload and python-can see what the table says."""

import re
import socket
import subprocess
import tempfile
import time
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

import tactemu
from firmware_protocols import CanFrame
from firmware_protocols.devices.icub_triangles import TAXEL_PADS
from tactemu.wire.can_bits import frame_bits
from tests.drivers.rig import EQUAL

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(500)]
DATA = Path(__file__).parents[1] / "data"
BOARDS = range(1, 9)
FRAMES = len(BOARDS) * 3 * 2
"""The frames of one sample: a head and a tail for each of three triangles of a board."""


def cansend(*frames: str) -> None:
    for frame in frames:
        subprocess.run(["cansend", "vcan0", frame], check=True, timeout=10)


RECEIVE_BUFFER = 1 << 24
"""Bytes that the kernel keeps for a reader: on a busy machine one that is not scheduled for a moment loses nothing."""
SO_RCVBUFFORCE = 33
"""The option of Linux that sets it beyond the limit of ordinary users; ``socket`` does not name it."""


class Candump:
    """``candump -L`` on vcan0 while the block runs; ``frames`` lists (time [s], id, data) afterwards."""

    def __enter__(self):
        self._out = tempfile.TemporaryFile("w+")  # a pipe would fill up
        self._dump = subprocess.Popen(["candump", "-L", "-r", str(RECEIVE_BUFFER), "vcan0"], stdout=self._out)
        time.sleep(0.3)
        return self

    def wait(self, dev, count: int, seconds: float = 200.0) -> None:
        """Wait until candump has written so many lines; a busy machine takes longer than the bus."""
        end = time.monotonic() + seconds
        while self._lines() < count and time.monotonic() < end:
            dev.wait(0.2)

    def _lines(self) -> int:
        return Path(f"/proc/self/fd/{self._out.fileno()}").read_bytes().count(b"\n")

    def __exit__(self, *_):
        time.sleep(0.1)
        self._dump.terminate()
        self._dump.wait(10)
        self._out.seek(0)
        lines = re.findall(r"^\((\S+)\) vcan0 (\w+)#(\w*)", self._out.read(), flags=re.M)
        self._out.close()
        self.frames = [(float(t), int(ident, 16), bytes.fromhex(data)) for t, ident, data in lines]


def skins(frames) -> dict[int, list[dict[int, np.ndarray]]]:
    """For each board its whole periods: triangle -> 12 pads; a triangle's tail must follow its own head."""
    boards, heads = {board: [] for board in BOARDS}, {}
    for _, ident, data in frames:
        if ident >> 8 != 4:
            continue
        board, triangle = ident >> 4 & 15, ident & 15
        periods = boards[board]
        if data[0] == 0x40:
            assert board not in heads, f"{heads[board]} has no tail"
            heads[board] = (triangle, data[1:8])
            if triangle == 0:
                periods.append({})
            continue
        assert data[0] == 0xC0 and data[6:] == b"\0\0"
        head = heads.pop(board, None)
        if head is None and not periods:
            continue  # candump came in between
        assert head is not None and head[0] == triangle, f"the tail of {board}.{triangle} follows {head}"
        if periods:
            periods[-1][triangle] = np.frombuffer(head[1] + data[1:6], np.uint8)
    return {board: periods[:-1] for board, periods in boards.items()}


@pytest.mark.judge("icub_skin", driver="can-utils", carrier="CAN")
def test_icub_forearm_of_240_taxels_at_50_hz_on_one_bus():
    with tactemu.serve(DATA / "scenes" / "icub_forearm_moving.toml", "can:socketcan:vcan0", steer=["ball"]) as dev:
        for message in ("4D0014F0", "50000202010022", "0700"):
            cansend(*(f"20{board}#{message}" for board in BOARDS))
        judge = subprocess.Popen(
            ["stdbuf", "-oL", "canbusload", "-e", "vcan0@1000000"], stdout=subprocess.PIPE, text=True
        )
        with Candump() as at_rest:
            at_rest.wait(dev, 100 * FRAMES)
        judge.terminate()
        load, _ = judge.communicate(timeout=10)
        dev.press(depth=0.003, speed=0.02)
        with Candump() as pressed:
            pressed.wait(dev, 50 * FRAMES)
        layout, samples = dev.device().layout, list(dev.truth.samples)

    rest = skins(at_rest.frames)
    assert min(map(len, rest.values())) >= 95
    assert all(set(period) == {0, 1, 2} for periods in rest.values() for period in periods)
    values = [pads for periods in rest.values() for period in periods for pads in period.values()]
    assert (np.array(values) == 240).all()
    _load_agrees(load, at_rest.frames)

    fallen = np.zeros(len(layout), bool)
    taxels = {patch.name: patch.taxels for patch in layout.patches}
    sent = {name: {sample.counts[at].astype(np.uint8).tobytes() for sample in samples} for name, at in taxels.items()}
    for board, periods in skins(pressed.frames).items():
        for triangle, pads in ((triangle, pads) for period in periods for triangle, pads in period.items()):
            felt, name = pads[list(TAXEL_PADS)], f"{board}.{triangle}"
            assert felt.tobytes() in sent[name]
            assert {int(pads[k]) for k in (6, 10)} == {240}
            fallen[taxels[name]] |= felt < 240
    assert 0 < fallen.sum() < 80, "the pressed patch and only it"
    middle = layout.positions[fallen].mean(axis=0)
    assert np.linalg.norm(layout.positions[fallen] - middle, axis=1).max() < 0.045


def _load_agrees(text: str, frames) -> None:
    """``canbusload -e`` counts (with exact stuffing) the bits that we do for the frames that candump saw."""
    seconds = [(int(m[1]), int(m[2])) for m in re.finditer(r"vcan0@\d+ +(\d+) +(\d+)", text) if int(m[1]) > 0]
    assert len(seconds) >= 2, text
    bits = [sum(frame_bits(CanFrame(arbitration_id=i, data=d))) for _, i, d in frames if i >> 8 == 4]
    assert [b / n for n, b in seconds] == pytest.approx([np.mean(bits)] * len(seconds), rel=0.003)
    computed = sum(bits) / (frames[-1][0] - frames[0][0])
    reported = np.mean([b for _, b in seconds[1:]])  # the first second is not full
    assert reported == pytest.approx(computed, rel=0.2), "a busy machine's seconds are not all of one length"
    assert computed / 1e6 < 0.30, "48 frames of 8 bytes, 50 times a second: 27 % if the machine keeps up"


def _wait_until_silent(reader: can.BufferedReader, dev) -> None:
    """Wait until half a second has brought no frame, so that all readers have all of them; 20 s at most."""
    for _ in range(40):
        before = reader.buffer.qsize()
        dev.wait(0.5)
        if reader.buffer.qsize() == before:
            return
    raise AssertionError("frames still come 20 s after the stop")


@pytest.mark.judge("xela_uskin", driver="cantools", carrier="CAN")
def test_uskin_is_seen_by_candump_python_can_and_cantools():
    dbc = cantools.database.load_file(DATA / "xela_uskin.dbc")
    with tactemu.serve("xela_uskin", "can:socketcan:vcan0") as dev, can.Bus("vcan0", "socketcan") as bus:
        bus.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER)
        assert bus.recv(0.1) is None, "silent until started"
        reader = can.BufferedReader()
        with Candump() as dump, can.Notifier(bus, [reader]):
            cansend("201#0700")
            dev.press(depth=1e-3, dwell=0.3)
            cansend("201#0701")
            _wait_until_silent(reader, dev)
        samples = {sample.counts.astype(np.uint16).tobytes() for sample in dev.truth.samples}
        received = list(iter(lambda: reader.get_message(0), None))
    seen = [(ident, data) for _, ident, data in dump.frames if ident != 0x201]
    assert [(m.arbitration_id, bytes(m.data)) for m in received if m.arbitration_id != 0x201] == seen
    assert len(seen) >= 16 * 20 and len(seen) % 16 == 0
    for k in range(0, len(seen), 16):
        batch = seen[k : k + 16]
        assert [ident for ident, _ in batch] == list(range(0x710, 0x720))
        decoded = [dbc.decode_message(ident, data) for ident, data in batch]
        assert np.array([[d[a] for a in "XYZ"] for d in decoded], np.uint16).tobytes() in samples
    EQUAL.append(len(seen) // 16)
