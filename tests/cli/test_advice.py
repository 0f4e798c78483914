"""When the rate is missed, the report says so, and which dial to turn."""

import time

import pytest

from tactemu.cli import reports
from tactemu.cli.reports import advice, report_if_slow
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import load


@pytest.fixture
def emulator():
    return assemble(load("anyskin"), AssemblyOptions(port="memory:")).emulator


def test_nothing_is_said_where_nothing_is_missed(emulator):
    emulator.channels[0].statistics.samples = 1000
    emulator.channels[0].statistics.missed = 10
    assert advice(emulator, emulator.channels[0]) == ""


def test_a_busy_machine_is_told_from_a_dear_simulation(emulator, monkeypatch):
    channel = emulator.channels[0]
    channel.statistics.samples, channel.statistics.missed = 900, 100
    text = advice(emulator, channel)
    assert text.startswith("100 of 1000 samples were not taken in time: not for the simulation")
    monkeypatch.setattr("tactemu.cli.reports._step_us", lambda _simulation: 1600.0)
    plan = emulator.simulation.plan

    def springs_are_slow(_clock):
        for stage in plan.stages:
            stage.cost_us = 1500.0 if stage.name.endswith("springs") else 100.0

    monkeypatch.setattr(plan, "time_stages", springs_are_slow)
    text = advice(emulator, channel)
    assert "takes 16000 of the 10000 us between them, most of it in 'anyskin: springs' (set `depth" in text
    assert "dt" in text and "tactemu tune" in text


def test_what_takes_long_is_told_in_one_line(monkeypatch, capsys):
    with report_if_slow("building"):
        pass
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(reports, "SLOW_START_S", 0.0)
    with report_if_slow("building 20,000 bodies"):
        end = time.monotonic() + 20
        while not (told := capsys.readouterr().err) and time.monotonic() < end:
            time.sleep(0.01)
    assert told == "tactemu: building 20,000 bodies\n" and capsys.readouterr().err == ""
