"""Entry points for pyserial, python-can and pytest, through which a port starts and stops its simulated device.

``protocol_tactemu`` is ``serial.serial_for_url("tactemu://anyskin")``, ``can_bus`` is
``can.Bus(interface="tactemu", channel="linker_hand_l6")``. Both run the device in the driver's own process, by
:func:`tactemu.serve`; its default scene moves as under ``tactemu run``. ``pytest_plugin`` is the fixture.
"""
