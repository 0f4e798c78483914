"""From options to stages: what spoils the readings of one sensor, in the order of :mod:`tactemu.imperfections.options`.

::

    chain = Imperfections(options, info, context)
    gain, stages = chain.compile_gain()            # for the sensor's kernel, or None
    radius, stages = chain.compile_radius_noise()  # the same
    measured, stages = chain.compile_values(raw)   # material, scan, electronics
    reading, stages = chain.compile_delivery(measured)  # delay, jitter, history

Each returns the array to go on with (the one it was given, if nothing is switched on) and the stages that fill it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.imperfections import resets
from tactemu.imperfections.adjustments import Adjustments
from tactemu.imperfections.coefficients import compile_coefficients
from tactemu.imperfections.columns import Table
from tactemu.imperfections.crosstalk import compile_crosstalk
from tactemu.imperfections.delivery import Delay, compile_history
from tactemu.imperfections.elementwise import (
    ALIVE,
    COLUMNS_PER_THREAD,
    electronics_kernel,
    material_kernel,
)
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.laws import check, electronic_laws, gain_is_on, material_laws
from tactemu.imperfections.options import ImperfectionOptions
from tactemu.imperfections.radius import radius_kernel
from tactemu.imperfections.scan import compile_scan
from tactemu.plan.clearing import clear_rows
from tactemu.plan.plan import Context, Stage, record
from tactemu.random_streams import stream_key


def nothing() -> None:
    """The launch of a stage that only acts at resets."""


class Imperfections(Adjustments):
    """The imperfections of one sensor, and the handle by which they are changed while running."""

    def __init__(self, options: ImperfectionOptions, info: ReadingInfo, context: Context):
        check(options, info)
        self.options, self.info, self.context = options, info, context
        self.tables: dict[str, Table] = {}
        self.gain: wp.array | None = None
        """Gain of each taxel, shape ``(n_envs, n_taxels)``; ``None`` where all are 1."""
        self.stuck: wp.array | None = None
        """What dead columns read, shape ``(n_envs, n_columns)``, infinite where alive."""
        self.state: dict[str, wp.array] = {}
        """What the laws remember, float64, shape ``(n_envs, n_columns)``."""
        self.shortest_step_s = 0.0
        """Shortest step for which what is kept of the past (delay, scan) lasts long enough [s]."""
        self._delay: Delay | None = None
        self._resets = self._zeros((context.n_envs,), wp.int32)
        self._counted = False

    # -- for the sensor's kernel

    def compile_gain(self) -> tuple[wp.array | None, list[Stage]]:
        """Gains ``(n_envs, n_taxels)``, or ``None`` if all are 1; with a stage only if they are drawn at resets."""
        if not gain_is_on(self.options):
            return None, []
        n = self.info.n_taxels
        gain = np.asarray(self.options.probe_gain, dtype=np.float64).reshape(-1)
        if gain.size not in (1, n) or not np.all(np.isfinite(gain)):
            raise SceneError(f"sensor {self.info.name!r}: probe_gain must be one finite number or {n}, got {gain.size}")
        rows = np.tile(np.broadcast_to(gain, (n,)), (self.context.n_envs, 1))
        self.gain = wp.array(rows, dtype=self.context.real, device=self.context.device)
        limits = self.options.probe_gain_resample_range
        if limits is None:
            return self.gain, []
        redraw = self._counting(self._redraw_gain(self.gain, *limits))
        return self.gain, [
            Stage(name=f"{self.info.name}: gain", reason="gains drawn at resets", launch=nothing, reset=redraw)
        ]

    def _redraw_gain(self, gain: wp.array, low: float, high: float) -> Callable[[wp.array], None]:
        kernel, key = resets.gain_kernel(self.context.real), self._key("gain")

        def redraw(mask: wp.array) -> None:
            self._launch(kernel, gain.shape, [mask, self._resets, key, low, high, gain])

        redraw(self._everywhere())
        return redraw

    def compile_radius_noise(self) -> tuple[wp.array | None, list[Stage]]:
        """Radii of the measured branch ``(n_envs, n_taxels)``, new each step; ``None`` without noise on them."""
        if not self.options.probe_radius_noise and "radius_noise" not in self.options.adjustable:
            return None, []
        context, n = self.context, self.info.n_taxels
        table = self._table("radius_noise", self.options.probe_radius_noise, narrow=True)
        nominal = wp.array(np.asarray(self.info.probe_radius).reshape(n), dtype=context.real, device=context.device)
        radius = self._zeros((context.n_envs, n), context.real)
        launch = record(
            radius_kernel(context.real),
            (context.n_envs, -(-n // 4)),
            [nominal, context.step, self._key("radius_noise"), self._resets, table.array],
            [radius],
            context.device,
        )
        name, reset = f"{self.info.name}: radius_noise", self._counting(self._clear([radius]))
        return radius, [Stage(name=name, reason="probe_radius_noise", launch=launch, reset=reset)]

    # -- on the sensor's readings

    def compile_values(self, raw: wp.array) -> tuple[wp.array, list[Stage]]:
        """Spoils ``raw`` ``(n_envs, n_taxels, n_channels)``; the result has its shape."""
        material, electronic = material_laws(self.options), electronic_laws(self.options, self.info)
        coefficient, stages = compile_coefficients(self.options, material | electronic, self.info.name, self.context)
        array, spread = compile_crosstalk(self.options, raw, self.info, self.context)
        stages += spread
        if material:
            array, stage = self._material(array, material, coefficient)
            stages.append(stage)
        if self.options.scan_time > 0.0:
            self.shortest_step_s = self._dt_s
            flat, stage = compile_scan(self.options, self._flatten(array), self.info, self.context)
            array = flat.reshape(raw.shape)
            stages.append(stage)
        if electronic:
            array, stage = self._electronics(array, electronic, coefficient)
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
        launch = record(
            material_kernel(context.real, laws),
            self._threads,
            [self._flatten(x), coefficient, strengths, options.hysteresis_backlash, *state.values()],
            [self._flatten(out)],
            context.device,
        )
        reset = self._clear([*state.values(), self._flatten(out)])
        return out, Stage(name=f"{self.info.name}: material", reason=_reason(laws), launch=launch, reset=reset)

    def _electronics(self, x: wp.array, laws: frozenset[str], coefficient) -> tuple[wp.array, Stage]:
        context, options, real = self.context, self.options, self.context.real
        low, high = options.saturation_range or (-np.finfo(np.float32).max, np.finfo(np.float32).max)

        def table(law: str, name: str, value, narrow: bool = False):
            return self._table(name, value, narrow=narrow).array if law in laws else None

        is_filler = wp.array(self.info.filler.astype(np.uint8), dtype=wp.uint8, device=context.device)
        walked = self._zeros(self._flat, wp.float64) if "random_walk" in laws else None
        if walked is not None:
            self.state["random_walk"] = walked
        redraw_dead = self._redraw_dead() if "dead" in laws else None
        out = self._zeros(x.shape, real)
        launch = record(
            electronics_kernel(real, laws),
            self._threads,
            [
                self._flatten(x), self.info.n_channels, context.step, coefficient,
                self._key("random_walk"), self._key("noise"), self._resets,
                self.gain if "gain" in laws else None,
                table("temperature", "temperature_sensitivity", options.temperature_sensitivity),
                table("temperature", "temperature_offset", options.temperature_offset),
                table("random_walk", "random_walk", options.random_walk),
                table("random_walk_density", "random_walk_density", options.random_walk_density),
                table("noise", "noise", options.noise),
                table("noise_density", "noise_density", options.noise_density),
                table("bias", "bias", options.bias),
                table("saturation", "saturation_low", low, True),
                table("saturation", "saturation_high", high, True),
                table("resolution", "resolution", options.resolution),
                is_filler, walked, self.stuck,
            ],
            [self._flatten(out)],
            context.device,
        )  # fmt: skip
        clear = self._clear([walked, self._flatten(out)])

        def reset(mask: wp.array) -> None:
            clear(mask)
            if redraw_dead is not None:
                redraw_dead(mask)

        reset = self._counting(reset)
        return out, Stage(name=f"{self.info.name}: electronics", reason=_reason(laws), launch=launch, reset=reset)

    def _redraw_dead(self):
        options, real = self.options, self.context.real
        self.stuck = wp.full(self._flat, ALIVE, dtype=real, device=self.context.device)
        arguments = [
            self._key("dead"), options.dead_taxel_probability, *options.dead_taxel_value_range,
            options.dead_taxel_mode == "last", self.info.n_channels,
        ]  # fmt: skip

        def redraw(mask: wp.array) -> None:
            self._launch(resets.dead_kernel(real), self._flat, [mask, self._resets, *arguments, self.stuck])

        redraw(self._everywhere())
        return redraw

    def compile_delivery(self, measured: wp.array) -> tuple[wp.array, list[Stage]]:
        """Delays ``measured`` and adds a history: ``(n_envs, [history,] n_taxels, n_channels)``, any number type."""
        stages: list[Stage] = []
        array = measured
        if self.options.delay > 0.0 or self.options.jitter > 0.0 or "jitter" in self.options.adjustable:
            self.shortest_step_s = self._dt_s
            self._delay = Delay(self.options, self.info, self.context, self._resets)
            array, stages = self._delay.compile(measured)
            stages[0].reset = self._counting(stages[0].reset)
        array, more = self.compile_history(array)
        return array, stages + more

    def compile_history(self, reading: wp.array) -> tuple[wp.array, list[Stage]]:
        """The last ``history_length`` arrays, newest first: for the ground truth, which is not delayed."""
        return compile_history(self.options.history_length, reading, self.info, self.context)

    def check_step(self, dt: float) -> None:
        """Refuses a step shorter than those that the past is kept for: readings would arrive before their delay.

        Raises:
            ValueError: if ``dt`` [s] is shorter than the scene's.
        """
        if dt < self.shortest_step_s * (1 - 1e-9):
            raise ValueError(
                f"step: sensor {self.info.name!r} keeps its past for steps of {self.shortest_step_s:g} s"
                f" or longer, got {dt:g} s; build the scene with the shortest dt that you step with"
            )

    # -- helpers

    def _counting(self, reset):
        """``reset``, which in the first stage that draws random numbers also counts the resets for all of them."""
        if self._counted:
            return reset
        self._counted = True

        def counting(mask: wp.array) -> None:
            self._launch(resets.count_resets, mask.shape, [mask, self._resets])
            reset(mask)

        return counting

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

    def _key(self, stage: str) -> int:
        return stream_key(self.context.seed, f"{self.info.name}/{stage}")

    def _zeros(self, shape, dtype) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self.context.device)

    def _everywhere(self) -> wp.array:
        return wp.full(self.context.n_envs, True, dtype=wp.bool, device=self.context.device)

    def _launch(self, kernel, dim, inputs: list) -> None:
        wp.launch(kernel, dim=dim, inputs=inputs, device=self.context.device)

    def _table(self, name: str, value, *, narrow: bool = False) -> Table:
        table = Table(
            value,
            self.info,
            name,
            n_envs=self.context.n_envs,
            dtype=self.context.real,
            device=self.context.device,
            wide=not narrow and name in self.options.adjustable,
        )
        self.tables[name] = table
        return table

    def _clear(self, arrays: list):
        arrays = [a for a in arrays if a is not None]

        def clear(mask: wp.array) -> None:
            for array in arrays:
                clear_rows(array, mask)

        return clear


def _reason(laws: frozenset[str]) -> str:
    return ", ".join(sorted(laws))
