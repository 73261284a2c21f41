"""Environment steps per second while fine-tuning: raw, translated, and with corrected actions.

All are of the task's own S, with its physics step. The model is an untrained one of the size that
``wt fit`` exports, since what it says does not change how long it takes. The policy is the base
policy, as at the beginning of a training.

Usage: python benchmarks/finetune.py [ROBOTS] [THREADS]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from registry.card import HeldOut, describe
from wt.config import load as load_task
from wt.export.onnx import export
from wt.finetune.config import load
from wt.finetune.setting import Setting
from wt.finetune.translated import TranslatedWalking
from wt.locomotion.env import Walking
from wt.nets.world_model import WorldModel
from wt.registered import Registered
from wt.translate import Exported

Array = np.ndarray

CONF = Path("conf") / "finetune_go2.yaml"
GOAL = 0.5  # of raw steps per second, on 2 cores
SECONDS = 5.0


class Raw(TranslatedWalking):
    """The same robots, untranslated."""

    _move = Walking._move


def main(robots: str = "256", threads: str = "0") -> None:
    """Print the table."""
    words = [f"training.robots={robots}", f"training.threads={threads}"]
    setting = Setting.of(load(CONF, words))
    training = setting.training("translation", 0)
    scale = np.ones(setting.world().spec.n_state)
    with tempfile.TemporaryDirectory() as name:
        model = _model(setting, Path(name) / "model.onnx", int(threads))

    def translate(o: Array, a: Array, sim_next: Array, hidden: Array) -> tuple[Array, Array]:
        _, shift = model.step_of(o, a, sim_next, hidden)
        return sim_next, 0.0 * shift  # what an untrained model says would not be written

    described = setting.simulator("translation")
    described.compile()
    mjcf = described.to_xml()
    raw = _pace(Raw(training, "cpu", translate, mjcf=mjcf), setting)
    step = 1e3 * setting.options.timestep
    print(f"{robots} robots, {threads} threads (0: one per core), physics step {step:g} ms")
    print(f"{'raw':<20}{raw:>10.0f} steps/s")
    for alignment in ("state", "stance", "action"):
        env = TranslatedWalking(training, "cpu", translate, alignment, scale, mjcf)
        pace = _pace(env, setting)
        goal = f"   goal {GOAL}" if alignment == "state" else ""
        print(
            f"{'translated, ' + alignment:<20}{pace:>10.0f} steps/s {pace / raw:>7.2f} of raw{goal}"
        )


def _model(setting: Setting, path: Path, threads: int) -> Registered:
    spec = setting.world().spec
    model = Exported(WorldModel(spec, load_task(setting.config.task).plus)).eval()
    o, a, h = (np.zeros((2, n), np.float32) for n in (spec.n_obs, spec.n_action, len(spec.hidden)))
    export(model, spec, path, example=(o, a, o), hidden=h[0])
    card = describe(
        path, spec, name="untrained", data_hash="", config_hash="", commit="", metrics={},
        heldout=HeldOut("", "", "mse", 0.0), parity=None, golden=(o, a, o, o),
        carried=(h, h),
    )  # fmt: skip
    return Registered(path, card, spec, threads)


def _pace(env: Walking, setting: Setting) -> float:
    """Steps of one robot per second."""

    def act() -> torch.Tensor:
        rows = env.get_observations()["policy"].numpy()
        n = rows.shape[1] - 3
        return torch.from_numpy(setting.base.act(rows[:, :n], rows[:, n:], rows[:, n + 3 :]))

    for _ in range(10):
        env.step(act())
    steps, begun = 0, time.perf_counter()
    while time.perf_counter() - begun < SECONDS:
        env.step(act())
        steps += 1
    return steps * env.num_envs / (time.perf_counter() - begun)


if __name__ == "__main__":
    main(*sys.argv[1:])
