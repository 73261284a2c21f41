"""Figure 3, an experiment: how far S is from R decides on which side of RawSim a method stands."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from wt.config import FitConfig, parse
from wt.evaluate import paper
from wt.evaluate.single_step import Errors, errors
from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.tasks import WALKING
from wt.reproduce.words import UNITS, keep_errors, mean
from wt.run.study import Study
from wt.show.text import short
from wt.worlds.legged_model import LeggedPhysics
from wt.worlds.robots import robot_of
from wt.worlds.walking.options import WalkingOptions
from wt.worlds.walking.world import WalkingWorld

WAYS = (0.0, 0.5, 0.75, 0.9)
"""Shares of the way from S to R; nothing but RawSim depends on them."""
BLIND = ("DirectPred", "RSSM")
"""Baselines that never see S: their errors are those of figure 3, wherever S is."""


@register
class Nearer(Exhibit):
    """RawSim's error with simulators nearer to R, beside the methods that use none."""

    name = "nearer"
    order = 17
    title = "Figure 3, an experiment: simulators nearer to reality"
    tasks = WALKING
    any_task = True

    def measure(self, bench: Bench) -> Numbers:
        """Step such simulators from each test pair; the others are those of the runs."""
        numbers: Numbers = {}
        for task in (task.name for task in bench.tasks if task.name in self.tasks):
            study = bench.study(task)
            bench.train(study, [], BLIND)
            test, scales = study.data.test, study.scales
            numbers[task] = {
                **{_row(way): _raw(study, way) for way in WAYS},
                **{
                    name: _kept(
                        errors(study.prediction(seed, name), test, scales)
                        for seed in study.config.seeds
                    )
                    for name in BLIND
                },
            }
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """One row a simulator, and where RawSim changes sides."""
        grids = [
            Grid(
                [column, *numbers],
                [
                    [name, *(short(mean(of[name][unit])) for of in numbers.values())]
                    for name in _names()
                ],
            )
            for unit, column in UNITS.items()
        ]
        return Section(
            "Drives, friction and masses of S moved some of the way to those of R. What never sees "
            "S makes the same error wherever it is, so that its place beside RawSim says how "
            "far S is from R.",
            grids,
            {},
            [
                _side(task, {name: mean(found["mse"]) for name, found in of.items()})
                for task, of in numbers.items()
            ],
        )


def between(sim: LeggedPhysics, real: LeggedPhysics, way: float) -> LeggedPhysics:
    """Physics that share of the way from S to R."""
    values = {}
    for key in (item.name for item in fields(LeggedPhysics)):
        a, b = np.asarray(getattr(sim, key)), np.asarray(getattr(real, key))
        values[key] = (a + way * (b - a)).tolist()
    return parse(LeggedPhysics, values, "")


def world(config: FitConfig, way: float) -> WalkingWorld:
    """A task's world with a simulator that share of the way from S to R."""
    section = {key: value for key, value in config.world.items() if key != "name"}
    options = parse(WalkingOptions, section, "world.")
    physics = between(options.sim, options.real, way)
    spec = robot_of(options.robot).describe(physics, options.timestep, options.scene("sim"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        spec.compile()
        path.write_text(spec.to_xml(), encoding="utf-8")
        return WalkingWorld(replace(options, model=str(path)))


def _raw(study: Study, way: float) -> dict[str, list[float]]:
    real = study.data.test.real
    answer = world(study.config, way).sim_step(real.o, real.a, real.hidden)
    return _kept([errors(answer, study.data.test, study.scales)])


def _kept(seeds: Iterable[Errors]) -> dict[str, list[float]]:
    kept: dict[str, list[float]] = {}
    for found in seeds:
        keep_errors(kept, found)
    return kept


def _side(task: str, mse: Mapping[str, float]) -> str:
    """Sentences on where RawSim falls below DirectPred on the way, and where the paper has it."""
    known = paper.SINGLE_STEP[task]
    papers = "below" if known["RawSim"] < known["DirectPred"] else "above"
    below = [way for way in WAYS if mse[_row(way)] < mse["DirectPred"]]
    ours = f"below DirectPred from {below[0]:.0%} of the way" if below else "above DirectPred"
    return f"{task}: RawSim stands {ours}; in the paper {papers} it."


def _row(way: float) -> str:
    return f"RawSim, {way:.0%} of the way to R" if way else "RawSim"


def _names() -> list[str]:
    return [*map(_row, WAYS), *BLIND]
