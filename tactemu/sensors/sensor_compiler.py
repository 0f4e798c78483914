"""The compilation of a scene's sensors: from a skin to its stages, and to the arrays behind its readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.geometry.bodies import Body
from tactemu.imperfections import ChainOptions, Imperfections, ReadingInfo
from tactemu.imperfections.compile import Transduce
from tactemu.plan.plan import Context, Stage
from tactemu.sensors.contacts import contact_flags, probe_points
from tactemu.sensors.drawing import check_drawing
from tactemu.sensors.point_cloud import PointCloud
from tactemu.sensors.poses import RelativePoses
from tactemu.sensors.sensor import Built, Outputs, Sensor, sensed_bodies
from tactemu.sensors.sensor_model import Compiled, Site, upload_probes
from tactemu.sensors.shape_table import ShapeTables
from tactemu.transducers.transducer import SignalType, TransducerSite

MAX_LAUNCH_THREADS = 2**31
"""Warp counts the threads of a launch, and the indices of an array's axis, in 31 bits."""

MEMORIES = ("hysteresis_strength", "hysteresis_strength_unloading", "creep_strength")
"""The imperfections of a skin by which its reading depends on the course of the load."""


def _reading_info(sensor: Sensor, kind: SignalType | None = None) -> ReadingInfo:
    """Return the facts that the imperfections need of a sensor's reading: that of its transducers if ``kind`` is given,
    else that of its model."""
    model, probes = sensor.model, sensor._probes
    return ReadingInfo(
        name=sensor.name,
        layout=probes.layout,
        channels=model.channels if kind is None else ("force",) if kind.vector else ("scalar",),
        unit=model.unit if kind is None else kind.unit,
        radius=probes.radii,
        spacing=probes.spacing if probes.is_grid else None,
        normal=probes.mean_normal,
        gain_inside=model.gain_inside,
    )


def _areas(sensor: Sensor) -> np.ndarray:
    """Return the area of each taxel [m²]: the model's ``taxel_area``, its cell of a grid, or the circle of its
    probe."""
    probes, given = sensor._probes, getattr(sensor.model, "taxel_area", None)
    if given is None and probes.is_grid:
        given = abs(probes.spacing[0] * probes.spacing[1])
    if given is None or not np.all(np.asarray(given) > 0):  # a grid of one row or column has no spacing
        given = np.pi * np.asarray(probes.radii).reshape(-1) ** 2
    return np.broadcast_to(np.asarray(given, float).reshape(-1), (probes.n,))


def _check_single_memory(sensor: Sensor) -> None:
    """Check that neither imperfections nor transducers remember the load of a skin that relaxes by itself."""
    owners = [(sensor.model.imperfections, each) for each in MEMORIES]
    owners += [(each, option) for each in sensor.transducers for option in each.memories]
    doubled = [f"{type(owner).__name__}.{option}" for owner, option in owners if getattr(owner, option)]
    if doubled:
        raise SceneError(
            f"sensor {sensor.name!r}: leave {', '.join(doubled)} at 0: its skin relaxes by itself, and a skin has one "
            "memory of its load. Wear (softening, baseline) may be given"
        )


def _unchanged(array: wp.array, _branch: str) -> tuple[wp.array, list[Stage]]:
    return array, []


class SensorCompiler:
    """The compiler of the sensors of one scene, which share its shapes, its points and its relative poses."""

    def __init__(self, bodies: Sequence[Body], poses: RelativePoses, context: Context):
        self._bodies, self._poses, self._context = bodies, poses, context
        constants = context.constants
        self._shapes: ShapeTables = constants.setdefault(ShapeTables, ShapeTables(bodies, context))
        self.clouds: dict[tuple[int, int], PointCloud] = constants.setdefault(PointCloud, {})
        """Points sampled on bodies, by body and number."""
        self.stages: list[Stage] = []
        """The stages of all sensors compiled so far, in order."""
        self.arrays: list[wp.array] = []
        """The arrays that hold readings; a reset sets them to 0."""

    def compile(self, sensor: Sensor, simulation: Built) -> Callable[[], None]:
        """Plan the stages of one sensor in their order: the inputs of its formula, the formula, the imperfections of
        its result. Return the function that connects its handle to the ``simulation``."""
        model = sensor.model
        self._check(sensor)
        options = ChainOptions.join(model.imperfections, model.electronics, model.adjustable)
        imperfections = Imperfections(options, _reading_info(sensor), self._context)
        gain, gain_stages = imperfections.compile_gain()
        radius, radius_stages = imperfections.compile_radius_noise()
        site = self._site(sensor, gain if model.gain_inside else None, radius)
        compiled = model.compile(site)
        if sensor._load is not None:
            compiled.stages.append(sensor._load.stage(site, compiled.truth, compiled.raw))
        finish = compiled.finish or (lambda array, _branch: (array, []))
        transduce: Transduce | None = None
        if sensor._chain is None:
            truth, truth_stages = finish(compiled.truth, "truth")
        else:  # transducers replace the model's own finish and presentation
            truth, truth_stages, info = self._transduce(sensor, compiled.truth)
            transduce = partial(self._transduced, sensor, compiled.truth, (truth, [], info))
        values, value_stages = imperfections.compile_values(compiled.raw, transduce)
        untouched = values is (compiled.truth if sensor._chain is None else truth)
        last = finish if sensor._chain is None else _unchanged
        values, finish_stages = (truth, []) if untouched else last(values, "measured")
        measured, delivery_stages = imperfections.compile_delivery(values)
        remembered, history_stages = (measured, []) if truth is measured else imperfections.compile_history(truth)
        self.arrays += [compiled.truth, compiled.raw, truth, remembered, values, measured]
        self.stages += gain_stages + radius_stages + compiled.stages + truth_stages
        self.stages += value_stages + finish_stages + delivery_stages + history_stages
        outputs = Outputs(
            truth=remembered,
            measured=measured,
            present=compiled.present if sensor._chain is None else None,
            derived=compiled.derived if sensor._chain is None else {},
            bad_poses=self._poses.status(sensor.link.index),
            contacts=partial(self._contacts, site, compiled),
            sensed=site.target_bodies,
        )
        return partial(sensor._attach, simulation, imperfections, outputs)

    def _contacts(self, site: Site, compiled: Compiled) -> tuple[wp.array, Stage]:
        """Return the contact flags of the bodies, and the stage that fills them."""
        return contact_flags(site, len(self._bodies), compiled.touch_points or (lambda: [probe_points(site)]))

    def _check(self, sensor: Sensor) -> None:
        n_taxels = self._context.n_envs * sensor._probes.n
        if n_taxels >= MAX_LAUNCH_THREADS:
            raise SceneError(
                f"sensor {sensor.name!r}: {self._context.n_envs} environments of {sensor._probes.n} taxels are "
                f"{n_taxels}, "
                f"more than the {MAX_LAUNCH_THREADS - 1} of one launch; build fewer environments at a time"
            )
        check_drawing(f"sensor {sensor.name!r}", sensor.model.draw)
        sensor.model.validate(sensor._probes)
        if sensor.model.relaxes:
            _check_single_memory(sensor)

    def _site(self, sensor: Sensor, gain, radius) -> Site:
        sensed = sensed_bodies(sensor, self._bodies)
        return Site(
            name=sensor.name,
            model=sensor.model,
            context=self._context,
            link=sensor.link,
            probes=sensor._probes,
            n_channels=sensor.model.n_channels,
            view=self._poses.view(sensor.link.index),
            target_bodies=sensed,
            targets=wp.array([body.index for body in sensed], dtype=wp.int32, device=self._context.device),
            shapes=self._shapes,
            clouds=self.clouds,
            **upload_probes(sensor._probes, self._context),
            on_skin=sensor.on_skin,
            gain=gain,
            radius=radius,
        )

    def _transduced(
        self, sensor: Sensor, raw: wp.array, done: tuple[wp.array, list[Stage], ReadingInfo], array: wp.array
    ) -> tuple[wp.array, list[Stage], ReadingInfo]:
        """Plan the transducers of the measured branch; where nothing has changed their input, reuse those of the truth,
        ``done``."""
        return done if array is raw else self._transduce(sensor, array)

    def _transduce(self, sensor: Sensor, array: wp.array) -> tuple[wp.array, list[Stage], ReadingInfo]:
        """Plan a sensor's transducers for one branch."""
        assert sensor._chain is not None
        probes, view = sensor._probes, self._poses.view(sensor.link.index)
        site = TransducerSite(
            name=sensor.name,
            context=self._context,
            positions=probes.positions,
            normals=probes.normals,
            layout=probes.layout,
            areas=_areas(sensor),
            link=sensor.link.index,
            world=self._poses.world,
            pose=view.pose,
            bodies={body.name: body.index for body in self._bodies},
        )
        out, stages = sensor._chain.compile(site, array)
        return out, stages, _reading_info(sensor, sensor._chain.output)
