"""Probes of a representation: the hidden variable and the domain, read off it (tables I and II).

A probe is a small network of scikit-learn. It learns on one half of the episodes and is tested on
the other: transitions of one episode resemble each other too much to stand on both sides.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics import r2_score
from sklearn.neural_network import MLPClassifier, MLPRegressor
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from wt.evaluate.representation import Features
from wt.nets.frame import Frame
from wt.types import Transitions

LAYERS = (64, 64)
EPOCHS = 40
BATCH = 256


@dataclass(frozen=True)
class Split:
    """Rows that a probe learns from, and rows that test it.

    Attributes:
        train: rows to learn from.
        test: the others.
    """

    train: Bool[np.ndarray, " row"]
    test: Bool[np.ndarray, " row"]

    @classmethod
    def of(cls, episode: Int[np.ndarray, " row"]) -> Split:
        """Every other episode is for the test; a single one is cut in the middle."""
        _, order = np.unique(episode, return_inverse=True)
        test = order % 2 == 1
        if not test.any():
            test = np.arange(len(episode)) >= len(episode) // 2
        return cls(~test, test)


def hidden_r2(
    representation: Float[np.ndarray, "row channel"],
    hidden: Float[np.ndarray, "row hidden"],
    split: Split,
    seed: int,
) -> float:
    """R² of the magnitude of the hidden variable, as a probe predicts it.

    Args:
        representation: input of the probe.
        hidden: the hidden variable, e.g. a force [N].
        split: of the rows.
        seed: of the probe.
    """
    size = np.linalg.norm(hidden.astype(np.float64), axis=1)
    size /= size.std() + 1e-12
    probe = _probe(MLPRegressor, seed)
    _fit(probe, representation[split.train], size[split.train])
    return float(r2_score(size[split.test], probe.predict(representation[split.test])))


def hidden_table(sim: Features, real: Features, seed: int) -> dict[str, float]:
    """R² of the hidden variable from (o, a, z) of each kind (table I, "Combined")."""
    scores = {}
    for own, other, data in (("S", "R", sim), ("R", "S", real)):
        split = Split.of(data.episode)
        for name, z in _views(own, other, data).items():
            inputs = np.hstack([data.condition, z])
            scores[f"(o, a){own}, {name}"] = hidden_r2(inputs, data.hidden, split, seed)
    return scores


def hidden_baseline(sim: Features, real: Features, seed: int) -> dict[str, float]:
    """R² of the hidden variable from (o, a) and from (o, a, o′) (table I, "Baseline")."""
    scores = {}
    for own, data in (("S", sim), ("R", real)):
        split = Split.of(data.episode)
        transition = np.hstack([data.condition, data.outcome])
        scores[f"(o, a){own}"] = hidden_r2(data.condition, data.hidden, split, seed)
        scores[f"(o, a, o′){own}"] = hidden_r2(transition, data.hidden, split, seed)
    return scores


def domain_table(sim: Features, real: Features, seed: int) -> dict[str, float]:
    """Share of features that a probe takes for the domain they are meant to be of (table II).

    The probe learns S against R on features that are not translated. Translated ones are then
    shown to it beside the (o, a) of the domain that they come from.

    Returns:
        Accuracy by input, as in the paper: first (o, a) alone, then z, then both together.
    """
    splits = {"S": Split.of(sim.episode), "R": Split.of(real.episode)}
    data = {"S": sim, "R": real}
    accuracies: dict[str, float] = {}

    def probe_domain(
        of: Mapping[str, Float[np.ndarray, "_ channel"]],
        shown: Mapping[str, tuple[str, str, Float[np.ndarray, "_ channel"]]],
    ) -> None:
        probe = _probe(MLPClassifier, seed)
        rows = np.concatenate([of[d][splits[d].train] for d in "SR"])
        labels = np.repeat([0, 1], [int(splits[d].train.sum()) for d in "SR"])
        _fit(probe, rows, labels)
        for name, (origin, target, inputs) in shown.items():
            said = probe.predict(inputs[splits[origin].test])
            accuracies[name] = float(np.mean(said == "SR".index(target)))

    pairs = {d: f.condition for d, f in data.items()}
    probe_domain(pairs, {f"(o, a){d}": (d, d, x) for d, x in pairs.items()})
    kinds = [
        (own, target, name, z)
        for own, other in (("S", "R"), ("R", "S"))
        for (name, z), target in zip(
            _views(own, other, data[own]).items(), (own, other, own), strict=True
        )
    ]
    # the paper lists both domains' own features first, then both translated, then both cycled
    kinds = [kinds[i] for i in (0, 3, 1, 4, 2, 5)]
    probe_domain({d: f.z for d, f in data.items()}, {n: (o, t, z) for o, t, n, z in kinds})
    probe_domain(
        {d: np.hstack([f.condition, f.z]) for d, f in data.items()},
        {f"(o, a){o}, {n}": (o, t, np.hstack([data[o].condition, z])) for o, t, n, z in kinds},
    )
    return accuracies


def condition_accuracy(frame: Frame, sim: Transitions, real: Transitions, seed: int) -> float:
    """Share of (o, a) whose domain a probe tells from them alone, mean over both domains.

    Args:
        frame: gives (o, a) as networks see them, actions as offsets from where the joints are.
        sim: transitions of S.
        real: transitions of R.
        seed: of the probe.
    """
    data = sim, real
    x = [frame.conditions(torch.tensor(d.o), torch.tensor(d.a)).numpy() for d in data]
    train = [Split.of(d.episode).train for d in data]
    probe = _probe(MLPClassifier, seed)
    labels = np.repeat([0, 1], [int(rows.sum()) for rows in train])
    _fit(probe, np.concatenate([a[rows] for a, rows in zip(x, train, strict=True)]), labels)
    right = [
        probe.predict(a[~rows]) == label
        for label, (a, rows) in enumerate(zip(x, train, strict=True))
    ]
    return float(np.mean([one.mean() for one in right]))


def _views(own: str, other: str, data: Features) -> dict[str, Float[np.ndarray, "row latent"]]:
    """A domain's features by the paper's names: own, translated, translated and back."""
    return {
        f"z{own}": data.z,
        f"z{own}→{other}": data.across,
        f"z{own}→{other}→{own}": data.back,
    }


def _probe(kind: type[MLPClassifier] | type[MLPRegressor], seed: int) -> Pipeline:
    net = kind(hidden_layer_sizes=LAYERS, batch_size=BATCH, max_iter=EPOCHS, random_state=seed)
    return make_pipeline(StandardScaler(), net)


def _fit(
    probe: Pipeline, inputs: Float[np.ndarray, "row channel"], targets: Shaped[np.ndarray, " row"]
) -> None:
    with warnings.catch_warnings():
        # so many epochs are the budget, the same for every representation
        warnings.simplefilter("ignore", ConvergenceWarning)
        warnings.filterwarnings("ignore", message="Got `batch_size` less than 1 or larger")
        probe.fit(inputs, targets)
