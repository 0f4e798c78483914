"""The mutants: each fits the tree as it is, and what is killed or lives is told apart."""

import re
from pathlib import Path

import pytest

from benchmarks import mutants
from benchmarks.mutants import MUTANTS, altered, run

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_its_text_is_in_its_file_once_and_its_test_exists(mutant):
    assert altered(mutant, (ROOT / mutant.file).read_text()).count(mutant.new) >= 1
    assert re.search(rf"^def {mutant.test}\(", (ROOT / mutant.test_file).read_text(), re.MULTILINE)


def test_a_mutant_that_lives_is_named_and_makes_the_run_fail(monkeypatch):
    killed = next(mutant for mutant in MUTANTS if mutant.name.startswith("serial"))
    harmless = killed._replace(name="harmless", new=f"({killed.old})")
    monkeypatch.setattr(mutants, "MUTANTS", (killed, harmless))
    lines = []
    assert not run(lines.append)
    assert lines[0].startswith(f"killed  {killed.name}  ({killed.test_id}[1.5")
    assert lines[1:] == ["LIVED   harmless", "1 of 2 mutants are killed"]


def test_a_text_that_is_gone_and_a_name_that_no_mutant_has_are_errors(monkeypatch):
    with pytest.raises(ValueError, match="no mutant's name contains 'flux'; names: missed"):
        run(print, "flux")
    monkeypatch.setattr(mutants, "MUTANTS", (MUTANTS[0]._replace(old="gone = 1"),))
    with pytest.raises(ValueError, match=r"expected 'gone = 1' once in .*emulator\.py, got 0 times; adapt it"):
        run(print)
