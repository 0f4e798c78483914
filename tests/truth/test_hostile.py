"""Files that are no recordings, or damaged ones: one sentence each, soon, and nothing else ever."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactemu.base.errors import TactemuError
from tactemu.base.formats import LOGS
from tactemu.cli.truths import summarise
from tactemu.emulator.playback import RecordedReadings
from tactemu.truth import Truth, read_log
from tactemu.truth.recording import load
from tests.cli.command import here
from tests.truth.telling import tell

CORPUS = sorted((Path(__file__).parents[1] / "data" / "hostile_logs").iterdir())
OF_A_RECORDING_ONLY = {"serial_and_can.jsonl", "baud_of_words.jsonl"}
"""Truth logs may hold them; one port cannot replay them."""


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_a_hostile_file_is_refused_in_one_sentence(path):
    ways = [load]
    if path.suffix in [each.suffix for each in LOGS] and path.name not in OF_A_RECORDING_ONLY:
        ways += [read_log, summarise, RecordedReadings]
    for way in ways:
        start = time.process_time()
        with pytest.raises(TactemuError) as caught:
            way(path)
        assert time.process_time() - start < 5
        said = str(caught.value)
        assert said.startswith(f"{path}: ") and "\n" not in said and len(said) < 400


@pytest.mark.parametrize("name", ["nested_deeply.jsonl", "serial_and_can.jsonl", "cut.blf", "bytes.asc", "bomb.mcap"])
def test_the_command_ends_with_2(name):
    (path,) = (path for path in CORPUS if path.name == name)
    result = here("replay", str(path), "--port", "memory:")
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1 and result.stderr.startswith(f"tactemu: {path}: ")


def survives(path: Path) -> None:
    """Reading gives entries or one sentence."""
    for way in (load, read_log, summarise):
        try:
            way(path)
        except TactemuError as error:
            assert "\n" not in str(error)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    for suffix in (".mcap", ".jsonl"):
        log = Truth(folder / f"t{suffix}")
        tell(log)
        log.close()
    return folder


NUMBERS = st.one_of(st.integers(-(2**70), 2**70), st.floats(), st.booleans(), st.none(), st.text(max_size=5))
JSON = st.recursive(NUMBERS, lambda inner: st.lists(inner, max_size=3), max_leaves=6)
KEYS = ("t_ns", "device", "kind", "data", "why", "what", "sample", "sense", "ideal", "measured", "counts")
WORDS = ("tx", "rx", "sample", "inject", "event", "log", "end", "00ff", "123#00", "baud 9")
ROWS = st.dictionaries(st.sampled_from(KEYS), st.one_of(JSON, st.sampled_from(WORDS)))
FUZZ = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@FUZZ
@given(rows=st.lists(ROWS, max_size=4))
def test_any_lines(rows, tmp_path):
    path = tmp_path / "x.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    survives(path)


@FUZZ
@given(suffix=st.sampled_from([".mcap", ".jsonl"]), seed=st.integers(0, 2**32), bits=st.integers(1, 8))
def test_any_damage(suffix, seed, bits, whole, tmp_path):
    content = bytearray((whole / f"t{suffix}").read_bytes())
    rng = np.random.default_rng(seed)
    for place in rng.integers(0, 8 * len(content), bits):
        content[place // 8] ^= 1 << (place % 8)
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content[: rng.integers(1, len(content) + 1)] if seed % 2 else content)
    survives(path)


@FUZZ
@given(suffix=st.sampled_from([".log", ".asc", ".trc", ".csv", ".blf"]), content=st.binary(max_size=400))
def test_any_bytes(suffix, content, tmp_path):
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content)
    try:
        load(path)
    except TactemuError as error:
        assert "\n" not in str(error)
