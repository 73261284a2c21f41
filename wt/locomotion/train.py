"""The training loop: rsl_rl's runner one iteration at a time, with checkpoints and a clock.

The folder of a training holds ``config.yaml``, ``training.csv`` (a row per iteration) and
``checkpoint.pt`` (nets, optimizer, iteration), which is replaced when the next one is whole. A
later command continues from it. PPO, its storage and its nets are rsl_rl's.
"""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from rsl_rl.runners import OnPolicyRunner

from wt.errors import ConfigError, WorkError
from wt.locomotion.config import PolicyConfig, Ppo
from wt.locomotion.env import Walking
from wt.locomotion.parts import Make, Parts, environment
from wt.schema import to_yaml
from wt.show.files import write_whole

CONFIG = "config.yaml"
CHECKPOINT = "checkpoint.pt"
LOG = "training.csv"

Progress = Callable[[int, int, Mapping[str, float]], None]
"""Called with iterations done, iterations in all, and the last one's figures."""
Begin = Callable[[OnPolicyRunner], None]
"""Called with a runner of new nets, before it trains."""


@dataclass(frozen=True)
class Trained:
    """Result of a training.

    Attributes:
        actor: rsl_rl's net with its normaliser inside, on the processor, in evaluation mode.
        iterations: done in all.
        seconds: spent in all [s].
        samples: control steps of one robot in all.
    """

    actor: torch.nn.Module
    iterations: int
    seconds: float
    samples: int


def train(
    config: PolicyConfig,
    folder: Path,
    *,
    resume: bool = False,
    start_from: Path | Begin | None = None,
    seconds: float | None = None,
    progress: Progress | None = None,
    make: Make = Walking,
) -> Trained:
    """Train until the configured iteration, or until time is up, and keep a checkpoint.

    Args:
        config: what is trained.
        folder: of the training; it is made.
        resume: continue from the folder's checkpoint.
        start_from: a checkpoint of another training, whose nets are taken over, or what fills them.
        seconds: wall clock after which no further iteration begins [s].
        progress: called after every iteration.
        make: the environment.

    Raises:
        ConfigError: there is no checkpoint to continue from, one that would be overwritten, or
            one of nets of other sizes; CUDA is asked for and absent.
        WorkError: the nets' numbers are no longer finite.
    """
    begun = time.monotonic()
    saved = _open(folder, resume)
    runner = _start(config, saved, folder / CHECKPOINT, start_from, make)
    write_whole(folder / CONFIG, to_yaml(config))
    log = _IterationLog(folder / LOG, continued=saved is not None)
    iteration, earlier = (saved["iteration"], saved["seconds"]) if saved else (0, 0.0)

    def spent() -> float:
        return earlier + time.monotonic() - begun

    pace = 0.0  # s an iteration takes: the next one is to end in time
    try:
        while iteration < config.ppo.iterations:
            now = spent()
            if seconds is not None and now - earlier + pace > seconds:
                break
            runner.current_learning_iteration = iteration
            runner.learn(1)
            iteration += 1
            pace = spent() - now
            row = figures(runner, pace)
            _check_finite(runner, iteration, folder / CHECKPOINT)
            log.add({"iteration": float(iteration), "seconds": spent(), **row})
            if progress:
                progress(iteration, config.ppo.iterations, row)
            if iteration % config.save_every == 0:
                _save(runner, folder / CHECKPOINT, iteration, spent())
    except KeyboardInterrupt:  # the iteration that it cut short is not counted
        _save(runner, folder / CHECKPOINT, iteration, spent())
        raise
    _save(runner, folder / CHECKPOINT, iteration, spent())
    samples = iteration * config.ppo.steps * config.robots
    return Trained(runner.get_inference_policy("cpu"), iteration, spent(), samples)


def choose_device(config: PolicyConfig) -> str:
    """``"cpu"``, or torch's current CUDA device, as ``"cuda:0"``; ``auto`` takes CUDA where it is.

    Raises:
        ConfigError: ``cuda`` is asked for and absent.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device cuda: torch sees no CUDA device; use device=cpu or device=auto")
    if config.device == "cpu" or not torch.cuda.is_available():
        return "cpu"
    return f"cuda:{torch.cuda.current_device()}"


def runner_config(ppo: Ppo) -> dict[str, Any]:
    """The dictionary that rsl_rl reads."""
    net = {
        "class_name": "MLPModel", "hidden_dims": list(ppo.hidden), "activation": "elu",
        "obs_normalization": True,
    }  # fmt: skip
    noise = {"class_name": "GaussianDistribution", "init_std": ppo.init_std, "std_type": "log"}
    symmetry = {
        "data_augmentation_func": "wt.locomotion.mirror:augment", "use_data_augmentation": True,
    }  # fmt: skip
    return {
        "num_steps_per_env": ppo.steps,
        "save_interval": ppo.iterations + 1,  # this module keeps the checkpoints
        "check_for_nan": False,  # and looks at the nets, once an iteration
        "obs_groups": {"actor": ["policy"], "critic": ["policy", "privileged"]},
        "actor": {**net, "distribution_cfg": noise},
        "critic": dict(net),
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": ppo.epochs,
            "num_mini_batches": ppo.mini_batches,
            "clip_param": ppo.clip,
            "gamma": ppo.gamma,
            "lam": ppo.lam,
            "entropy_coef": ppo.entropy,
            "learning_rate": ppo.learning_rate,
            "schedule": "adaptive",
            "desired_kl": ppo.desired_kl,
            "symmetry_cfg": symmetry if ppo.symmetry else None,
        },
    }


def make_runner(env: Walking | Parts, ppo: Ppo, device: str) -> OnPolicyRunner:
    """rsl_rl's runner, without its printing and log files."""
    with contextlib.redirect_stdout(io.StringIO()):
        return OnPolicyRunner(env, runner_config(ppo), log_dir=None, device=device)


def figures(runner: OnPolicyRunner, seconds: float) -> dict[str, float]:
    """Figures of the last iteration, which took ``seconds`` [s]."""
    env: Any = runner.env
    steps = env.num_envs * runner.cfg["num_steps_per_env"]
    return {
        **env.report(),
        "std": float(runner.alg.get_policy().output_std.detach().mean()),
        "learning_rate": runner.alg.learning_rate,
        "steps_per_second": steps / seconds,
    }


def line(done: int, total: int, row: Mapping[str, float]) -> str:
    """One line about an iteration."""
    errors = " ".join(f"{row[f'error_{axis}']:.2f}" for axis in ("forward", "sideways", "turn"))
    return (
        f"{done}/{total} reward {row['reward']:.2f}/s episode {row['episode']:.1f} s "
        f"falls {row['falls']:.2f}/min error {errors} std {row['std']:.2f} "
        f"lr {row['learning_rate']:.1e} {row['steps_per_second'] / 1000:.1f}k steps/s"
    )


def _open(folder: Path, resume: bool) -> dict[str, Any] | None:
    """The folder's checkpoint if it is to be continued; the folder is made."""
    path = folder / CHECKPOINT
    if resume:
        return _read(path)
    if path.exists():
        raise ConfigError(f"{folder} holds a training: continue it with --resume, or change --out")
    folder.mkdir(parents=True, exist_ok=True)
    return None


def _start(
    config: PolicyConfig,
    saved: dict[str, Any] | None,
    checkpoint: Path,
    start_from: Path | Begin | None,
    make: Make,
) -> OnPolicyRunner:
    """A runner with new nets, with those of the checkpoint, or with those of another training."""
    device = choose_device(config)
    torch.manual_seed(config.seed)
    runner = make_runner(environment(config, device, make), config.ppo, device)
    if saved is not None:
        _restore(runner, saved, checkpoint)
    elif isinstance(start_from, Path):
        _restore(runner, _read(start_from), start_from, nets_only=True)
    elif start_from is not None:
        start_from(runner)
    return runner


def _check_finite(runner: OnPolicyRunner, iteration: int, checkpoint: Path) -> None:
    if not all(torch.isfinite(p).all() for p in runner.alg.actor.parameters()):
        raise WorkError(
            f"training diverged at iteration {iteration}: the nets' numbers are no longer finite; "
            f"continue from {checkpoint} with --resume and a smaller ppo.learning_rate"
        )


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise ConfigError(f"{path} does not exist: there is nothing to continue from")
    saved: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    return saved


def _restore(
    runner: OnPolicyRunner, saved: dict[str, Any], path: Path, nets_only: bool = False
) -> None:
    parts = {"actor": True, "critic": True, "optimizer": not nets_only}
    try:
        runner.alg.load(saved["rsl_rl"], parts, strict=True)
    except (RuntimeError, ValueError, KeyError) as error:
        raise ConfigError(
            f"{path} is of another robot or of nets of other sizes than this configuration "
            f"({str(error).splitlines()[0]}); use the configuration it was made with"
        ) from error


def _save(runner: OnPolicyRunner, path: Path, iteration: int, seconds: float) -> None:
    saved = {"rsl_rl": runner.alg.save(), "iteration": iteration, "seconds": seconds}
    content = io.BytesIO()
    torch.save(saved, content)
    write_whole(path, content.getvalue())


class _IterationLog:
    """A CSV file with a row per iteration."""

    def __init__(self, path: Path, continued: bool) -> None:
        self._path = path
        self._headed = continued and path.exists()
        if not self._headed:
            path.unlink(missing_ok=True)

    def add(self, row: Mapping[str, float]) -> None:
        with self._path.open("a") as file:
            if not self._headed:
                print(*row, sep=",", file=file)
                self._headed = True
            print(*(f"{value:.6g}" for value in row.values()), sep=",", file=file)
