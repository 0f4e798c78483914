"""Unmodified drivers under faults: where a driver counts, it counts what was injected; where it breaks, it breaks as
``docs/drivers-under-faults.md`` says. The whole matrix is ``python -m tests.drivers.matrix``.
"""

import struct
from collections import Counter
from dataclasses import replace

import pytest

from tests.drivers.matrix.bout import Outcome, Ring, served
from tests.drivers.matrix.drivers import DRIVERS
from tests.drivers.matrix.trials import TRIALS
from tests.drivers.rig import run_driver

pytestmark = [pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(180)]


@pytest.fixture
def fight(tmp_path):
    """``fight(name, *faults)`` yields the outcome of each fault, one after the other, with one driver process."""

    def outcomes(name: str, *labels: str, seconds: float = 0.8, **changes):
        driver = replace(DRIVERS[name], seconds=seconds, **changes)
        if not driver.installed:
            pytest.skip(f"{driver.package} is not installed")
        with Ring(name, driver, tmp_path) as ring:
            for label in labels:
                outcome = ring.bout(label, TRIALS[label].against(driver))
                assert outcome.injected > 0 or label == "none", f"{label}: nothing was injected"
                yield label, outcome

    return outcomes


def summary(outcome: Outcome) -> dict[str, int]:
    """What happened to readings, without what did not."""
    names = ("wrong", "refused", "older", "lost", "again")
    return {name: getattr(outcome, name) for name in names if getattr(outcome, name)}


def test_optoforce_counts_every_fault(fight):
    """The driver has a counter and a sum in every packet: each fault is seen exactly as often as it was injected."""
    harmless = ("none", "length", "garbage", "split", "merge", "latency")
    for label, outcome in fight("optoforce", *harmless, "drop", "checksum", "duplicate", "stray", "reorder"):
        n = outcome.injected
        expected = {
            "drop": {"lost": n}, "checksum": {"refused": n, "lost": n}, "duplicate": {"again": n},
            "stray": {"older": n}, "reorder": {"older": n},
        }.get(label, {})  # fmt: skip
        assert summary(outcome) == expected, label
        assert not outcome.errors, label


@pytest.mark.parametrize("fault", ["checksum 10%", "checksum every 7", "flip 10%"])
def test_optoforce_rejects_the_very_frames_that_were_damaged(fault, tmp_path):
    """Not only as many: the packets' counter aligns what the driver says of each with the log of what left.

    A flipped bit in the four bytes of the head makes a packet invisible, elsewhere the sum is wrong.
    """
    with served(DRIVERS["optoforce"], tmp_path) as dev:
        dev.emulator.call(lambda: dev.emulator.wires[0].add_fault(fault))
        packets = run_driver("optoforce", "optoforce_read.py", dev.port, "OptoForce16")
    left = [frame for _, _, frame in dev.truth.frames if len(frame) == 16]  # all of them: nothing runs any more
    head = Counter(frame[:4] for frame in left).most_common(1)[0][0]
    frames = [frame for frame in left if frame[:4] == head]
    sent = [struct.unpack(">H", frame[4:6])[0] for frame in frames]
    first, last = (sent.index(packets[k]["count"]) for k in (0, -1))
    damaged = [sum(frame[:-2]) & 0xFFFF != struct.unpack(">H", frame[-2:])[0] for frame in frames]
    injected = dev.truth.injected.total() - (len(left) - len(frames))
    assert injected - sum(damaged) in (0, 1), "the last may find the port closed"
    assert [not packet["valid_checksum"] for packet in packets] == damaged[first : last + 1]
    assert sum(damaged[first : last + 1]) > 5


def test_anyskin_has_no_checksum_and_hands_out_wrong_fields(fight):
    for label, outcome in fight("anyskin", "drop", "duplicate", "stray", "flip", "truncate"):
        n, what = outcome.injected, summary(outcome)
        if label in ("drop", "duplicate", "stray"):
            assert what == {{"drop": "lost", "duplicate": "again", "stray": "older"}[label]: n}
        elif label == "flip":  # a bit of the two bytes at the end costs this frame and the next
            assert 0 < outcome.wrong <= n <= outcome.lost == outcome.wrong + 2 * (n - outcome.wrong)
        else:
            assert outcome.wrong == 0 and n < outcome.lost <= 2 * n, "each short frame costs the next one, too"
        assert outcome.recovered is not None and not outcome.errors, label


@pytest.mark.parametrize("name", ["anyskin", "reskin-sensor"])
def test_a_reader_that_reopens_survives_unplugging(fight, name):
    for _, outcome in fight(name, "unplug"):
        assert set(outcome.errors) & {"OSError", "SerialException"} and outcome.errors.total() >= 1
        assert outcome.wrong == 0 and outcome.recovered is not None


def test_ability_hand_counts_failed_checksums(fight, tmp_path):
    for label, outcome in fight("ability-hand", "checksum", "drop", "request lost", "truncate"):
        n, own = outcome.injected, outcome.counters
        assert outcome.wrong == 0 and outcome.recovered is not None, label
        if label == "checksum":
            assert own["checksum failed"] == n
        else:  # its packet loss: commands less answers; one may be on its way at either end
            n += own["wire dropped_readings"]  # answers to commands that a busy machine handed over all at once
            assert n - 1 <= own["writes"] - own["reads"] <= n + 1, label


def test_ability_hand_never_opens_a_port_again(fight):
    for _, outcome in fight("ability-hand", "unplug", patience_s=2.0):
        assert outcome.recovered is None and not outcome.errors, "its read thread logs the exception and goes on"
        assert outcome.restart_helps


@pytest.mark.parametrize("name", ["pymodbus", pytest.param("modbus_tk", marks=pytest.mark.nightly)])
def test_modbus_masters_report_every_fault_and_no_wrong_register(fight, name):
    for label, outcome in fight(name, "drop", "request lost", "flip", seconds=1.5):
        assert outcome.errors.total() == outcome.injected, (label, outcome.texts)
        assert summary(outcome).keys() <= {"again"}, label
        assert outcome.recovered is not None


@pytest.mark.nightly
def test_modbus_tcp_hands_out_flipped_registers(fight):
    """TCP framing has no CRC: a bit that changes behind TCP's own checksum reaches the user.

    A reading is three answers of which one is judged, and a flip in an answer's head makes the driver wait for seconds:
    a bout may pass in which no judged number was hit.
    """
    wrong = 0
    for _, outcome in fight("plusml-rh56dftp", *["flip"] * 6, seconds=1.2, share="every 7"):
        assert outcome.recovered is not None and outcome.restart_helps is None
        assert outcome.wrong <= outcome.injected
        wrong += outcome.wrong
        if wrong:
            break
    assert wrong > 0


def test_linkerbot_times_out_for_every_lost_row(fight):
    for label, outcome in fight("linkerbot", "drop", "request lost", seconds=2.0, share="0.5%"):
        assert dict(outcome.errors) == {"TimeoutError": outcome.injected}, label
        assert outcome.wrong == 0 and outcome.recovered is not None, label


def test_pyrobotiqtactile_repeats_its_last_reading_for_ever_after_a_reset(fight):
    for label, outcome in fight("pyrobotiqtactile", "drop", "reset", patience_s=2.5):
        if label == "drop":
            assert outcome.wrong == 0 and outcome.lost >= outcome.injected, "and of two packets it keeps the last"
            continue
        assert outcome.recovered is None and not outcome.errors and outcome.again > 0, "it does not notice"
        assert outcome.restart_helps, "which sends the command to stream"


@pytest.mark.nightly
def test_flexitac_takes_a_cut_image_for_a_whole_one(fight):
    for label, outcome in fight("flexitac", "drop", "truncate", seconds=1.5):
        assert outcome.recovered is not None and not outcome.errors, label
        assert (outcome.wrong > 0) == (label == "truncate"), label
