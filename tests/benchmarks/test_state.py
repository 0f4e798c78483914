"""Smoke tests: `python -m benchmarks state` measures what it says; how fast is no matter for a test."""

import json

from typer.testing import CliRunner

from benchmarks.__main__ import bench


def test_figures_of_a_device_and_a_model_go_to_a_file(tmp_path):
    out = tmp_path / "figures.json"
    for name, taxels in (("anyskin", 5), ("ContactDepthProbe", 256)):
        words = ["state", "--repeats", "2", "--forks", "2", "--only", name, "--out", str(out)]
        done = CliRunner().invoke(bench, words)
        assert done.exit_code == 0, done.output
        (figures,) = json.loads(out.read_text())
        assert figures["name"] == name and figures["taxels"] == taxels and figures["bytes"] > 1000
        assert min(figures["save_ms"], figures["restore_ms"], figures["build_ms"], figures["fork_ms"]) > 0
