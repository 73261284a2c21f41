"""Results of a run for others: tables, figures, a recording, an exported and registered model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from io import BytesIO

import numpy as np

from registry import parity, store
from registry.card import HeldOut, describe
from registry.push import push
from registry.store import Version
from wt.baselines.base import find
from wt.config import FitConfig, Method
from wt.data.transitions import digest
from wt.errors import ConfigError, RegistryError
from wt.evaluate import figures
from wt.evaluate.results import (
    ASSUMPTION,
    OURS,
    PAPERS_OWN,
    Extraction,
    MethodScore,
    Results,
)
from wt.evaluate.rollout_view import write_rollout
from wt.evaluate.single_step import Errors, errors, first_episode, poses
from wt.export.onnx import eager, export
from wt.nets.simulator_use import use_of
from wt.nets.world_model import WorldModel
from wt.run.jobs import Job
from wt.run.study import Study
from wt.run.track import Run, source
from wt.show.files import write_whole
from wt.train.fit import translates
from wt.train.score import PairTensors, active_latents, predictions, reconstructions, score
from wt.translate import Exported, SimToReal

MODEL, RECORDING, FIGURES = "model.onnx", "rollout.rrd", "figures"
SHOWN = ("RawSim", PAPERS_OWN, OURS)
"""Methods whose predictions are drawn; more would hide one another."""

LONGEST = 500
"""Control steps in the recording, at most."""

EXAMPLES = 512
"""Rows on which the exported graph is compared with eager."""

GOLDEN = 8
"""Input and output rows that travel with the model."""

_UNTRAINED = "untrained: Algorithm 1 has no part in this model"


@dataclass(frozen=True)
class Published:
    """The outcome of a run.

    Attributes:
        results: the table.
        version: the registered model.
        seed: the seed whose model was registered.
    """

    results: Results
    version: Version
    seed: int


def check_name(config: FitConfig) -> None:
    """Refuse a name that the model could not be registered under in the end.

    Raises:
        ConfigError: it is none.
    """
    try:
        store.check_name(config.registry_name)
    except RegistryError as error:
        raise ConfigError(f"registry_name: {error}") from error


def publish(study: Study, by_seed: Mapping[int, Mapping[str, Errors]], tracked: Run) -> Published:
    """Write everything into the run's folder, register the model, log it all.

    Args:
        study: the run.
        by_seed: errors of every method for each seed.
        tracked: the MLflow run; the model belongs to the one below it that trained it.
    """
    config = study.config
    chosen = chosen_by(study, by_seed)
    seed = min(chosen, key=lambda s: chosen[s])
    _export(study, seed, by_seed[seed], chosen[seed])
    # the run of the very training: it has the model's own parameters, curves and data
    made_by = tracked.child(str(Job(seed, OURS)))
    version = push(
        config.registry_name, study.folder, chosen[seed], made_by.id, uri=config.tracking.uri
    )
    tracked.tags({"model": f"{version}, of the run `{Job(seed, OURS)}`"})
    # from here on it is registered: the test pairs only tell how good it is
    _record(study, seed)
    results = replace(tabulate(study, by_seed, version), extraction=_extraction(study, by_seed))
    remarks = {**results.remarks, **_of_translations(study, results)}
    results = replace(results, remarks=remarks)
    results.save(study.folder)
    _figures(study, seed, results)
    tracked.metrics({"ratio_to_best_baseline": results.ratio_to_best_baseline}, 0)
    for method, kept in results.extraction.items():
        tracked.metrics({f"test/{name}/{method}": x for name, x in asdict(kept).items()}, 0)
    rows = [
        {"method": name, "mse": s.mse, "std": s.std, "mse_change": s.mse_change}
        for name, s in results.single_step.items()
    ]
    tracked.table("single_step", rows)
    for name in ("results.json", "results.md", RECORDING):
        tracked.artifact(study.folder / name)
    for picture in sorted((study.folder / FIGURES).glob("*.png")):
        tracked.artifact(picture, FIGURES)
    return Published(results, version, seed)


def chosen_by(study: Study, seeds: Iterable[int]) -> dict[int, float]:
    """Error of our model on what is held out for each seed: seed and champion are chosen by it.

    Never the test pairs: the smallest of several errors on them would be no measurement of them.
    """
    selection, config = study.split.selection, study.config
    return {s: score(study.load_model(s, OURS, config.plus), selection) for s in seeds}


def _extraction(study: Study, seeds: Iterable[int]) -> dict[str, Extraction]:
    """What features keep of R's own outcomes, and what S's say untranslated, where any are."""
    config, pairs, kept = study.config, study.data.test, dict[str, Extraction]()
    for method, settings in ((PAPERS_OWN, config.paper), (OURS, config.plus)):
        models = [study.load_model(seed, method, settings) for seed in seeds]
        if not _translated(settings, models):
            continue
        rows = []
        for model in models:
            tensors = PairTensors.of(pairs, model.frame.state.std, model.frame.change.std)
            decoded = reconstructions(model, tensors), predictions(model.untranslated(), tensors)
            mse = (errors(x.numpy(), pairs, study.scales).mse for x in decoded)
            rows.append((active_latents(model, tensors), *mse))
        kept[method] = Extraction(settings.nets.latent, *np.mean(rows, axis=0).tolist())
    return kept


def _translated(settings: Method, models: Iterable[WorldModel]) -> bool:
    """Whether Algorithm 1 has a say in a method's answers."""
    return not settings.translation.anchored or any(float(m.strength) for m in models)


def _of_translations(study: Study, results: Results) -> dict[str, str]:
    """Remarks on methods that translate nothing, or a feature that keeps hardly anything.

    Of the latter encoding and decoding what R itself did is no nearer to it than DirectPred, which
    sees (o, a) alone.
    """
    direct, by_name = results.single_step.get("DirectPred"), {}
    if OURS not in results.extraction:
        by_name[OURS] = f"nothing is translated; {use_of(study.config.plus.mean).alone}."
    for method, kept in results.extraction.items():
        if direct and kept.own_outcome >= direct.mse:
            by_name[method] = (
                "extraction gains nothing: encoding and decoding R's own outcome makes "
                f"{kept.own_outcome:.3g}, DirectPred {direct.mse:.3g}."
            )
    return by_name


def tabulate(
    study: Study, by_seed: Mapping[int, Mapping[str, Errors]], version: Version | None = None
) -> Results:
    """Mean and spread over seeds of every method."""
    seeds, methods = tuple(by_seed), tuple(next(iter(by_seed.values())))
    rmse = {
        m: tuple(np.mean([by_seed[s][m].rmse for s in seeds], axis=0).tolist()) for m in methods
    }
    scores = {
        m: MethodScore.of_seeds(
            [by_seed[s][m].mse for s in seeds], [by_seed[s][m].mse_change for s in seeds]
        )
        for m in methods
    }
    return Results(
        task=study.config.task,
        seeds=seeds,
        single_step=scores,
        model=version.name if version else None,
        version=version.version if version else None,
        channels=study.world.spec.state,
        rmse=rmse,
        note=" ".join([study.world.note or ASSUMPTION, *_acting(study)]),
        remarks=_of_baselines(study),
        model_selection=study.config.model_selection,
    )


def _acting(study: Study) -> list[str]:
    """What acts of a world's hidden force: less than is drawn, where joints bear less."""
    if not study.world.force_body:
        return []
    newtons = np.linalg.norm(study.data.test.real.hidden, axis=1)
    acts = newtons[newtons > 0]
    if not len(acts):
        return ["The hidden force acts in no test pair."]
    low, half, most = np.percentile(acts, [5, 50, 95])
    return [
        f"The hidden force acts in {100 * len(acts) / len(newtons):.0f} % of the test pairs: 5 % "
        f"of them are below {low:.0f} N, half below {half:.0f} N, 5 % above {most:.0f} N."
    ]


def _of_baselines(study: Study) -> dict[str, str]:
    """What baselines say themselves of their rows."""
    spec = study.world.spec
    remarks = {name: find(name).remark(spec) for name in study.config.baselines.names}
    return {name: remark for name, remark in remarks.items() if remark}


def _record(study: Study, seed: int) -> None:
    """One episode of the test pairs: S, translated and R side by side."""
    pairs, spec = study.data.test, study.world.spec
    rows = first_episode(pairs, LONGEST)
    model = study.world.model("sim")
    shown = {m: study.prediction(seed, m)[rows] for m in SHOWN if _has(study, seed, m)}
    real = pairs.real.s_next[rows]
    states = {"S": pairs.sim_next[rows], "translated": shown[OURS], "R": real}
    write_rollout(
        study.folder / RECORDING,
        model,
        t=np.arange(len(rows)) / spec.rate_hz,
        qpos={name: poses(model, spec, s) for name, s in states.items()},
        predicted=shown,
        real=real,
        channels=spec.state,
        force=pairs.real.hidden[rows] if study.world.force_body else None,
        force_body=study.world.force_body,
    )


def _has(study: Study, seed: int, method: str) -> bool:
    return method in (PAPERS_OWN, OURS, *study.config.baselines.names)


def _export(study: Study, seed: int, by_method: Mapping[str, Errors], chosen: float) -> None:
    """The ONNX graph with its card; nothing is registered that does not match eager."""
    config, spec, folder = study.config, study.world.spec, study.folder
    trained = study.load_model(seed, OURS, config.plus)
    module = SimToReal(trained).eval()
    selection = study.split.selection
    pairs = selection.translated
    known = pairs.real.o[:, spec.n_state :].copy()
    known[:, : spec.n_action] = pairs.real.a  # the last action of o′ is this step's
    n = EXAMPLES
    example = pairs.real.o[:n], pairs.real.a[:n], np.hstack([pairs.sim_next, known])[:n]
    data_hash = digest([study.data.digest("sim"), study.data.digest("real")])
    commit = source().commit
    learned = "of Algorithm 1" if translates(config.plus, selection) else _UNTRAINED
    facts = {"data_hash": data_hash, "commit": commit, "features": learned}
    shift = trained.frame.hidden if trained.frame.carries else None
    usual = None if shift is None else shift.center.numpy()
    export(Exported(trained), spec, folder / MODEL, example=example, facts=facts, hidden=usual)
    model = eager(module)
    difference = parity.check(folder / MODEL, model, example)
    carried = None
    if shift is not None:
        given, shifted = (*example, pairs.real.hidden[:n]), eager(Exported(trained), which=-1)
        worst = parity.check(folder / MODEL, shifted, given, question=parity.SHIFT)
        difference = max(difference, worst)
        golden = [x[:GOLDEN] for x in given]
        carried = golden[-1], shifted(*golden)
    o, a, o_next_sim = (x[:GOLDEN] for x in example)
    card = describe(
        folder / MODEL,
        spec,
        name=config.registry_name,
        data_hash=data_hash,
        config_hash=study.config_hash,
        commit=commit,
        metrics={f"{name}/mse": e.mse for name, e in by_method.items()},
        heldout=HeldOut(selection.data, selection.hash, selection.metric, chosen),
        parity=difference,
        golden=(o, a, o_next_sim, model(o, a, o_next_sim)),
        carried=carried,
    )
    card.save(folder)


def _figures(study: Study, seed: int, results: Results) -> None:
    """Tables as bars, errors per channel, and a trace of the channel with the largest gain."""
    pairs, spec = study.data.test, study.world.spec
    rows = first_episode(pairs, LONGEST // 2)
    shown = {m: study.prediction(seed, m)[rows] for m in SHOWN if _has(study, seed, m)}
    rmse = {method: np.asarray(error) for method, error in results.rmse.items()}
    gain = rmse["RawSim"] - rmse[OURS] if "RawSim" in rmse else -rmse[OURS]
    channel = int(np.argmax(gain / study.scales.state))
    trace = figures.prediction_trace(
        np.arange(len(rows)) / spec.rate_hz,
        pairs.real.s_next[rows, channel],
        {m: p[:, channel] for m, p in shown.items()},
        spec.state[channel],
    )
    folder = study.folder / FIGURES
    folder.mkdir(exist_ok=True)
    drawn = {
        "single_step": figures.bar_table(results),
        "per_channel": figures.per_channel(rmse, spec.state),
        "trace": trace,
    }
    for name, figure in drawn.items():
        png = BytesIO()
        figure.savefig(png, format="png", dpi=150)
        write_whole(folder / f"{name}.png", png.getvalue())
