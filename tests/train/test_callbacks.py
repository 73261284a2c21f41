from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import lightning
import pytest
import torch

from tests.train.conftest import Setup, World
from wt.config import Method
from wt.errors import WorkError
from wt.train.callbacks import CollapseLimits, CollapseWatch, ShowProgress
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.logger import SinkLogger
from wt.train.module import WorldTranslation

HEALTHY = {"latent/active_std": 0.8, "gan/accuracy": 0.6, "gan/generator": 1.4, "vae/kl": 3.0}


class At(lightning.Trainer):
    """A trainer at a step of the test's choice."""

    step = 0

    @property
    def global_step(self) -> int:
        return self.step


@dataclass
class Watched:
    """A module whose metrics the test makes up, under a watch."""

    module: WorldTranslation
    watch: CollapseWatch
    warned: list[str] = field(default_factory=list)
    sunk: list[tuple[dict[str, float], int]] = field(default_factory=list)
    step: int = 0

    def sink(self, values: Mapping[str, float], step: int) -> None:
        self.sunk.append((dict(values), step))

    def see(self, times: int = 1, **changed: float) -> None:
        """Show the watch these metrics at the next looks."""
        trainer = At(accelerator="cpu", logger=SinkLogger(self.sink), enable_checkpointing=False)
        for _ in range(times):
            self.step += 5
            trainer.step = self.step
            values = HEALTHY | {k.replace("_", "/", 1): v for k, v in changed.items()}
            self.module.metrics = {k: torch.tensor(v) for k, v in values.items()}
            self.watch.on_train_batch_end(trainer, self.module, None, None, 0)


@pytest.fixture
def watched(set_up: Callable[[Method], Setup], paper: Method) -> Watched:
    warned: list[str] = []
    watch = CollapseWatch(warned.append, 5, CollapseLimits(patience=3))
    return Watched(set_up(paper).module, watch, warned)


def test_a_healthy_run_is_left_alone(watched: Watched) -> None:
    watched.see(times=50)
    # strong discriminators alone are no collapse while the generators still get through
    watched.see(times=10, gan_accuracy=0.99)
    assert watched.warned == [] and watched.sunk == []


@pytest.mark.parametrize(
    ("metrics", "words"),
    [
        ({"latent_active_std": 0.001}, ["silent", "vae.beta"]),
        ({"gan_accuracy": 0.995, "gan_generator": 6.0}, ["discriminators won", "learning_rate"]),
    ],
)
def test_a_collapse_is_said_once_after_patience(
    watched: Watched, metrics: dict[str, float], words: list[str]
) -> None:
    watched.see(times=2, **metrics)
    watched.see()  # recovered: counting starts again
    watched.see(times=2, **metrics)
    assert watched.warned == []
    watched.see(times=10, **metrics)
    (message,) = watched.warned
    assert all(word in message for word in words) and "\n" not in message
    assert "step 30" in message
    assert watched.sunk == [({"collapsed": 1.0}, 30)]


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_divergence_ends_the_run_with_one_line(watched: Watched, value: float) -> None:
    with pytest.raises(WorkError, match=r"step 5: vae/kl is (nan|inf); lower .*learning_rate") as e:
        watched.see(vae_kl=value)
    assert "\n" not in str(e.value)


def test_only_every_so_many_steps_are_looked_at(watched: Watched) -> None:
    watched.step = 2
    watched.see(times=3, vae_kl=float("nan"))  # steps 7, 12, 17: no looks
    assert watched.warned == []


def test_callbacks_refuse_another_module() -> None:
    trainer = lightning.Trainer(accelerator="cpu", logger=False, enable_checkpointing=False)
    with pytest.raises(TypeError, match="LightningModule"):
        ShowProgress(print, 1).on_train_batch_end(
            trainer, lightning.LightningModule(), None, None, 0
        )


def test_curves_are_drawn_where_they_are_asked_for(
    world: World, paper: Method, folder: Path
) -> None:
    shown = replace(paper, train=replace(paper.train, rerun=True))
    for method, where in ((paper, "plain"), (shown, "drawn")):
        data = (world.spec, method, world.sim, world.real, world.selection, 0)
        fit_world_model(TrainingInput(*data, folder / where))
    assert not list((folder / "plain").glob("*.rrd"))
    (drawn,) = (folder / "drawn").glob("*.rrd")
    assert drawn.name == "training_0.rrd"
    done = subprocess.run(
        [Path(sys.executable).with_name("rerun"), "rrd", "print", "-v", drawn],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "/vae/kl" in done.stdout and "/val/mse" in done.stdout
