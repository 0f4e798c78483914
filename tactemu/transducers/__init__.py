"""Transducers and materials: the stages of the plan that turn contact into the signal that the electronics measures.

:mod:`tactemu.transducers.laws` has their equations in numpy, for fits; each other file has one stage, in Warp.
"""
