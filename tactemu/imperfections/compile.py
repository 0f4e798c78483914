"""The compilation of a sensor's imperfections into stages, in the order of :mod:`tactemu.imperfections.options`.

::

    chain = Imperfections(options, info, context)
    gain, stages = chain.compile_gain()            # for the sensor's kernel, or None
    radius, stages = chain.compile_radius_noise()  # likewise
    measured, stages = chain.compile_values(raw)   # material, scan, electronics
    reading, stages = chain.compile_delivery(measured)  # delay, jitter, history

Each returns the array for the next call (its argument, if nothing is switched on) and the stages that fill the array.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from typing import Any, Protocol, get_args

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.words import hint
from tactemu.imperfections import resets
from tactemu.imperfections.adjustments import Adjustments
from tactemu.imperfections.coefficients import compile_coefficients
from tactemu.imperfections.columns import ParameterRange, ParameterTable
from tactemu.imperfections.crosstalk import compile_crosstalk
from tactemu.imperfections.dead import DeadTaxels
from tactemu.imperfections.delivery import Delay, compile_history
from tactemu.imperfections.elementwise import COLUMNS_PER_THREAD, electronics_kernel, material_kernel
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.laws import check, electronic_laws, gain_is_on, material_laws
from tactemu.imperfections.options import ChainOptions, Law
from tactemu.imperfections.radius import radius_kernel
from tactemu.imperfections.random import stream_keys
from tactemu.imperfections.scan import compile_scan
from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import Launches
from tactemu.plan.plan import Context, Stage

Transduce = Callable[[wp.array], tuple[wp.array, list[Stage], ReadingInfo]]
"""A function that turns a model's array into the electronics' input: the array, its stages and its description."""
NO_LAUNCH = Launches()
"""The launch of a stage that only acts at resets."""


class Adjustable(Protocol):
    """An option that can change while the scene runs.

    It is a :class:`ParameterTable`, a :class:`ParameterRange` or a :class:`Delay`.
    """

    def set(self, value, envs=None, taxels=None) -> None:
        """Change the option in the chosen environments, for the chosen taxels."""
        ...


class Imperfections(Adjustments):
    """The imperfections of one sensor, and the handle by which you change them while the scene runs."""

    def __init__(self, options: ChainOptions, info: ReadingInfo, context: Context):
        check(options, info)
        self.options, self.info, self.context = options, info, context
        self.state: dict[str, wp.array] = {}
        """The memory of the laws, float64, shape ``(n_envs, n_columns)``."""
        self.shortest_step_s = 0.0
        """Shortest step for which the past readings (delay, scan) reach back far enough [s]."""
        self._built: dict[str, Adjustable] = {}
        """The options that can change, by name."""
        self._gain: ParameterTable | None = None
        self._dead: DeadTaxels | None = None

    # -- changing them

    def set(self, option: str, value, envs=None, taxels=None) -> None:
        """Change an option by its name (see :class:`Adjustments`)."""
        if option not in self._built:
            raise self._off(option)
        self._built[option].set(value, envs, taxels)

    def set_dead(self, taxels, dead: bool = True, value: float | None = None, envs=None) -> None:
        """Make taxels dead, or revive them; without a value they are stuck at their last reading."""
        self._killable.set(taxels, dead, value, envs)

    @property
    def adjustable(self) -> tuple[str, ...]:
        """The options that :meth:`set` may change, and ``dead`` if taxels may die."""
        return (*self._built, *(() if self._dead is None else ("dead",)))

    @property
    def dead(self) -> np.ndarray:
        """A mask of the dead taxels, bool, shape ``(n_envs, n_taxels)``."""
        return self._killable.mask

    @property
    def stuck(self) -> wp.array | None:
        """The readings of dead columns, ``(n_envs, n_columns)``, infinite where alive; ``None``: no taxel can die."""
        return None if self._dead is None else self._dead.stuck

    @property
    def _killable(self) -> DeadTaxels:
        if self._dead is None:
            raise self._off("dead")
        return self._dead

    def _off(self, option: str) -> SceneError:
        known = get_args(Law)
        if option not in known:
            told = hint(option, known) or f" (can change: {', '.join(known)})"
            return SceneError(f"sensor {self.info.name!r} has no imperfection {option!r}{told}")
        return SceneError(
            f"sensor {self.info.name!r} was built without {option}: set it when you build, or make it adjustable "
            f"(`adjustable=[{option!r}]` in Python, `tactemu run ... --adjustable {option}`)"
        )

    # -- for the sensor's kernel

    def compile_gain(self) -> tuple[wp.array | None, list[Stage]]:
        """Return gains ``(n_envs, n_taxels)``, or ``None`` if all are 1, and a stage if they are drawn at resets."""
        if not gain_is_on(self.options):
            return None, []
        per_taxel = replace(self.info, channels=("scalar",))
        self._gain = ParameterTable(self.options.gain, per_taxel, "gain", self.context, wide=True)
        self._built["gain"] = self._gain
        gain, limits = self._gain.array, self.options.gain_range
        if limits is None:
            return gain, []
        redraw = self._redraw_gain(gain, *limits)
        return gain, [
            Stage(name=f"{self.info.name}: gain", reason="gains drawn at resets", launch=NO_LAUNCH, reset=redraw)
        ]

    def _redraw_gain(self, gain: wp.array, low: float, high: float) -> Callable[[wp.array], None]:
        kernel, keys = resets.gain_kernel(self.context.real), self._keys("gain")

        def redraw(mask: wp.array) -> None:
            self._launch(kernel, gain.shape, [mask, self.context.clock, keys, wp.vec2d(low, high), gain])

        redraw(wp.full(self.context.n_envs, True, dtype=wp.bool, device=self.context.device))
        return redraw

    def compile_radius_noise(self) -> tuple[wp.array | None, list[Stage]]:
        """Return the radii of the measured branch ``(n_envs, n_taxels)`` and the stage that draws them each step.

        Without noise on the radii they are ``None``.
        """
        if not self.options.radius_noise and "radius_noise" not in self.options.adjustable:
            return None, []
        context, n = self.context, self.info.n_taxels
        table = ParameterTable(self.options.radius_noise, self.info, "radius_noise", context)
        self._built["radius_noise"] = table
        nominal = wp.array(np.asarray(self.info.radius).reshape(n), dtype=context.real, device=context.device)
        radius = self._zeros((context.n_envs, n), context.real)
        launch = context.record(
            radius_kernel(context.real),
            (context.n_envs, -(-n // 4)),
            [nominal, context.clock, self._keys("radius_noise"), table.array],
            [radius],
        )
        name = f"{self.info.name}: radius_noise"
        return radius, [Stage(name=name, reason="radius_noise", launch=launch, reset=self._clear([radius]))]

    # -- on the sensor's readings

    def compile_values(self, raw: wp.array, transduce: Transduce | None = None) -> tuple[wp.array, list[Stage]]:
        """Apply crosstalk, material, scan and electronics to ``raw`` ``(n_envs, n_taxels, n_channels)``.

        The result has the shape of ``raw``, or that of the transducer's signal. The transducer acts between the memory
        of the material and the electronics.
        """
        material, electronic = material_laws(self.options), electronic_laws(self.options, self.info)
        (coefficient, warmth), stages = compile_coefficients(
            self.options, material | electronic, self.info.name, self.context
        )
        array, spread = compile_crosstalk(self.options, raw, self.info, self.context)
        stages += spread
        if material:
            array, stage = self._material(array, material, coefficient)
            stages.append(stage)
        if transduce is not None:
            array, more, self.info = transduce(array)
            stages += more
        if self.options.scan_time > 0.0:
            self.shortest_step_s = self._dt_s
            flat, stage = compile_scan(self.options, self._flatten(array), self.info, self.context)
            array = flat.reshape(array.shape)
            stages.append(stage)
        if electronic:
            array, stage = self._electronics(array, electronic, coefficient, warmth)
            stages.append(stage)
        return array, stages

    def _material(self, x: wp.array, laws: frozenset[str], coefficient) -> tuple[wp.array, Stage]:
        options, context = self.options, self.context
        state = {
            name: self._zeros(self._flat, wp.float64) if law in laws else None
            for name, law in (
                ("load", "hysteresis"),
                ("overshoot", "hysteresis"),
                ("undershoot", "unloading"),
                ("creep_load", "creep"),
                ("crept", "creep"),
                ("loop", "backlash"),
            )
        }
        self.state |= {name: array for name, array in state.items() if array is not None}
        unloading = options.hysteresis_strength_unloading
        strength = options.hysteresis_strength
        strengths = wp.vec3d(strength, strength if unloading is None else unloading, options.creep_strength)
        out = self._zeros(x.shape, context.real)
        launch = context.record(
            material_kernel(context.real, laws),
            self._threads,
            [self._flatten(x), coefficient, strengths, options.hysteresis_backlash, *state.values()],
            [self._flatten(out)],
        )
        reset = self._clear([*state.values(), self._flatten(out)])
        return out, Stage(name=f"{self.info.name}: material", reason=_reason(laws), launch=launch, reset=reset)

    def _electronics(self, x: wp.array, laws: frozenset[str], coefficient, warmth) -> tuple[wp.array, Stage]:
        context, options, real = self.context, self.options, self.context.real

        def table(option: str, law: str = "") -> wp.array | None:
            return self._table(option).array if (law or option) in laws else None

        clipped = None
        if "saturation_range" in laws:
            wide = "saturation_range" in options.adjustable
            clipped = ParameterRange(options.saturation_range, self.info, "saturation_range", context, wide=wide)
            self._built["saturation_range"] = clipped
        walked = self._zeros(self._flat, wp.float64) if "random_walk" in laws else None
        if walked is not None:
            self.state["random_walk"] = walked
        if "dead" in laws:
            self._dead = DeadTaxels(options, self.info, context)
        kernel, out = electronics_kernel(real, laws), self._zeros(x.shape, real)
        inputs = {
            "x": self._flatten(x),
            "n_channels": self.info.n_channels,
            "clock": context.clock,
            "coefficient": coefficient,
            "warmth": warmth,
            "walk_keys": self._keys("random_walk"),
            "noise_keys": self._keys("noise"),
            "gains": self._gain.array if self._gain is not None and "gain" in laws else None,
            "sensitivity": table("temperature_sensitivity", "temperature"),
            "drift": table("temperature_offset", "temperature"),
            "walk_each": table("random_walk"),
            "walk_root": table("random_walk_density"),
            "noise_each": table("noise"),
            "noise_root": table("noise_density"),
            "offset": table("bias"),
            "low": clipped and clipped.low.array,
            "high": clipped and clipped.high.array,
            "quantum": table("resolution"),
            "is_filler": wp.array(self.info.filler.astype(np.uint8), dtype=wp.uint8, device=context.device),
            "walked": walked,
            "stuck": self.stuck,
        }
        launch = context.record(kernel, self._threads, in_order(kernel, inputs), [self._flatten(out)])
        clear, dead = self._clear([walked, self._flatten(out)]), self._dead

        def reset(mask: wp.array) -> None:
            clear(mask)
            if dead is not None:
                dead.redraw(mask)

        return out, Stage(name=f"{self.info.name}: electronics", reason=_reason(laws), launch=launch, reset=reset)

    def compile_delivery(self, measured: wp.array) -> tuple[wp.array, list[Stage]]:
        """Delay ``measured`` and add a history: ``(n_envs, [history,] n_taxels, n_channels)``, of any number type."""
        stages: list[Stage] = []
        array = measured
        if self.options.delay > 0.0 or self.options.jitter > 0.0 or "jitter" in self.options.adjustable:
            self.shortest_step_s = self._dt_s
            delay = Delay(self.options, self.info, self.context)
            array, stages = delay.compile(measured)
            if delay.has_jitter:
                self._built["jitter"] = delay
        array, more = self.compile_history(array)
        return array, stages + more

    def compile_history(self, reading: wp.array) -> tuple[wp.array, list[Stage]]:
        """Return the last ``history_length`` arrays, newest first, and their stages.

        The ground truth, which is not delayed, has a history of its own.
        """
        return compile_history(self.options.history_length, reading, self.info, self.context)

    def check_step(self, dt: float) -> None:
        """Check that a step is not shorter than those for which past readings are kept.

        With shorter steps readings would arrive before their delay.

        Raises:
            ValueError: ``dt`` [s] is shorter than the scene's.
        """
        if dt < self.shortest_step_s * (1 - 1e-9):
            raise ValueError(
                f"step: sensor {self.info.name!r} keeps past readings for steps of {self.shortest_step_s:g} s"
                f" or longer, got {dt:g} s; build the scene with the shortest dt that you step with"
            )

    # -- helpers

    @property
    def _dt_s(self) -> float:
        return float(self.context.dt.numpy()[0])

    @property
    def _flat(self) -> tuple[int, int]:
        return self.context.n_envs, self.info.n_columns

    @property
    def _threads(self) -> tuple[int, int]:
        return self.context.n_envs, -(-self.info.n_columns // COLUMNS_PER_THREAD)

    def _flatten(self, array: wp.array) -> wp.array:
        return array.reshape(self._flat)

    def _keys(self, stage: str) -> wp.vec2ui:
        return stream_keys(self.context.seed, f"{self.info.name}/{stage}")

    def _zeros(self, shape, dtype) -> wp.array:
        return self.context.zeros(shape, dtype)

    def _launch(self, kernel, dim, inputs: list) -> None:
        wp.launch(kernel, dim=dim, inputs=inputs, device=self.context.device)

    def _table(self, option: str) -> ParameterTable:
        value, wide = getattr(self.options, option), option in self.options.adjustable
        self._built[option] = table = ParameterTable(value, self.info, option, self.context, wide=wide)
        return table

    def _clear(self, arrays: list):
        arrays = [a for a in arrays if a is not None]

        def clear(mask: wp.array) -> None:
            for array in arrays:
                clear_rows(array, mask)

        return clear


def _reason(laws: frozenset[str]) -> str:
    return ", ".join(sorted(laws))


def in_order(kernel, inputs: dict[str, Any]) -> list:
    """Return inputs in the order of a kernel's parameters after ``first_env``; the outputs are its last parameters."""
    names = list(signature(kernel.func).parameters)[1 : 1 + len(inputs)]
    return [inputs[name] for name in names]
