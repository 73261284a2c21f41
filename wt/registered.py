"""A registered model by itself, as ``wt evaluate`` runs and ``wt diagnose --translation`` reads it.

Only the ONNX graph and its card are read, so this is what anybody who pulls the model can expect
of it. Probes need features of both domains: they are the business of the models that ``wt
reproduce`` trains.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from matplotlib.figure import Figure

from registry import parity
from registry.card import MODEL_FILE, Card
from registry.pull import pull
from registry.store import Store
from wt.config import FitConfig
from wt.diagnose.observed.translation import TrainedTranslation
from wt.errors import ConfigError, ModelError
from wt.evaluate import figures
from wt.evaluate.multi_step import Now, Step, alignment_of, roll_out, simulator
from wt.evaluate.results import OURS, Results
from wt.evaluate.single_step import by_kind, errors
from wt.export.onnx import FEATURES, HIDDEN, HIDDEN_SHIFT, OUTPUT
from wt.run.publish import tabulate
from wt.run.study import Listener, Study
from wt.show.files import write_together
from wt.train.selection import Paired, Unpaired
from wt.types import Pairs, TransitionSpec
from wt.worlds.closed_loop import ClosedLoop

HORIZON, ROLLOUTS = 50, 256
"""Control steps and number of rollouts of a world whose policy can be run on predictions."""


class Registered:
    """An exported model that fits a task.

    Attributes:
        card: its description.
    """

    def __init__(self, graph: Path, card: Card, spec: TransitionSpec, threads: int = 0) -> None:
        """Load a graph and check that it is one of this task.

        Args:
            graph: ``model.onnx``.
            card: its card.
            spec: layout of the task's transitions.
            threads: of inference; 0 for one per core.

        Raises:
            ModelError: the model is of another task, rate or layout, or its file is no graph.
        """
        self.card, self._spec = card, spec
        expected: dict[str, tuple[object, object]] = {
            "task": (card.task, spec.task),
            "rate_hz": (card.rate_hz, spec.rate_hz),
            "joint order": (list(card.joints), list(spec.joints)),
            "o": (_names(card, "o"), [c.name for c in spec.observation]),
            "a": (_names(card, "a"), [c.name for c in spec.action]),
        }
        if card.carried is not None:
            carried = [c.name for c in card.carried.hidden.channels]
            expected["hidden"] = (carried, [c.name for c in spec.hidden])
        for what, (given, wanted) in expected.items():
            if given != wanted:
                given, wanted = _first_difference(given, wanted)
                raise ModelError(
                    f"the model {card.name} does not fit: its {what} is {given}, the "
                    f"configuration's {wanted}; name the configuration that it was trained with"
                )
        self._session = parity.session(graph, threads)

    def predict(
        self,
        o: Float[np.ndarray, "row obs"],
        a: Float[np.ndarray, "row action"],
        sim_next: Float[np.ndarray, "row state"],
    ) -> Float[np.ndarray, "row state"]:
        """R's state after the step for S's, physical units."""
        return self._asked([OUTPUT], o, a, sim_next)[0][:, : self._spec.n_state]

    @property
    def carries(self) -> bool:
        """Whether it says how R's hidden variables go on beyond S's."""
        return self.card.carried is not None

    def step_of(
        self,
        o: Float[np.ndarray, "row obs"],
        a: Float[np.ndarray, "row action"],
        sim_next: Float[np.ndarray, "row state"],
        hidden: Float[np.ndarray, "row hidden"],
    ) -> tuple[Float[np.ndarray, "row state"], Float32[np.ndarray, "row hidden"] | None]:
        """R's state after the step, and what is added to S's hidden variables then.

        Both are computed at once, in the time of either. The second is None where the model does
        not say how hidden variables go on.

        Args:
            o: observations, physical units, as all else.
            a: actions.
            sim_next: S's state channels after the step.
            hidden: S's hidden variables before it.
        """
        if not self.carries:
            return self.predict(o, a, sim_next), None
        given = {HIDDEN: hidden.astype(np.float32)}
        outcome, shift = self._asked([OUTPUT, HIDDEN_SHIFT], o, a, sim_next, given)
        return outcome[:, : self._spec.n_state], shift

    def _asked(
        self,
        outputs: Sequence[str],
        o: Float[np.ndarray, "row obs"],
        a: Float[np.ndarray, "row action"],
        sim_next: Float[np.ndarray, "row state"],
        further: Mapping[str, Float32[np.ndarray, "row _"]] | None = None,
    ) -> list[Float32[np.ndarray, "row _"]]:
        # channels behind the state are handed through: what stands there does not matter
        o_next = np.hstack([sim_next, o[:, self._spec.n_state :]]).astype(np.float32)
        inputs = {"o": o.astype(np.float32), "a": a.astype(np.float32), "o_next_sim": o_next}
        answers: list[np.ndarray] = self._session.run(outputs, inputs | dict(further or {}))
        return answers

    def on(self, pairs: Pairs) -> Float[np.ndarray, "pair state"]:
        """Predictions for pairs."""
        return self.predict(pairs.real.o, pairs.real.a, pairs.sim_next)

    def step(self) -> Step:
        """The model as a method of multi-step rollouts."""
        return _Step(self)


class _Step:
    """A registered model as a method of rollouts, which carries what is hidden on if it can."""

    def __init__(self, model: Registered) -> None:
        """Take the model."""
        self._model = model

    def __call__(self, now: Now) -> Float[np.ndarray, "robot state"]:
        """See :data:`wt.evaluate.multi_step.Step`."""
        return self._model.predict(now.o[:, -1], now.a[:, -1], now.sim_next)

    def hidden(
        self,
        now: Now,
        before: Float[np.ndarray, "robot hidden"],
        after: Float[np.ndarray, "robot hidden"],
    ) -> Float[np.ndarray, "robot hidden"]:
        """See :class:`wt.evaluate.multi_step.Carrying`."""
        _, shift = self._model.step_of(now.o[:, -1], now.a[:, -1], now.sim_next, before)
        return after if shift is None else after + shift


def champion(config: FitConfig) -> tuple[str, str]:
    """The registered model of a task: its reference, e.g. ``"wt-r5/3"``, and its graph's sha256.

    Raises:
        RegistryError: the task has none.
    """
    version = Store(config.tracking.uri).resolve(f"{config.registry_name}@champion")
    return str(version), version.sha256


def load(reference: str, spec: TransitionSpec, uri: str | None = None) -> Registered:
    """A registered model of a task, its bytes verified.

    Args:
        reference: ``"wt-r5@champion"`` or ``"wt-r5/3"``.
        spec: layout of the task's transitions.
        uri: the store; None for the default one.

    Raises:
        RegistryError: no such version, or its bytes are not those that were registered.
        ModelError: it is of another task.
    """
    with tempfile.TemporaryDirectory(prefix="wt-pull-") as name:
        _, card = pull(reference, Path(name) / "model", uri=uri)
        return Registered(Path(name) / "model" / MODEL_FILE, card, spec)


def translation(reference: str, uri: str | None = None) -> TrainedTranslation:
    """A registered model as a diagnosis reads it, with the features behind its answer.

    Args:
        reference: ``"wt-r5@champion"`` or ``"wt-r5/3"``.
        uri: the store; None for the default one.

    Raises:
        RegistryError: no such version, or its bytes are not those that were registered.
        ModelError: it was exported without features, by an earlier version.
    """
    with tempfile.TemporaryDirectory(prefix="wt-pull-") as name:
        version, card = pull(reference, Path(name) / "model", uri=uri)
        session = parity.session(Path(name) / "model" / MODEL_FILE)
    outputs = [OUTPUT, *FEATURES]
    if not {output.name for output in session.get_outputs()}.issuperset(outputs):
        raise ModelError(
            f"{version} was exported without its features; train it again: wt fit --config …"
        )

    def run(
        o: Float32[np.ndarray, "step obs"],
        a: Float32[np.ndarray, "step action"],
        o_next: Float32[np.ndarray, "step obs"],
    ) -> tuple[
        Float32[np.ndarray, "step obs"],
        Float32[np.ndarray, "step latent"],
        Float32[np.ndarray, "step latent"],
    ]:
        o_next_real, z, z_translated = session.run(outputs, {"o": o, "a": a, "o_next_sim": o_next})
        return o_next_real, z, z_translated

    channels = {port.name: port.channels for port in card.inputs}
    return TrainedTranslation(str(version), card.rate_hz, channels["o"], channels["a"], run)


def _names(card: Card, port: str) -> list[str]:
    return next(([c.name for c in p.channels] for p in card.inputs if p.name == port), [])


def _first_difference(given: object, wanted: object) -> tuple[str, str]:
    """Words for two values that differ; for lists, at the first difference."""
    if not isinstance(given, list) or not isinstance(wanted, list):
        return repr(given), repr(wanted)
    if len(given) != len(wanted):
        return f"of {len(given)} channels", f"of {len(wanted)}"
    k = next(k for k, pair in enumerate(zip(given, wanted, strict=True)) if pair[0] != pair[1])
    return f"{given[k]} at number {k}", f"{wanted[k]}"


def evaluate(reference: str, config: FitConfig, folder: Path, listener: Listener) -> Results:
    """Errors of a registered model and of the simulator, written into a folder.

    Args:
        reference: ``"wt-r5@champion"`` or ``"wt-r5/3"``.
        config: of the task that it was trained for.
        folder: gets ``results.json``, ``results.md`` and figures.
        listener: told of progress.

    Raises:
        RegistryError: no such version, or its bytes are not those that were registered.
        ModelError: it is of another task.
        ConfigError: the folder is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"--out: {folder} is a file; name a folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".pull-") as name:
        version, card = pull(reference, Path(name) / "model", uri=config.tracking.uri)
        study = Study.open(config, folder, listener)
        model = Registered(Path(name) / "model" / MODEL_FILE, card, study.world.spec)
        pairs, scales = study.data.test, study.scales
        by_method = {
            "RawSim": errors(pairs.sim_next, pairs, scales),
            OURS: errors(model.on(pairs), pairs, scales),
        }
        kind = Unpaired if card.heldout.metric == Unpaired.metric else Paired
        results = replace(tabulate(study, {0: by_method}, version), model_selection=kind.name)
        drawn = {
            "single_step": figures.bar_table(results),
            "per_channel": figures.per_channel(
                {m: np.asarray(e) for m, e in results.rmse.items()}, study.world.spec.state
            ),
        }
        if isinstance(study.world, ClosedLoop):
            drawn["multi_step"] = _rollouts(study, study.world, model)
    folder.mkdir(exist_ok=True)
    results.save(folder)
    write_together(folder, {f"{name}.png": _png(figure) for name, figure in drawn.items()})
    return results


def _rollouts(study: Study, world: ClosedLoop, model: Registered) -> Figure:
    truth = world.truth(ROLLOUTS, 0, HORIZON, study.config.data.seed)
    steps = {"RawSim": simulator, OURS: model.step()}
    scale, config = study.scales.state, study.config
    rolled = {
        m: roll_out(world, truth, step, scale, alignment_of(config, m)) for m, step in steps.items()
    }
    horizon = np.arange(1, HORIZON + 1)
    panels = [
        ("diverged rollouts [%]", {m: (horizon, 100 * r.diverged) for m, r in rolled.items()}),
        ("MSE of the normalised state", {m: (horizon, r.mse) for m, r in rolled.items()}),
    ]
    kinds = {m: by_kind(r.rmse, study.world.spec.state) for m, r in rolled.items()}
    panels += [
        (f"RMSE of {kind.name} [{kind.unit}]", {m: (horizon, k[kind]) for m, k in kinds.items()})
        for kind in kinds["RawSim"]
    ]
    return figures.curves(panels, "horizon [control steps]")


def _png(figure: Figure) -> bytes:
    png = BytesIO()
    figure.savefig(png, format="png", dpi=150)
    return png.getvalue()
