"""``published.py NAME PORT``: published drivers, printing what they hand out; else unmodified, and never helped."""

import json
import sys
import time


def hand_out(row):
    print(json.dumps(row), flush=True)


def anyskin(port):
    from anyskin.sensor import AnySkinBase

    driver = AnySkinBase(num_mags=5, port=port, temp_filtered=False, baudrate=115200)
    while True:
        hand_out([float(value) for value in driver.get_sample()[1]])


def optoforce(port):
    import optoforce

    driver = optoforce.OptoForce16(port=port, speed_hz=100, filter_hz="none")
    driver.connect()
    while True:
        packet = driver.read(only_latest_data=False)
        hand_out({"fx": packet.Fx, "fy": packet.Fy, "fz": packet.Fz, "n": packet.count, "valid": packet.valid_checksum})


def pyrobotiqtactile(port):
    from pyrobotiqtactile import RobotiqTactileSensor

    driver = RobotiqTactileSensor(port=port, baud_rate=115200)
    driver.connect()
    driver.configure(update_period_ms=10)
    while not driver.read_frame(timeout=1.0).timestamp.any():
        pass
    while True:
        hand_out(driver.read_frame(timeout=1.0).pressure.reshape(-1).tolist())


def pymodbus(port):
    import logging

    from pymodbus.client import ModbusSerialClient

    logging.disable(logging.CRITICAL)
    driver = ModbusSerialClient(port, baudrate=115200, timeout=0.5, retries=0)
    driver.connect()
    while True:
        try:
            hand_out(driver.read_holding_registers(4900, count=112, device_id=1).registers)
        except Exception as error:  # as a user's program would
            sys.stderr.write(f"{error}\n")
            time.sleep(0.02)


def flexitac(port):
    from flexitac.sensor import FlexiTacSensor

    driver = FlexiTacSensor(port, baseline=20.0, read_timeout_s=1.0, baud=2_000_000)
    driver.open()
    while True:
        hand_out(driver.read().raw.reshape(-1).tolist())


DRIVERS = {each.__name__: each for each in (anyskin, optoforce, pyrobotiqtactile, pymodbus, flexitac)}

if __name__ == "__main__":
    DRIVERS[sys.argv[1]](sys.argv[2])
