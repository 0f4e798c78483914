"""CAN in the view: the preload library behaves as the kernel, and unmodified programs find ``can0``."""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import TactemuError
from tactemu.exec.environment import exec_environment

HERE = Path(__file__).parent
BEHAVIOUR = HERE / "scripts" / "can_behaviour.py"
GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "can_behaviour.jsonl"
"""What the kernel answers: Debian's 6.1, in ``scripts/vcan-run``; written by ``python tests/exec/test_can.py``."""

IN_A_NAMESPACE = """
ip link set lo up && ip link add vcan0 type veth peer name far.vcan0 || exit 9
for name in vcan0 far.vcan0; do
  echo 1 2>/dev/null >/proc/sys/net/ipv6/conf/$name/disable_ipv6; ip link set $name mtu 72 up; done
export CAN_LINK=veth LD_PRELOAD=$0; exec "$@"
"""
"""A network with a vcan0 that is none, for whoever is root in it."""


def answers(text):
    return {name: answer for line in text.splitlines() for name, answer in json.loads(line).items()}


@pytest.mark.skipif("VCAN_GUEST" in os.environ, reason="here the kernel has CAN itself")
def test_the_preload_library_behaves_as_the_kernel(preload):
    command = ["unshare", "-Urn", "bash", "-c", IN_A_NAMESPACE, str(preload), sys.executable, str(BEHAVIOUR)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    kernel = answers(GOLDEN.read_text())
    assert len(kernel) >= 17
    assert answers(done.stdout) == kernel


@pytest.mark.vcan
def test_the_kernel_behaves_as_it_was_written_down():
    done = subprocess.run([sys.executable, str(BEHAVIOUR)], capture_output=True, text=True, timeout=90, check=True)
    assert answers(done.stdout) == answers(GOLDEN.read_text())


# -- unmodified programs -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hand():
    """A uSkin and a hand on two buses of one view."""
    skin, hand = tt.serve("xela_uskin"), tt.serve("linker_hand_l6")
    with exec_environment(skin, hand, nodes={"linker_hand_l6": "can1"}) as env:
        assert env.nodes == {"xela_uskin": "can0", "linker_hand_l6": "can1"}
        yield env


SEND = """
import sys
import can
with can.Bus(interface="socketcan", channel="can0") as bus:
    for ident, _, data in (frame.partition("#") for frame in sys.argv[1:]):
        bus.send(can.Message(arbitration_id=int(ident, 16), data=bytes.fromhex(data), is_extended_id=False))
"""


def start(env, *frames):
    """Send frames, written as cansend takes them, into ``can0`` of the view; cansend is quicker, where there is one."""
    if not shutil.which("cansend"):
        env.run([sys.executable, "-c", SEND, *frames], check=True)
        return
    for frame in frames:
        env.run(["cansend", "can0", frame], check=True)


needs_can_utils = pytest.mark.skipif(not shutil.which("candump"), reason="can-utils: sudo apt-get install can-utils")


@needs_can_utils
@pytest.mark.usefixtures("preload")
def test_can_utils_see_every_frame_that_left_and_can_play_them(hand, tmp_path):
    skin = hand.devices[0]
    log = tmp_path / "log"
    with log.open("w") as out:
        dump = hand.popen(["candump", "-L", "can0"], stdout=out)
        time.sleep(0.3)
        start(hand, "201#0700")
        time.sleep(0.5)
        start(hand, "201#0701")
        time.sleep(0.2)
        dump.terminate()
        dump.wait(5)
    seen = re.findall(r"can0 (7\w\w#\w+)", log.read_text())
    sent = [str(frame) for _, _, frame in skin.truth.frames]
    assert len(seen) > 100 and seen == sent[-len(seen) :]
    assert "can0 201#0700" in log.read_text(), "what others of the host say is heard too"
    log.write_text("".join(line for line in log.read_text().splitlines(keepends=True) if " 201#" not in line))
    again = hand.popen(["candump", "-L", "-n", str(len(seen)), "can0,710:7F0"], stdout=subprocess.PIPE, text=True)
    time.sleep(0.3)
    hand.run(["canplayer", "-I", str(log)], check=True)
    assert re.findall(r"can0 (7\w\w#\w+)", again.communicate(timeout=60)[0]) == seen


@pytest.mark.skipif(not shutil.which("g++"), reason="g++: sudo apt-get install g++")
def test_a_reader_in_cpp_with_a_filter_and_the_kernels_timestamps(hand, tmp_path):
    reader = tmp_path / "can_reader"
    subprocess.run(["g++", "-O2", "-o", reader, HERE / "programs" / "can_reader.cpp"], check=True)
    program = hand.popen([reader, "can0", "40", "712", "7FF"], stdout=subprocess.PIPE, text=True)
    assert program.stdout.readline() == "listening\n"
    before = time.time()
    start(hand, "201#0700")
    out, _ = program.communicate(timeout=10)
    start(hand, "201#0701")
    lines = [line.split() for line in out.splitlines()]
    assert len(lines) == 40 and {line[1] for line in lines} == {"712"}
    assert {line[3] for line in lines} == {"bus"}, "as from a bus, not from a program of this host"
    times = np.array([float(line[0]) for line in lines])
    assert before - 0.01 < times[0] < times[-1] < time.time() and (np.diff(times) > 0).all()
    sent = {frame.data.hex().upper() for _, _, frame in hand.devices[0].truth.frames if frame.arbitration_id == 0x712}
    assert {line[2] for line in lines} <= sent


@pytest.mark.judge("linker_hand_l6", driver="linkerbot", carrier="CAN")
def test_the_hands_own_sdk_on_can1(hand):
    pytest.importorskip("linkerbot")
    dev = hand.devices[1]
    script = Path(__file__).parents[1] / "drivers" / "scripts" / "linkerbot_read.py"
    command = [sys.executable, str(script), "L6", "left", "can1", "socketcan", "50"]
    done = hand.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    got = json.loads(done.stdout)
    truth = {sample.counts.astype(np.uint8).tobytes() for sample in dev.truth.samples}
    readings = np.array(got["readings"], np.uint8)
    assert len(readings) == 50 and all(reading.tobytes() in truth for reading in readings)


UNPLUGGED = """
import can, errno, socket
bus = can.Bus(interface="socketcan", channel="can0")
print("there", flush=True)
said = []
while len(said) < 1:
    try:
        bus.recv(5)
    except can.CanError as error:
        said.append(errno.errorcode[error.error_code])
there = False
while not there:  # as fast as it can: it may find none, but none that does not work
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as eager:
        try:
            eager.bind(("can0",))
            there = eager.send(bytes(16)) == 16
        except OSError as error:
            said.append(errno.errorcode[error.errno])
bus = can.Bus(interface="socketcan", channel="can0")
bus.send(can.Message(arbitration_id=0x201, data=[7, 0], is_extended_id=False))
print(said[0], set(said[1:]), hex(bus.recv(5).arbitration_id))
"""


@pytest.mark.usefixtures("preload")
def test_an_adapter_that_is_unplugged_goes_and_comes_back(hand):
    skin = hand.devices[0]
    start(hand, "201#0701")
    driver = hand.popen([sys.executable, "-c", UNPLUGGED], stdout=subprocess.PIPE, text=True)
    assert driver.stdout.readline() == "there\n"
    skin.inject_event(fault="unplug for 0.5s")
    out, _ = driver.communicate(timeout=10)
    assert re.fullmatch(r"(ENODEV|ENETDOWN) \{'ENODEV'\} 0x710\n", out)
    start(hand, "201#0701")


SERVER = """
import socket, sys
with socket.create_server(("127.0.0.1", int(sys.argv[1]))) as server:
    print("serving", flush=True)
    client, _ = server.accept()
    client.sendall(client.recv(100).upper())
"""


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


def asked(port):
    with socket.create_connection(("127.0.0.1", port), timeout=5) as client:
        client.sendall(b"hello")
        client.shutdown(socket.SHUT_WR)
        return client.recv(100)


ASK = """
import socket, sys
server = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
server.sendall(b"hi")
print(server.recv(9))
"""


def test_ports_lead_out_of_the_view_and_into_it():
    ours, theirs = free_port(), free_port()
    with socket.create_server(("127.0.0.1", ours)) as here:
        with exec_environment(tt.serve("xela_uskin"), expose=[f"tcp:{ours}", f"tcp:{theirs}"]) as env:
            assert f"tcp:{ours} is the machine's" in env.network and f"tcp:{theirs} is the view's" in env.network
            here.accept()[0].close()  # the look whether anybody serves
            inside = env.popen([sys.executable, "-c", ASK, str(ours)], stdout=subprocess.PIPE, text=True)
            client, _ = here.accept()
            assert client.recv(9) == b"hi"
            client.sendall(b"out")
            client.close()
            assert inside.communicate(timeout=10)[0] == "b'out'\n"
            server = env.popen([sys.executable, "-c", SERVER, str(theirs)], stdout=subprocess.PIPE, text=True)
            assert server.stdout.readline() == "serving\n"
            assert asked(theirs) == b"HELLO"
            server.communicate(timeout=10)


def test_a_way_that_is_not_there_is_said():
    if os.path.exists("/sys/module/vcan"):
        pytest.skip("this kernel has vcan")
    with pytest.raises(TactemuError, match="this kernel has no vcan; load it: sudo modprobe vcan"):
        exec_environment(tt.serve("xela_uskin"), way="native").start()
    with pytest.raises(TactemuError, match="expected native or preload"):
        exec_environment(way="both")


if __name__ == "__main__":
    run = Path(__file__).parents[2] / "scripts" / "vcan-run"
    GOLDEN.write_bytes(
        subprocess.run([run, "--", sys.executable, BEHAVIOUR], stdout=subprocess.PIPE, check=True).stdout
    )
