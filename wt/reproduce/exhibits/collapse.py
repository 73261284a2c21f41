"""Translation of observations instead of features: does it collapse, and why (the loss curves)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from wt.config import Mean
from wt.evaluate.figures import curves
from wt.evaluate.probes import condition_accuracy
from wt.evaluate.single_step import errors
from wt.nets.frame import Frame
from wt.reproduce.bench import FULL, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import mean, spread
from wt.run.study import Study
from wt.train.batches import DomainData, in_frame
from wt.train.device import device_of, on
from wt.train.mean_field import fit_normalizers
from wt.train.translation_only import Curves, OutcomeTranslator, train_translation

NOISY = ("world.policy.noise=0.3", "world.policy.integral_gain=0")
"""A collecting policy whose actions give less of the domain away, as an experiment on the cause:
no correction of how far the joints sag under their own weight, and noise that hides it."""
CASES = {"o′, the configured policy": (), "o′, a noisier policy": NOISY}
FEATURES_CASE = "z, as in the paper"
TAIL = 0.1  # of training, over which the end is averaged


@register
class Collapse(Exhibit):
    """Losses of the same translation on observations and on features."""

    name = "collapse"
    order = 80
    title = "Translation of observations instead of features"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Train on features and on observations, and on those of a policy that leaks less."""
        numbers: Numbers = {}
        for name, extra in CASES.items():
            study = bench.study("r5_force", extra, "noisy" if extra else "")
            if not extra:
                bench.train(study, [FULL])
                numbers[FEATURES_CASE] = [
                    self._on_features(bench, study, seed) for seed in study.config.seeds
                ]
            numbers[name] = [
                self._on_observations(study, seed)
                | {"leak": condition_accuracy(_frame(study), *bench.looked_at(study), seed)}
                for seed in study.config.seeds
            ]
        return numbers

    def _on_features(self, bench: Bench, study: Study, seed: int) -> dict[str, Any]:
        sim, real = bench.features(study, FULL, seed)
        with on(device_of(study.config.device)):
            data_sim, data_real = (
                DomainData(*(torch.tensor(x) for x in (f.condition, f.z, f.outcome)))
                for f in (sim, real)
            )
            torch.manual_seed(seed)
            model = OutcomeTranslator(sim.z.shape[1], 0, study.config.paper)
            return _said(train_translation(model, data_sim, data_real, seed))

    def _on_observations(self, study: Study, seed: int) -> dict[str, Any]:
        spec, data = study.world.spec, study.data
        with on(device_of(study.config.device)):
            frame = _frame(study)
            torch.manual_seed(seed)
            model = OutcomeTranslator(spec.n_state, frame.n_condition, study.config.paper)
            seen = train_translation(model, *in_frame(frame, data.sim, data.real), seed)
        model, frame, real = model.cpu(), frame.cpu(), data.test.real
        with torch.no_grad():
            o = torch.tensor(real.o)
            x = frame.conditions(o, torch.tensor(real.a))
            change = model.to_real(frame.changes(o, torch.tensor(data.test.sim_next)), x)
            predicted = frame.next_states(o, change).numpy()
        raw = errors(data.test.sim_next, data.test, study.scales).mse
        mse = errors(predicted, data.test, study.scales).mse
        return _said(seen) | {"mse": mse, "raw": raw}

    def present(self, numbers: Numbers) -> Section:
        """Curves of the first seed, and where all seeds end."""
        lines = {name: runs[0] for name, runs in numbers.items()}
        panels = [
            (label, {n: (np.array(run["step"]), np.array(run[key])) for n, run in lines.items()})
            for key, label in (
                ("generator", "generators' adversarial loss"),
                ("discriminator", "discriminators' loss"),
                ("accuracy", "share the discriminators tell apart"),
            )
        ]
        head = ["translated", "(o, a) tells c", "generators", "discriminators", "told apart",
                "MSE / RawSim"]  # fmt: skip
        rows = []
        for name, runs in numbers.items():
            ends = [spread([_end(r[k]) for r in runs]) for k in _KEYS]
            leak = spread([r["leak"] for r in runs]) if "leak" in runs[0] else "–"
            mse = spread([r["mse"] / r["raw"] for r in runs]) if "mse" in runs[0] else "–"
            rows.append([name, leak, *ends, mse])
        return Section(
            "The same adversarial, cycle and identity losses with the same networks and budget, "
            "on outcomes with (o, a) beside them and on features. The end is the mean over the "
            "last tenth of training; at chance the discriminators' loss is 4 ln 2 = 2.77 and they "
            "tell half apart.",
            [Grid(head, rows)],
            {"collapse": curves(panels, "step")},
            _differences(numbers),
        )


_KEYS = ("generator", "discriminator", "accuracy")


def _said(seen: Curves) -> dict[str, Any]:
    return {key: list(getattr(seen, key)) for key in ("step", *_KEYS)}


def _frame(study: Study) -> Frame:
    """Normalisers without a mean field, as the paper's method has them."""
    frame = Frame(study.world.spec, Mean())
    fit_normalizers(frame, study.data.sim, study.data.real)
    return frame


def _end(values: list[float]) -> float:
    return mean(values[-max(1, int(TAIL * len(values))) :])


def _differences(numbers: Numbers) -> list[str]:
    lines = []
    for name, runs in numbers.items():
        accuracy = mean([_end(run["accuracy"]) for run in runs])
        verdict = "collapsed" if accuracy > 0.95 else "did not collapse"
        lines.append(f"{name}: {verdict}, {100 * accuracy:.0f} % told apart at the end.")
    return lines
