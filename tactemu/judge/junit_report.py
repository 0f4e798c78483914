"""Reports as JUnit XML for CI systems, with a test case for each trial.

The standard library writes it: a library for JUnit would save eight lines, and still need :func:`_legal`.
"""

from __future__ import annotations

from xml.etree import ElementTree

from tactemu.judge import smallest_case
from tactemu.judge.report import Report


def junit_report(report: Report) -> str:
    """Return a report as JUnit XML."""
    skipped = sum(bool(outcome.skipped) for outcome in report.outcomes)
    suite = ElementTree.Element(
        "testsuite", name=f"tactemu judge {report.device}", tests=str(len(report.outcomes)),
        failures=str(len(report.failed)), skipped=str(skipped), time=f"{report.seconds:.3f}",
    )  # fmt: skip
    for outcome in report.outcomes:
        case = ElementTree.SubElement(
            suite, "testcase", classname=f"tactemu.judge.{report.device}", name=outcome.name,
            time=f"{outcome.seconds:.3f}",
        )  # fmt: skip
        if outcome.skipped:
            ElementTree.SubElement(case, "skipped", message=_legal(outcome.skipped))
        elif kinds := report.failures(outcome):
            failure = ElementTree.SubElement(case, "failure", type=kinds[0], message=_legal(outcome.verdict))
            failure.text = _legal(smallest_case.in_words(outcome.case) if outcome.case else outcome.verdict)
        else:
            ElementTree.SubElement(case, "system-out").text = _legal(outcome.verdict)
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def _legal(text: str) -> str:
    """Return a text with the characters replaced that XML cannot hold."""
    return "".join(letter if letter >= " " or letter in "\n\t" else "?" for letter in text)
