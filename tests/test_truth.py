"""The truth log keeps what it was told, bit for bit."""

import numpy as np
import pytest

from firmware_protocols import CanFrame
from tactemu import truth
from tactemu.errors import TactemuError


def test_log_round_trip_is_bit_exact(tmp_path):
    path = tmp_path / "truth.jsonl"
    log = truth.Truth(path)
    counts = np.array([[0.1, -2.5e-30], [1e30, 3.0]], np.float32)
    log.sample(5, "a", np.arange(3.0), np.arange(3.0) / 7, counts)
    log.wrote(6, "a", b"\x01\xff")
    log.wrote(7, "b", CanFrame(arbitration_id=0x27, data=b"\xb1\xc6"))
    log.inject(8, "a", "flip", "byte 3 bit 1")
    log.dropped(9, "a", b"\x00", "line full")
    log.close()
    rows = list(truth.read(path))
    assert [row["kind"] for row in rows] == ["sample", "tx", "tx", "inject", "drop"]
    assert np.array_equal(np.array(rows[0]["counts"], np.float32), counts)
    assert np.array_equal(rows[0]["measured"], np.arange(3.0) / 7)
    assert rows[1]["data"] == "01ff" and rows[2]["data"] == "027#B1C6"
    assert log.injected["flip"] == 1


def test_a_damaged_log_names_its_line(tmp_path):
    path = tmp_path / "t.jsonl"
    path.write_text('{"t_ns": 1, "kind": "event", "what": "opened"}\nnot json\n')
    with pytest.raises(TactemuError, match=r"t\.jsonl: not a truth log: line 2"):
        list(truth.read(path))


def test_samples_are_copies():
    log = truth.Truth()
    values = np.zeros(2)
    log.sample(0, "a", values, values, values)
    values[:] = 1
    assert not log.samples[0].counts.any()
