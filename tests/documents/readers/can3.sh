#!/bin/sh
# A driver with a fixed bus.
exec cat /sys/class/net/can3/type
