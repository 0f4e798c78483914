"""From contact to what the electronics sees: transducers and materials, as stages of the plan between model and noise.

:mod:`tactemu.transducers.laws` has their equations, in numpy, for a fit; each file has one stage, in Warp.
"""
