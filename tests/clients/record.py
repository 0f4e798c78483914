"""Run an unmodified driver against a device, and keep what it did as a client recording.

``python -m tests.clients.record SPEC.toml -- COMMAND...``

COMMAND runs in the view of ``tactemu exec``, or on the port that the spec names (``{port}`` in COMMAND is replaced). It
appends lines of JSON to the file that the environment variable ``TACTEMU_ROWS`` names: ``{"as": MAP, "values": [...]}``
for a reading as the driver decoded it, ``{"as": NAME, "value": ...}`` for what else it learnt. The recording is written
only if nothing that the driver sent was left over, every reading equals a sample, each of its values moved, and a
replay in virtual time gives every byte again.

The spec names ``device``, ``driver``, ``repository`` and ``commit`` (or ``version``), ``licence``, ``language``,
``calls``, and, where needed, ``options``, ``seed``, ``noise``, ``rate_hz``, ``scene``, ``port``, ``way``, ``node``,
``seconds``, ``maps``, ``expected_counters`` (counter: why), ``constant`` (map: why values of it do not move).
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

import firmware_protocols as fp
from tactemu.exec.environment import exec_environment
from tactemu.scene.default import tables_for
from tactemu.session.serving import Served, serve
from tests.clients.recording import FOLDER, Recording, Row, equals, mapped
from tests.clients.replay import OF_THE_WIRE, differences, ports_of, replay, tap

NEEDED = ("device", "driver", "repository", "licence", "language", "calls")
KNOWN = {
    *NEEDED, "commit", "version", "options", "seed", "noise", "rate_hz", "scene", "port", "way", "node", "seconds",
    "maps", "expected_counters", "constant", "note",
}  # fmt: skip
HARMLESS = ("requests",)
"""Counters of a device that do not say that something was not understood."""
LEAST_ROWS = 20


def main() -> int:
    """Record; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", type=Path)
    parser.add_argument("-n", "--dry-run", action="store_true", help="say what would be refused, write nothing")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder; default: tests/data/clients")
    parser.add_argument("command", nargs="+", help="behind --")
    args = parser.parse_args()
    spec = tomllib.loads(args.spec.read_text())
    if unknown := set(spec) - KNOWN:
        parser.error(f"{args.spec}: unknown {', '.join(sorted(unknown))}; there are {', '.join(sorted(KNOWN))}")
    if missing := [name for name in NEEDED if name not in spec]:
        parser.error(f"{args.spec}: {', '.join(missing)} missing")
    if "commit" not in spec and "version" not in spec:
        parser.error(f"{args.spec}: which commit or version?")
    spec["scene"] = scene_of(spec, args.spec.parent)
    recording, told, counters, samples, status = run(spec, args.command)
    wrong = [f"the driver ended with status {status}"] if status else []
    wrong += match(recording, told, samples) if told else ["the driver reported no reading"]
    wrong += left_over(spec, counters)
    if not wrong:
        again, made = replay(recording)
        wrong += differences(recording, again, made)
    print(f"{len(recording.rows)} readings, {recording.compared} values equal; {len(recording.events)} events and")
    print(f"{len(recording.sent)} frames; counters {json.dumps(counters)}")
    if wrong:
        print("NOT RECORDED:", *wrong, sep="\n  ")
        return 1
    path = args.out / f"{spec['device']}-{spec['driver']}.mcap"
    if not args.dry_run:
        recording.save(path)
        print(f"{path}: {path.stat().st_size} bytes; the replay in virtual time is equal")
    return 0


def scene_of(spec: dict[str, Any], folder: Path) -> str:
    """Return the scene as TOML: the spec's own, or one in which each taxel moves by itself in each sample."""
    if "scene" in spec:
        return (folder / spec["scene"]).read_text()
    tables = tables_for(spec["device"], fp.device_class(spec["device"]), **spec.get("options", {}))
    skin = tables["skin"][0]
    skin["options"] = {"noise": spec.get("noise", 0.2)}
    if "rate_hz" in spec:
        skin["rate_hz"] = spec["rate_hz"]
    for body in tables["body"]:
        if "motion" in body:
            body["motion"]["delay"] = 0.2
    lines = ["[scene]", "dt = 0.002"]
    for kind in ("body", "skin"):
        for table in tables[kind]:
            lines += [f"[[{kind}]]", *(f"{_key(name)} = {_toml(value)}" for name, value in table.items())]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(name)} = {_toml(each)}" for name, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value.item() if isinstance(value, np.generic) else value)


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() else json.dumps(name)


def run(spec: dict[str, Any], command: list[str]) -> tuple[Recording, list[dict[str, Any]], dict, list, int]:
    """Run the driver from its start to its end."""
    recording = Recording({})
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        scene, rows = folder / "scene.toml", folder / "rows.jsonl"
        scene.write_text(spec["scene"])
        rows.touch()
        os.environ["TACTEMU_ROWS"] = str(rows)
        seed, port = spec.get("seed", 7), spec.get("port")
        dev = serve(scene, port, clock="paced", keep="1GB", seed=seed, by_hand=False)
        if port is None:
            env = stack.enter_context(exec_environment(dev, nodes=spec.get("node", ""), way=spec.get("way", "")))
            command = env.command(command)
        else:
            stack.enter_context(dev)
            command = [word.replace("{port}", dev.port) if "{port}" in word else word for word in command]
        dev.in_loop(lambda: tap(dev.emulator, recording))
        names = {name: wire.transport.has_reader for name, wire in ports_of(dev.emulator).items()}
        driver = subprocess.Popen(command)
        try:
            status = driver.wait(spec.get("seconds", 120))
        except subprocess.TimeoutExpired:
            driver.kill()
            status = driver.wait()
        time.sleep(0.3)  # until what it did last has been met
        counters = counters_of(dev)
        samples = list(dev.truth.samples)
        told = [json.loads(line) for line in rows.read_text().splitlines() if line.strip()]
    said = {each["as"]: each["value"] for each in told if "value" in each}
    recording.about = {
        **{name: spec[name] for name in sorted(KNOWN & set(spec)) if name not in ("seed", "maps")},
        "seed": seed,
        "maps": spec.get("maps", {}),
        "ports": names,
        "said": said,
        "counters": counters,
        "date": datetime.date.today().isoformat(),
    }
    return recording, [each for each in told if "values" in each], counters, samples, status


def counters_of(dev: Served) -> dict[str, dict[str, int]]:
    """What became of the driver's bytes, by device and by wire."""
    found: dict[str, dict[str, int]] = {}
    for channel in dev.emulator.channels:
        found[channel.name] = {name: count for name, count in channel.device.counters.items() if count}
        for wire in channel.wires.values():
            for name in OF_THE_WIRE:
                if wire.counters[name]:
                    found[channel.name][name] = wire.counters[name]
    return found


def left_over(spec: dict[str, Any], counters: dict[str, dict[str, int]]) -> list[str]:
    """What was not understood, in words, but for what the driver's own search causes."""
    expected = spec.get("expected_counters", {})
    total: Counter[str] = Counter()
    for each in counters.values():
        total.update(each)
    never = [f"expected_counters: {name} is 0" for name in expected if not total[name]]
    return never + [
        f"left over: {name} {count}"
        for name, count in total.items()
        if name not in HARMLESS and name not in expected and count
    ]


def match(recording: Recording, told: list[dict[str, Any]], samples: list[Any]) -> list[str]:
    """Find the sample of each reading, none before the one of the reading before; returns what is wrong, in words."""
    maps, wrong = recording.about["maps"], []
    for name in dict.fromkeys(each["as"] for each in told):
        if name not in maps:
            wrong.append(f"no map for the readings {name!r}")
            continue
        how = maps[name]
        own = [sample for sample in samples if sample.sense == how.get("sense", "")]
        if not own:
            wrong.append(
                f"{name}: no sample of the sense {how.get('sense', '')!r}; there are { {s.sense for s in samples} }"
            )
            continue
        expected, at = [mapped(sample.counts, how) for sample in own], 0
        rows = [np.asarray(each["values"], float).ravel() for each in told if each["as"] == name]
        for k, values in enumerate(rows):
            found = next((j for j in range(at, len(own)) if equals(expected[j], values, how)), None)
            if found is None:
                wrong.append(f"{name}: reading {k} of {len(rows)} is in no sample: {_nearest(values, expected)}")
                break
            recording.rows.append(Row(name, own[found].number, values))
            at = found
        if len(rows) < LEAST_ROWS:
            wrong.append(f"{name}: {len(rows)} readings, at least {LEAST_ROWS}")
        still = np.flatnonzero(np.ptp(np.array(rows), axis=0) == 0) if len({len(row) for row in rows}) == 1 else []
        if len(still) and name not in recording.about.get("constant", {}):
            wrong.append(
                f"{name}: the values {list(map(int, still))[:20]} never moved; more noise, or say why in `constant`"
            )
    return wrong


def _nearest(values: np.ndarray, expected: list[np.ndarray]) -> str:
    alike = [each for each in expected if each.shape == values.shape]
    if not alike:
        return f"it has {len(values)} values, a sample {len(expected[0])}"
    best = min(alike, key=lambda each: int((~np.isclose(each, values, rtol=1e-6, atol=1e-6)).sum()))
    off = np.flatnonzero(~np.isclose(best, values, rtol=1e-6, atol=1e-6))
    some = off[:6].tolist()
    return (
        f"{len(off)} of {len(values)} values differ from the nearest, at {some}: {values[some].tolist()} "
        f"for {best[some].tolist()}"
    )


if __name__ == "__main__":
    sys.exit(main())
