"""The ground of the package: errors, units, clocks, timers, random streams, files, and this machine."""
