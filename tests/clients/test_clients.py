"""What unmodified drivers sent comes again, and every byte and value that they got."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from tests.clients.recording import MAX_BYTES, Recording, Row, recordings
from tests.clients.replay import differences, replay

PATHS = list(recordings())


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_driver_gets_what_it_got(path: Path):
    recorded = Recording.load(path)
    assert path.stem == f"{recorded.about['device']}-{recorded.about['driver']}"
    assert path.stat().st_size <= MAX_BYTES
    assert recorded.sent and (recorded.events or recorded.rows)
    counted = {name for each in recorded.about["counters"].values() for name, count in each.items() if count}
    assert counted - {"requests"} == set(recorded.about.get("expected_counters", {})), "something was left over"
    again, made = replay(recorded)
    assert differences(recorded, again, made) == []


@pytest.mark.parametrize("path", PATHS[:1], ids=lambda path: path.stem)
def test_another_byte_and_another_value_are_seen(path: Path):
    recorded = Recording.load(path)
    again, made = replay(recorded)
    t_ns, wire, frame = recorded.sent[-1]
    recorded.sent[-1] = t_ns, wire, ("0" if frame[0] != "0" else "1") + frame[1:]
    row = recorded.rows[-1]
    recorded.rows[-1] = Row(row.name, row.sample, np.asarray(row.values, float) + 1)
    found = differences(recorded, again, made)
    assert [line.partition(":")[0] for line in found] == [wire, f"decoded {row.name} of sample {row.sample}"]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_the_device_names_the_drivers_that_have_read_it(path: Path):
    about = Recording.load(path).about
    named = fp.create(about["device"]).judge
    if commit := about.get("commit"):
        assert f"{about['repository'].split()[0]}@{commit}" in named
    else:
        packages = [name for name, version in re.findall(r"(\S+) ([\d.]+\w*)", named) if version == about["version"]]
        assert any(about["driver"].startswith(name) for name in packages), f"{about['driver']} {about['version']}"


def test_the_pages_say_what_devices_and_recordings_say():
    script = Path(__file__).parents[2] / "scripts" / "device_pages.py"
    done = subprocess.run([sys.executable, script, "--check"], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
