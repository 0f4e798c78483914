"""The imperfections of real taxels: laws that change a sensor's raw readings into those that a device reads."""

from tactemu.imperfections.adjustments import Adjustments
from tactemu.imperfections.compile import Imperfections
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.options import ChainOptions, ElectronicsOptions, ImperfectionOptions

__all__ = [
    "Adjustments", "ChainOptions", "ElectronicsOptions", "ImperfectionOptions", "Imperfections", "ReadingInfo",
]  # fmt: skip
