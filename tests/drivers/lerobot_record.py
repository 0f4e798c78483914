"""LeRobot, unmodified, records an arm that grasps and is not there; nightly, and by hand.

``python -m tests.drivers.lerobot_record [FOLDER]``: `tactemu exec` gives `lerobot-record` the rig of
``examples/hands/so101.toml`` (a follower and a leader on Feetech buses, two fingertips on a PaXini high-speed board) as
serial devices. A hand leads the leader; the follower's servos close MuJoCo's gripper on a soft box, and lift it. From
the sixth row of the dataset on, what each finger reads must be one sample of the truth log, bit for bit, and in order;
there must be rows in which both feel the box and it is in the air; `lerobot-doctor` must fail nothing.

LeRobot 0.4.4 and what it needs are in an environment of their own (``environments/lerobot_record.txt``, 2 GB, made
once below ``build/``). It pins an older PyTorch than the CPU build that is used, and its torchvision has its C part
for CUDA: ``scripts/lerobot/sitecustomize.py`` declares the two operators that importing it asks for.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet

import tactemu as tt
from tactemu.base.priority import can_enable_realtime_priority, enable_realtime_priority
from tests.drivers.environments import python_with

ROOT = Path(__file__).parents[2]
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
CALIBRATION = {
    name: {"id": k + 1, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095}
    for k, name in enumerate(JOINTS)
}
"""What the servos of the example hold."""
NODES = {"follower": "ttyACM0", "leader": "ttyACM1", "fingertips": "ttyUSB0"}
FPS, EPISODES, EPISODE_S = 30, 2, 4
ATTEMPTS, LATE = 3, "There is no status packet!"
"""LeRobot 0.4.4 waits 50 ms for the six servos of an arm, once."""
FIRST = 5
"""Rows before it may hold the plugin's zeros: it starts with them until the board's first push."""
FIRST_OF_ALL = can_enable_realtime_priority() and shutil.which("chrt") is not None
"""The emulator goes before other programs, LeRobot does not: late by 50 ms once, and the recording has ended."""
LIFTED_M, PRESSED_N = 0.003, 0.5
"""So much higher than at first the box is in the air, and each finger feels so much."""


def rig(folder: Path) -> Path:
    """The example's scene, on ports of its own."""
    hands = ROOT / "examples" / "hands"
    text = (hands / "so101.toml").read_text().replace('file = "', f'file = "{hands}/')
    scene = folder / "rig.toml"
    scene.write_text("\n".join(line for line in text.splitlines() if not line.startswith("port =")) + "\n")
    return scene


def environment(folder: Path) -> dict[str, str]:
    """A home of its own with the calibrations, nothing from the net."""
    for kind in ("robots/so101_paxini/follower", "robots/so_follower/follower", "teleoperators/so_leader/leader"):
        file = folder / "home" / "calibration" / f"{kind}.json"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(CALIBRATION))
    offline = dict.fromkeys(("HF_HUB_OFFLINE", "HF_DATASETS_OFFLINE", "TRANSFORMERS_OFFLINE"), "1")
    shim = str(Path(__file__).parent / "scripts" / "lerobot")
    return {
        **os.environ, **offline, "HF_LEROBOT_HOME": str(folder / "home"), "HF_HOME": str(folder / "hf"),
        "HF_HUB_DISABLE_TELEMETRY": "1", "WANDB_MODE": "disabled", "PYTHONPATH": shim,
    }  # fmt: skip


def record(folder: Path) -> bool:
    """Have LeRobot record; what it says is in ``record.txt``. False: a reply came too late, as on a busy machine.

    Raises:
        AssertionError: it failed for another reason.
    """
    python = Path(python_with("lerobot_record"))
    sensors = f"{{tip: {{port: /dev/{NODES['fingertips']}, module_indices: [10, 18]}}}}"
    words = [
        "--robot.type=so101_paxini", "--robot.id=follower", f"--robot.port=/dev/{NODES['follower']}",
        f"--robot.sensors={sensors}", "--teleop.type=so101_leader", "--teleop.id=leader",
        f"--teleop.port=/dev/{NODES['leader']}", "--dataset.repo_id=local/tact", f"--dataset.root={folder / 'ds'}",
        "--dataset.single_task=touch", f"--dataset.fps={FPS}", f"--dataset.num_episodes={EPISODES}",
        f"--dataset.episode_time_s={EPISODE_S}", "--dataset.reset_time_s=1", "--dataset.push_to_hub=false",
        "--play_sounds=false", "--display_data=false",
    ]  # fmt: skip
    nodes = [word for skin, node in NODES.items() for word in ("--node", f"{skin}={node}")]
    # The emulator has our libraries, LeRobot its own: the path to them is set inside the view.
    inside = ["env", f"PYTHONPATH={environment(folder)['PYTHONPATH']}", *(["chrt", "-o", "0"] if FIRST_OF_ALL else [])]
    command = [
        sys.executable, "-m", "tactemu", "exec", str(rig(folder)), *nodes, "--truth", str(folder / "truth.mcap"),
        "--", *inside, str(python.parent / "lerobot-record"), *words,
    ]  # fmt: skip
    with (folder / "record.txt").open("w") as out:
        done = subprocess.run(
            command, env={**environment(folder), "PYTHONPATH": str(ROOT)}, stdin=subprocess.DEVNULL, stdout=out,
            stderr=subprocess.STDOUT, timeout=300, check=False,
            preexec_fn=enable_realtime_priority if FIRST_OF_ALL else None,
        )  # fmt: skip
    said = (folder / "record.txt").read_text()
    assert done.returncode == 0 or LATE in said, said[-3000:]
    return done.returncode == 0


def rows_of(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Forces of all taxels [N], shape ``(rows, n)``, and the episode of each row."""
    tables = [parquet.read_table(file) for file in sorted((folder / "ds" / "data").rglob("*.parquet"))]
    state = np.concatenate([np.stack(table["observation.state"].to_numpy()) for table in tables])
    episodes = np.concatenate([table["episode_index"].to_numpy() for table in tables])
    return np.asarray(state, np.float32)[:, len(JOINTS) :], episodes


def compare(folder: Path) -> dict[str, int]:
    """Every row with the truth: what each finger reads is one sample, and each row's no earlier than the last one's.

    The plugin keeps the newest push of each finger by itself: a row that it takes while a push comes in has one finger
    of that push and the other of the one before. Such rows are counted, and few.

    Raises:
        AssertionError: a finger reads what is no sample, or an earlier one than in the row before.
    """
    rows, episodes = rows_of(folder)
    log = tt.read_log(folder / "truth.mcap")
    truth = log["fingertips"]
    newtons = np.round(np.asarray(truth.counts, float) * 0.1, 1).astype(np.float32).reshape(len(truth.counts), -1)
    fingers = [slice(0, rows.shape[1] // 2), slice(rows.shape[1] // 2, None)]
    numbers = [{values[finger].tobytes(): k for k, values in enumerate(newtons)} for finger in fingers]
    assert all(len(each) == len(newtons) for each in numbers), "samples are not told apart"
    found = [[n.get(row[finger].tobytes(), -1) for n, finger in zip(numbers, fingers)] for row in rows[FIRST:]]
    for k, row in enumerate(found):
        where = f"row {k + FIRST} of episode {episodes[k + FIRST]}"
        assert -1 not in row, f"{where}: a finger reads what is no sample"
        assert k == 0 or all(now >= before for now, before in zip(row, found[k - 1])), f"{where}: an older sample"
    lifted = in_the_air(log)[[left for left, _ in found]]
    assert lifted.sum() > FPS // 2, "nothing was grasped and lifted"
    whole = sum(left == right for left, right in found)
    assert whole >= 0.9 * len(found) and len(found) > EPISODES * EPISODE_S * FPS // 2
    counts = {"rows": len(rows), "compared": len(found), "of one sample": whole, "samples": len(newtons)}
    return counts | {"with the box in the air": int(lifted.sum())}


def in_the_air(log: tt.Log) -> np.ndarray:
    """Of each sample of the fingertips, whether both press the box and it is in the air."""
    truth, box = log["fingertips"], log.bodies["object"]
    forces = -truth.ideal[..., 2].reshape(len(truth.ideal), 2, -1).sum(axis=2)
    height = np.interp(truth.t_ns, box.t_ns, box.position[:, 2])
    return (np.abs(forces) > PRESSED_N).all(axis=1) & (height > box.position[0, 2] + LIFTED_M)


def doctor(folder: Path) -> str:
    """What `lerobot-doctor` says of the dataset."""
    python = Path(python_with("lerobot_record"))
    done = subprocess.run(
        [python.parent / "lerobot-doctor", "check", str(folder / "ds")], env=environment(folder), capture_output=True,
        text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "FAIL" not in done.stdout, done.stdout + done.stderr
    return done.stdout


def main() -> int:
    """Record, compare, look at the dataset."""
    with tempfile.TemporaryDirectory(prefix="tactemu-lerobot-") as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for attempt in range(1, ATTEMPTS + 1):
            begun, here = time.monotonic(), folder / str(attempt)
            here.mkdir(parents=True)
            if record(here):
                break
            print(f"attempt {attempt}: a reply was late, which ends a recording of LeRobot 0.4.4", flush=True)
        else:
            return 1
        folder = here
        print(f"lerobot-record: {time.monotonic() - begun:.0f} s", flush=True)
        print(", ".join(f"{name} {count}" for name, count in compare(folder).items()), flush=True)
        print(doctor(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
