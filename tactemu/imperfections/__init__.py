"""Wrong the way real taxels are wrong: laws on values, between a sensor's raw readings and what is read from it."""

from tactemu.imperfections.adjustments import Adjustments
from tactemu.imperfections.compile import Imperfections
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.options import ImperfectionOptions

__all__ = ["Adjustments", "ImperfectionOptions", "Imperfections", "ReadingInfo"]
