"""An experiment: cases, repetitions, and the pairs of scans that they make."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from novelty.simulation.experiments.setup import Setup
from novelty.simulation.pairs import sample_pair, simulate_pair
from novelty.simulation.poses import FloatArray, look_at, make_pose
from novelty.simulation.scenes import Scene, make_scene
from novelty.simulation.simulated import SimulatedPair


@dataclass(frozen=True)
class Case:
    """One condition of an experiment.

    Attributes:
        name: Of the case, such as "person".
        varied: The keys of `Setup` that the experiment varies over this case, with their values here.
        setup: What is simulated.
    """

    name: str
    varied: Mapping[str, Any]
    setup: Setup

    @property
    def label(self) -> str:
        """The condition as part of a file name: `box-object_size_0.3`."""
        text = "-".join([self.name, *(f"{key} {value}" for key, value in self.varied.items())])
        return re.sub(r"[^\w.-]+", "_", text).strip("_")


@dataclass(frozen=True)
class Analysis:
    """One way to compare the scans of an experiment.

    Attributes:
        name: Such as "area of interest".
        settings: Keys of `novelty.Config` that differ from the defaults: `Config().replace(**settings)`.
    """

    name: str
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class ExperimentPair:
    """One labelled pair of an experiment, simulated when it is asked for.

    Attributes:
        name: Unique in the experiment, good for a file name.
        case: The condition.
        repetition: Counted from 0.
        seed: Of every random choice. The cases of one repetition share it, so that they differ in the condition only.
    """

    name: str
    case: Case
    repetition: int
    seed: int

    def simulate(self) -> SimulatedPair:
        """Both scans with their ground truth; the same bytes every time.

        Raises:
            InputError: The scene has no room for the change.
        """
        setup = self.case.setup
        scene = make_scene(setup.scene, self.seed if setup.layout is None else setup.layout)
        scene = replace(scene, viewpoint=_seen_from(scene.viewpoint, setup.stand))
        if setup.stretch is not None:
            scene = scene.with_stretch(*setup.stretch)
        if setup.spot is not None:
            scene = scene.with_focus(*setup.spot)
        return self._scanned(scene) if setup.samples is None else self._sampled(scene, setup.samples)

    def _sampled(self, scene: Scene, density: float) -> SimulatedPair:
        setup = self.case.setup
        return sample_pair(
            scene,
            self.seed,
            setup.changes,
            name=self.name,
            density=density,
            noise=0.01 if setup.noise is None else setup.noise,
            object_size=setup.object_size,
            reverse=setup.reverse,
        )

    def _scanned(self, scene: Scene) -> SimulatedPair:
        setup = self.case.setup
        origins = scene.viewpoint, _seen_from(scene.viewpoint, setup.viewpoint)
        if setup.aim is not None:
            target = (*scene.aim[:2], setup.aim)
            origins = look_at(origins[0][:3, 3], target), look_at(origins[1][:3, 3], target)
        return simulate_pair(
            scene,
            self.seed,
            setup.changes,
            name=self.name,
            sensor=setup.sensor,
            density=setup.density,
            noise=setup.noise,
            object_size=setup.object_size,
            origins=origins,
            reverse=setup.reverse,
            drift=setup.drift,
            mounting=setup.mounting,
            pose_error=setup.pose_error,
        )


@dataclass(frozen=True)
class Experiment:
    """A whole experiment, as its file in `configs/experiments` describes it.

    Attributes:
        name: Of the file.
        title: One line.
        source: Section, table and figures that it repeats.
        repetitions: Pairs per case.
        seed: Of the first repetition; the next take the next.
        cases: The conditions.
        detectors: What is compared, names as in `novelty.Config.detector`.
        analyses: How, one after the other.
    """

    name: str
    title: str
    source: str
    repetitions: int
    seed: int
    cases: tuple[Case, ...]
    detectors: tuple[str, ...]
    analyses: tuple[Analysis, ...]

    def pairs(self) -> tuple[ExperimentPair, ...]:
        """All pairs, case by case; nothing is simulated yet."""
        return tuple(
            ExperimentPair(f"{case.label}-{self.seed + repetition}", case, repetition, self.seed + repetition)
            for case in self.cases
            for repetition in range(self.repetitions)
        )


def _seen_from(pose: FloatArray, offset: tuple[float, float, float]) -> FloatArray:
    """The pose some metres ahead and to the left of another, turned by some degrees to the left."""
    ahead, left, turn = offset
    return pose @ make_pose((ahead, left, 0.0), turn)
