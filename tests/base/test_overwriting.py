"""Commands overwrite their own files, and no other: `tactemu.base.files.check_overwriting`."""

import re

import numpy as np
import pytest

from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError
from tactemu.base.files import MAX_HEAD_BYTES, check_overwriting
from tactemu.base.formats import CONVERTIBLE, RECORDABLE
from tactemu.base.jobs import Journal
from tactemu.base.style import PAGE_SIGN, page
from tactemu.cli import benches
from tactemu.cli.judge_output import judge_success
from tactemu.emulator.saving import state_file
from tactemu.fit import realism, writing
from tactemu.fit.estimates import Findings
from tactemu.fit.fitting import run_fit
from tactemu.fit.infer.analysis import Draft
from tactemu.fit.infer.channels import Answers, svg
from tactemu.fit.infer.commands import InferFiles, run_infer
from tactemu.fit.infer.dbc import dbc_text
from tactemu.fit.infer.framing import Framing
from tactemu.judge import smallest_case
from tactemu.judge.compare.running import Teller, Wanted
from tactemu.judge.compare.running import run as compare
from tactemu.judge.options import JudgeOptions
from tactemu.judge.sweep import sweep
from tactemu.judge.trial_record import TrialRecord
from tactemu.truth import Passage, Truth
from tactemu.truth.conversion import convert
from tactemu.truth.recorder import Recorder
from tactemu.tune.trade.trade import run_trade
from tactemu.view.conversions.plots import SIGNS, plot

FRAME = CanFrame(arbitration_id=1, data=b"abc")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "t.mcap"
    truth = Truth(path)
    truth.sample(0, "a", *[np.ones(4)] * 3)
    truth.wrote(0, "a", FRAME)
    truth.close()
    return path


def record(path):
    with Recorder(path) as recorder:
        recorder.add(Passage(0, "", "tx", FRAME))


def infer(**files):
    run_infer([], catalogue=False, shown=None, files=InferFiles(**files), json=False, say=print)


def journal(path):
    Journal(path, "rows").add("a", 1)


FORMS = {f"truth --to x.{each.name}": f"x.{each.name}" for each in CONVERTIBLE}
RECORDS = {f"record x.{each.name}": f"x.{each.name}" for each in RECORDABLE}
PICTURES = {f"plot --to x{suffix}": f"x{suffix}" for suffix in SIGNS}
WRITERS = {
    **{command: (name, lambda path, log: convert(log, str(path))) for command, name in FORMS.items()},
    **{command: (name, lambda path, _: record(path)) for command, name in RECORDS.items()},
    **{command: (name, lambda path, log: plot(log, path)) for command, name in PICTURES.items()},
    "run --save": ("x.npz", lambda path, _: state_file.write(path, {}, {"a": 1})),
    "judge --record": ("x.jsonl", lambda path, _: TrialRecord("clean").write(path)),
    "judge --cases": ("x.json", lambda path, _: smallest_case.write({"version": 1, "finding": "stale"}, path)),
    "sweep, its journal": ("x.jsonl", lambda path, _: journal(path)),
    "sweep --results": ("x.parquet", lambda path, _: sweep([], path)),
}


@pytest.mark.parametrize("command", WRITERS)
def test_a_command_overwrites_its_own_file_and_no_other(command, tmp_path, log):
    name, write = WRITERS[command]
    path = tmp_path / name
    if command == "sweep --results":  # it has no rows without runs
        path.with_suffix(".jsonl").write_text('{"key": "a", "rows": [{"driver": "mine"}]}\n')
    write(path, log)
    assert path.stat().st_size
    write(path, log)
    path.write_text("an hour of work")
    with pytest.raises(
        TactemuError, match=f"{re.escape(str(path))}: was not written by tactemu .*; remove it first, or"
    ):
        write(path, log)
    assert path.read_text() == "an hour of work"


REFUSALS = {
    "infer -o": lambda path: infer(out=path),
    "infer --dbc": lambda path: infer(dbc=path),
    "infer --picture": lambda path: infer(picture=path),
    "fit --out": lambda path: run_fit([], device="anyskin", out=path),
    "fit --report": lambda path: run_fit([], device="anyskin", out=path.with_name("new"), report=path),
    "judge --success --json": lambda path: judge_success("anyskin", ["cat", "{port}"], path, JudgeOptions(), path),
    "bench physics --page": lambda path: benches.physics(page=path),
    "bench physics --out": lambda path: benches.physics(out=path),
    "bench wire --out": lambda path: benches.wire(out=path),
    "bench realism --out": lambda path: benches.realism(out=path),
    "bench realism --page": lambda path: benches.realism(data=path.parent, page=path),
    "bench realism --parameters": lambda path: benches.realism(data=path.parent, parameters=path),
}


@pytest.mark.parametrize("command", REFUSALS)
def test_a_command_refuses_a_file_of_another_program_before_it_begins(command, tmp_path):
    path = tmp_path / "mine"
    path.write_text("an hour of work")
    with pytest.raises(TactemuError, match=f"{path}: was not written by tactemu and is not overwritten"):
        REFUSALS[command](path)
    assert path.read_text() == "an hour of work"


@pytest.mark.parametrize("name", ["report.json", "report.html", "presses.csv", "measured/anyskin.toml"])
def test_a_comparison_refuses_a_folder_with_a_file_of_another_program(name, tmp_path):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    with pytest.raises(TactemuError, match=f"{path}: was not written by tactemu"):
        compare(Wanted("anyskin", "/dev/no", folder=tmp_path), Teller(print, print, lambda: False))


@pytest.mark.parametrize("name", ["trade.json", "trade.md", "trade.svg"])
def test_a_trade_off_refuses_a_folder_with_a_file_of_another_program(name, tmp_path):
    (tmp_path / name).write_text("mine")
    with pytest.raises(TactemuError, match=f"{name}: was not written by tactemu"):
        run_trade(print, out=tmp_path)


def test_each_text_has_its_sign_in_its_head():
    draft = Draft(True, Framing("CAN"))
    answers = Answers([], np.zeros((0, 0)), [], [])
    scene = "\n".join(writing._head([], Findings()))
    texts = {realism._page([], [], {}): realism._TITLE, page("a", []): PAGE_SIGN}
    texts |= {dbc_text(draft): "NS_ :\n\nBS_:", svg(answers): "crispEdges", scene: writing.SIGN}
    for text, sign in texts.items():
        assert sign in text[:MAX_HEAD_BYTES]


def test_only_the_head_of_a_file_is_read(tmp_path):
    path = tmp_path / "x"
    path.write_text("a" * MAX_HEAD_BYTES + "sign")
    with pytest.raises(TactemuError, match="not written by tactemu"):
        check_overwriting(path, "sign")
    path.write_text("a sign")
    check_overwriting(path, "other", "sign")
