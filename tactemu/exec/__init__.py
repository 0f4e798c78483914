"""A private view of the machine in which emulated sensors are hardware: ``tactemu exec``.

Two processes and a library make it. The *keeper* (:mod:`~tactemu.exec.keeper`) sits in namespaces of its own, in which
``/dev``, ``/sys`` and ``/run/udev`` have the emulated devices beside what the machine has; it is the view's kernel and
udev. The emulator tells it what is plugged in (:mod:`~tactemu.exec.port`). The driver is started inside
(:mod:`~tactemu.exec.enter`) with a preload library (``preload/``), which answers what a pseudo terminal does not and
tells the emulator.

::

    emulator ──plug, unplug──▶ keeper ──nodes, sysfs, udev's events──▶ driver
        ▲                                                                 │
        └──────── pseudo terminal; modem lines, parity, break ────────────┘
"""
