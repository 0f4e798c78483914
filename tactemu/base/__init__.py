"""The foundation of the package: errors, units, clocks, schedules, random streams, files, and the host machine."""
