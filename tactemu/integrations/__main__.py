"""The command that prints the folder with which ``can.Bus(interface="socketcan")`` opens a simulated device.

::

    PYTHONPATH=$(python -m tactemu.integrations) TACTEMU_SOCKETCAN=can0=linker_hand_l6 python driver.py
"""

from pathlib import Path

if __name__ == "__main__":
    print(Path(__file__).parent / "socketcan")
