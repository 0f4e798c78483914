"""Tests of reports: HTML, JUnit, JSON, the baseline, and a case for the driver's maintainers."""

import io
import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rich.console import Console
from typer.main import get_command

from tactemu.base.errors import TactemuError
from tactemu.cli.app import app
from tactemu.cli.judge_output import ReportFiles, print_outcome
from tactemu.judge import smallest_case
from tactemu.judge.html_report import html_report
from tactemu.judge.junit_report import junit_report
from tactemu.judge.outcome import ABOUT, FAILING, Finding, Outcome, titles
from tactemu.judge.plan import Trial
from tactemu.judge.report import Report
from tactemu.judge.trial_counts import MAX_QUOTED_LENGTH, shortened, without_tracebacks
from tactemu.judge.trial_record import TrialRecord
from tactemu.judge.verdicts import judge_record
from tactemu.wire.faults.frames import Flip
from tests.judge.trial_records import record_of, row, usual
from tests.view.page.browser import browsing

CASE = {
    "version": 1, "device": "optoforce", "command": ["./reader", "{port}"], "trial": "flipped", "finding": "wrong",
    "verdict": "silent wrong values: 1 of 20 rows", "faults": ["flip frame 6 byte 8 bit 2"], "runs": 1,
    "bytes": [{"fault": "flip frame 6 byte 8 bit 2", "before": "aa07080a0102", "after": ["aa07080a0502"]}],
    "row": {"fx": 7777.0}, "truth": {"fx": 7.5}, "odd": ["fx"],
}  # fmt: skip


@pytest.fixture
def report():
    wrong = judge_record(record_of([*usual(without=[110]), (110.1, row(110, fy=7777.0))], name="<flipped>"))
    wrong.case, wrong.confirmed = CASE, True
    clean = judge_record(record_of(name="clean", action="clean", trial={"recovers": False}))
    skipped = judge_record(TrialRecord("wrong baud", {"skipped": "USB & all"}))
    return Report("optoforce", ["./reader", "<&>"], columns=[("fx", "Fx, in N")], outcomes=[clean, wrong, skipped])


def test_a_page_holds_everything_and_asks_for_nothing(report):
    text = html_report(report)
    assert "&lt;flipped&gt;" in text and "<flipped>" not in text and "USB &amp; all" in text
    assert "7777" in text and "<mark>" in text and "<svg" in text and "1 of 2 trials fail" in text
    assert not re.search(r"<script|src=|url\(|https?://", text)


def test_a_remark_on_wrong_values_stands_in_every_report(capsys):
    rows = [*usual(without=[110]), (110.1, row(110, fy=7777.0))]
    wrong = judge_record(record_of(rows, name="flipped", trial={"remark": "no checksum <here>"}))
    right = judge_record(record_of(usual(), name="flipped", trial={"remark": "no checksum <here>"}))
    wrong.case = CASE | {"remark": wrong.remark}
    report = Report("optoforce", ["./reader"], outcomes=[wrong])
    assert "no checksum &lt;here&gt;" in html_report(report) and "no checksum &lt;here&gt;" in junit_report(report)
    assert report.as_dict()["trials"][0]["remark"] == "no checksum <here>" and not right.remark
    print_outcome(Console(file=sys.stdout, width=200), report, wrong)
    assert "no checksum <here>" in capsys.readouterr().out


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (400, "dark")])
def test_a_browser_shows_the_page_and_finds_no_fault_with_it(report, width, scheme, tmp_path):
    (tmp_path / "report.html").write_text(html_report(report))
    wrong: list[str] = []
    with browsing() as browser:
        tab = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme).new_page()
        tab.on("console", lambda message: message.type in ("error", "warning") and wrong.append(message.text))
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("request", lambda request: request.url.startswith("file:") or wrong.append(request.url))
        tab.goto(f"file://{tmp_path / 'report.html'}")
        boxes = [each.bounding_box() for each in tab.locator("svg").all()]
        assert boxes and all(box and box["width"] > 100 and box["height"] > 20 for box in boxes)
        assert tab.locator("mark").first.is_visible() and tab.get_by_text("7777").first.is_visible()
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, "nothing hangs out to the right"
        tab.screenshot(path=tmp_path / "report.png", full_page=True)
    assert not wrong


def test_junit(report):
    suite = ElementTree.fromstring(junit_report(report))
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "1", "1")
    (failure,) = suite.iter("failure")
    assert failure.get("type") == "wrong" and "aa07080a[05]02" in (failure.text or "")
    report.outcomes[1].verdict = "died: \x1b[31mred\x00"
    ElementTree.fromstring(junit_report(report))


def test_a_baseline_lets_only_what_is_new_fail(report, tmp_path):
    report.write_json(tmp_path / "report.json")
    data = json.loads((tmp_path / "report.json").read_text())
    assert data["failed"] == ["<flipped>"] and data["trials"][1]["fails"] == ["wrong"]
    report.compare(tmp_path / "report.json")
    assert not report.failed and "as in the baseline" in html_report(report)
    report.outcomes[1].name = "cut"
    assert [outcome.name for outcome in report.failed] == ["cut"]
    for content in (b"{}", b"<html></html>", b"[]", b"\xff"):
        (tmp_path / "x.json").write_bytes(content)
        with pytest.raises(
            TactemuError, match=r"not a report as JSON: --baseline takes the file that --json of [^()]*$"
        ):
            report.compare(tmp_path / "x.json")


def test_what_does_not_come_again_does_not_fail(report):
    report.outcomes[1].confirmed = False
    assert not report.failed and "a second run did not show it" in html_report(report)


@pytest.mark.parametrize("kind", list(ABOUT))
def test_each_kind_of_finding_that_may_fail_a_run_has_a_smallest_case(kind):
    """Check also the kinds that fail no run by default: with ``--fail-on all`` there is a search for them."""
    trial = Trial("flipped", "why", [Flip(frames=((10, 10),), byte=3, bit=1), Flip(frames=((20, 20),), byte=4, bit=2)])
    record = record_of(hit=[110])
    outcome = Outcome("flipped", findings=[Finding(kind, "so")])
    case = smallest_case.find(trial, record, outcome, lambda alone: (record, outcome), "optoforce", ["d"], tuple(ABOUT))
    assert case is not None and case["finding"] == kind and len(case["faults"]) == 1
    if kind not in FAILING:
        assert smallest_case.find(trial, record, outcome, lambda alone: (record, outcome), "optoforce", ["d"]) is None


def test_trouble_is_named_once():
    assert judge_record(TrialRecord("clean", {}, trouble="died: it was killed")).verdict == "died: it was killed"


def test_a_case_is_kept_and_told(tmp_path):
    smallest_case.write(CASE, tmp_path / "case.json")
    assert smallest_case.read(tmp_path / "case.json") == CASE
    assert list(map(str, smallest_case.trial_of(CASE).faults)) == CASE["faults"]
    words = smallest_case.in_words(CASE)
    assert len(words.splitlines()) <= 10 and "aa07080a[05]02" in words and "fx = 7777" in words and "fx = 7.5" in words
    for wrong in ("", "[]", '{"version": 9}', '{"version": 1, "device": 3}'):
        (tmp_path / "x.json").write_text(wrong)
        with pytest.raises(TactemuError, match="not a case"):
            smallest_case.read(tmp_path / "x.json")


TRACEBACK = """Traceback (most recent call last):
File "driver.py", line 5, in <module>
main()
^^^^^^
serial.serialutil.SerialException: device disconnected"""


@pytest.mark.parametrize(
    ("lines", "quoted"),
    [
        (TRACEBACK, ["serial.serialutil.SerialException: device disconnected"]),
        (f"lost\n{TRACEBACK}\nagain", ["lost", "serial.serialutil.SerialException: device disconnected", "again"]),
        (
            f"{TRACEBACK}\nDuring handling of the above exception, another exception occurred:\n"
            "Traceback (most recent call last):\nraise\nKeyboardInterrupt",
            ["KeyboardInterrupt"],
        ),
        ('Traceback (most recent call last):\nFile "x.py"', ["Traceback (most recent call last):"]),
    ],
)
def test_of_a_traceback_the_exception_is_quoted(lines, quoted):
    assert without_tracebacks(lines.split("\n")) == quoted


def shown(outcome, *, is_terminal):
    """The lines of an outcome on a terminal of 60 columns, or in a pipe."""
    console = Console(file=io.StringIO(), width=60, soft_wrap=not is_terminal, highlight=False)
    print_outcome(console, Report("optoforce", ["./reader"], outcomes=[outcome]), outcome)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_reason_why_a_trial_was_not_tried_is_never_cut(is_terminal):
    reason = "a stream keeps the order of its bytes: no frame arrives twice"
    lines = shown(judge_record(TrialRecord("reordered", {"skipped": reason})), is_terminal=is_terminal)
    assert len(lines) == 1 + is_terminal and " ".join(" ".join(lines).split()).endswith(f"not tried: {reason}")


def test_every_report_counts_only_the_trials_that_were_run(report):
    late = judge_record(TrialRecord("split", {"skipped": "1 s of the budget is left", "lacks_time": True}))
    report.outcomes.append(late)
    text = html_report(report)
    assert report.counts == "2 trials in 0.0 s, 2 not tried" and report.counts in text
    assert (
        report.left_for_time == "1 not tried for lack of time: --budget 2m tries all" and report.left_for_time in text
    )
    report.outcomes.pop(1)
    assert report.verdict.startswith("nothing fails, but only")
    report.interrupted = True
    assert report.verdict == "nothing fails so far: the run was interrupted" and report.verdict in html_report(report)


def test_help_names_the_verdicts_that_fail_a_run_and_the_page_has_them_in_bold():
    help = {parameter.name: parameter.help for parameter in get_command(app).commands["judge"].params}["fail_on"]
    assert help.endswith(f" Default: {titles()}.")
    table = Path("docs/judge.md").read_text().partition("| verdict | condition |")[2].partition("\n\n")[0]
    assert {*re.findall(r"^\| \*\*([^*]+)\*\*", table, re.MULTILINE)} == {*titles().split(", ")}


def test_a_quoted_message_keeps_its_numbers_and_ends_at_a_word():
    assert shortened("no data for 1 s") == "no data for 1 s"
    text = "(device disconnected or multiple access on port) " * 9
    start = shortened(text).removesuffix(" …")
    assert len(start) <= MAX_QUOTED_LENGTH and text.startswith(f"{start} "), "no word is cut"
    assert shortened(300 * "x") == MAX_QUOTED_LENGTH * "x" + " …"


def test_a_verdict_stays_whole_in_a_pipe_and_goes_on_below_itself_on_a_terminal():
    wrong = judge_record(record_of([*usual(without=[110]), (110.1, row(110, fy=7777.0))], name="flipped"))
    (line,) = shown(wrong, is_terminal=False)
    first, *others = shown(wrong, is_terminal=True)
    assert len(line) > 60 and len(others) and max(map(len, [first, *others])) <= 60
    assert first.startswith("✗ flipped            silent") and all(each[:21].isspace() for each in others)
    assert " ".join(" ".join([first, *others]).split()) == " ".join(line.split()), "no word is broken"


def test_a_report_overwrites_only_a_report(report, tmp_path):
    html, junit, json_file = (tmp_path / name for name in ("r.html", "r.xml", "r.json"))
    files = ReportFiles(html=html, junit=junit, json=json_file)
    files.check()
    html.write_text(html_report(report))
    junit.write_text(junit_report(report))
    report.write_json(json_file)
    files.check()
    for path in (html, junit, json_file):
        before = path.read_text()
        path.write_text("my notes")
        with pytest.raises(TactemuError, match="is not overwritten; remove it first"):
            files.check()
        path.write_text(before)
