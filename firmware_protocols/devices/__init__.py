"""The device models: a module for each family of devices, and the modules that families share."""
