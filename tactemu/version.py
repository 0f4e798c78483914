"""The version: what the package is built with, and what files say that they were made by."""

__version__ = "0.1.0"
