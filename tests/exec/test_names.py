"""Names and ids, as those see them who look for a port: pyserial, libudev, LeRobot, drivers, and plain readers."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import tactemu
from tests.drivers.environments import python_with


@pytest.fixture(scope="module")
def env():
    hub, skin, bridge = (tactemu.serve(name) for name in ("robotiq_tsf85", "anyskin", "eflesh_binary"))
    with tactemu.exec_environment(hub, skin, bridge, nodes={"eflesh_binary": "ttyUSB0", "anyskin": "ttyACM0"}) as env:
        yield env


def script(env, text, python=sys.executable, **options):
    """What a script in the view prints, as JSON."""
    done = env.run([python, "-c", text], capture_output=True, text=True, timeout=30, **options)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_ports_are_where_they_were_asked_for(env):
    assert env.nodes == {"fingers": "/dev/ttyACM1", "anyskin": "/dev/ttyACM0", "eflesh_binary": "/dev/ttyUSB0"}
    assert not any(map(os.path.exists, ("/run/udev/.tactemu", "/sys/devices/tactemu", "/sys/class/tty/ttyACM1")))


@pytest.mark.driver
def test_pyserial_lists_them(env):
    found = script(
        env,
        "import json; from serial.tools import list_ports\n"
        "print(json.dumps({p.device: [p.vid, p.pid, p.serial_number, p.manufacturer, p.product, p.description, "
        "p.location] for p in list_ports.comports()}))",
    )
    assert found["/dev/ttyACM1"][:2] == [0x16D0, 0x14CC]
    assert found["/dev/ttyUSB0"][:2] == [0x10C4, 0xEA60]
    assert found["/dev/ttyACM0"][3:5] == ["Adafruit", "QT Py M0"]
    assert len({told[2] for told in found.values()}) == len(found) == 3, "serial numbers, and no port of the machine"


@pytest.mark.driver
def test_a_board_that_declares_no_ids_has_the_number_for_tests():
    with tactemu.serve("paxini_gen2") as dev, tactemu.exec_environment(dev) as env:
        found = script(
            env,
            "import json; from serial.tools.list_ports import comports\n"
            "print(json.dumps([[p.vid, p.pid, p.manufacturer, p.product] for p in comports()]))",
        )
        assert found == [[0x1209, 1, "tactemu", "PaXini PX-6AX, GEN2 control box"]]


@pytest.mark.driver
def test_udev_enumerates_them(env):
    pytest.importorskip("pyudev", reason="pip install pyudev")
    found = script(
        env,
        "import json, os, pyudev; c = pyudev.Context()\n"
        "ports = [d for d in c.list_devices(subsystem='tty') if d.find_parent('usb', 'usb_device')]\n"
        "tell = lambda d: [d['ID_VENDOR_ID'], d['ID_MODEL_ID'], d.is_initialized, d.parent.driver,\n"
        "    d.find_parent('usb', 'usb_device').attributes.asstring('idVendor'), sorted(d.device_links)[0],\n"
        "    pyudev.Devices.from_device_file(c, d.device_node) == d]\n"
        "print(json.dumps({d.device_node: tell(d) for d in ports}))",
    )
    assert sorted(found) == ["/dev/ttyACM0", "/dev/ttyACM1", "/dev/ttyUSB0"]
    link = found["/dev/ttyUSB0"].pop(-2)
    assert found["/dev/ttyUSB0"] == ["10c4", "ea60", True, "cp210x", "10c4", True]
    assert link.startswith("/dev/serial/by-id/usb-10c4_ea60_") and link.endswith("-if00-port0")


def test_plain_readers_of_sysfs_see_them(env):
    read = "cd -P /sys/class/tty/ttyACM1/device/..; cat idVendor idProduct serial; basename $(readlink subsystem)"
    told = env.run(["sh", "-c", read], capture_output=True, text=True).stdout.split()
    by_id = env.run(["sh", "-c", "readlink -f /dev/serial/by-id/*"], capture_output=True, text=True).stdout.split()
    assert told[:2] == ["16d0", "14cc"] and told[-1] == "usb"
    assert sorted(by_id) == sorted(env.nodes.values())
    null = env.run(["stat", "-c", "%t:%T", "/dev/null"], capture_output=True, text=True).stdout.strip()
    assert null == "1:3", "what the machine has is still there"


@pytest.mark.driver
def test_robotiqs_driver_takes_the_port_that_it_finds(exec_environment):
    found = script(
        exec_environment("robotiq_tsf85"),
        "import json, serial.tools.list_ports; from pyrobotiqtactile import RobotiqTactileSensor\n"
        "with RobotiqTactileSensor() as sensor:\n"
        "    sensor.configure(update_period_ms=10)\n"
        "    print(json.dumps([sensor.serial_port.port, sensor.read_frame(timeout=2.0).pressure.size]))",
    )
    assert found == ["/dev/ttyACM0", 56]


@pytest.mark.driver
def test_anyskins_driver_opens_the_port_that_it_has_by_heart(env):
    env.devices[1].press(depth=1e-3, wait=False)
    found = script(
        env,
        "import contextlib, importlib.util as util, io, json, re; from anyskin import AnySkinBase\n"
        "viewer = open(util.find_spec('anyskin.visualizations.heatmap').origin).read()\n"
        'port = re.search(r\'default="(/dev/[^"]+)"\', viewer)[1]\n'
        "with contextlib.redirect_stdout(io.StringIO()): sensor = AnySkinBase(num_mags=5, port=port)\n"
        "print(json.dumps([port, len(sensor.get_sample()[1])]))",
    )
    assert found == ["/dev/ttyACM0", 15]


@pytest.mark.nightly
@pytest.mark.driver
def test_lerobot_finds_the_port_that_is_unplugged(exec_environment):
    env = exec_environment("feetech_sts3215")
    assert list(env.nodes.values()) == ["/dev/ttyUSB0"], "a board without USB is behind an adapter"
    tool = Path(python_with("lerobot")).with_name("lerobot-find-port")
    with env.popen([tool], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin and process.stdout
        while "press Enter" not in (line := process.stdout.readline()):
            assert line, "the tool has ended"
        env.devices[0].inject_event(fault="unplug for 4s")  # it looks half a second after Enter
        out, _ = process.communicate("\n", timeout=60)
    assert "The port of this MotorsBus is '/dev/ttyUSB0'" in out


UARTS = """
import json, os, sys
from serial.tools import list_ports
listed = {p.device: [p.vid, p.hwid] for p in list_ports.comports()}
told = {}
for node in sys.argv[1:]:
    device = os.path.realpath(f"/sys/class/tty/{node}/device")
    name = lambda link: os.path.basename(os.path.realpath(f"{device}/{link}"))
    told[node] = [name("subsystem"), name("driver"), listed.get(f"/dev/{node}"), os.path.exists(f"/dev/{node}"),
        os.path.samefile(device, f"/sys/bus/{name('subsystem')}/devices/{os.path.basename(device)}")]
print(json.dumps([told, sorted(os.listdir("/sys/bus/platform/drivers"))[:3] != [], os.path.exists("/dev/serial")]))
"""


@pytest.mark.driver
def test_a_uart_of_the_board_is_on_its_own_bus():
    for node, told in (
        ("ttyAMA0", ["amba", "uart-pl011", [None, "3f201000.serial"], True, True]),
        ("ttyS1", ["pnp", "serial", [None, "PNP0501"], True, True]),
        ("ttyTHS1", ["platform", "serial-tegra", None, True, True]),
        ("/dev/ttymxc2", ["platform", "imx-uart", None, True, True]),
    ):
        name = node.removeprefix("/dev/")
        with tactemu.exec_environment(tactemu.serve("dfrobot_tactile"), nodes=node) as env:
            done = env.run([sys.executable, "-c", UARTS, name], capture_output=True, text=True)
            assert json.loads(done.stdout) == [{name: told}, True, False], done.stderr


def test_a_uart_is_read_and_comes_back_after_the_cable_was_out():
    with tactemu.serve("anyskin") as dev, tactemu.exec_environment(dev, nodes="ttyAMA0") as env:
        read = ["sh", "-c", "head -c 200 /dev/ttyAMA0 | wc -c"]
        assert env.run(read, capture_output=True, text=True, timeout=30).stdout.split() == ["200"]
        dev.unplug(0.2)
        read[2] = f"sleep 0.3; until [ -e /dev/ttyAMA0 ]; do sleep 0.05; done; {read[2]}"
        assert env.run(read, capture_output=True, text=True, timeout=30).stdout.split() == ["200"]
