"""The registered models by themselves, as whoever pulls them has them."""

from __future__ import annotations

from typing import Any

from wt import registered
from wt.errors import RegistryError, WorkError
from wt.evaluate import paper
from wt.evaluate.multi_step import alignment_of, roll_out, simulator
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.evaluate.single_step import errors
from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.exhibits import figure_4
from wt.reproduce.tasks import TASKS
from wt.show.text import short

START_SEED = 0
"""Of the rollouts: the starts of figure 4's first seed."""


@register
class RegisteredModels(Exhibit):
    """Each task's champion: single-step error, and rollouts of figure 4's robot."""

    name = "registered"
    order = 12
    title = "The registered models by themselves"
    tasks = tuple(task.name for task in TASKS)
    any_task = True

    def depends_on(self, bench: Bench) -> str:
        """The champions' bytes: with another one, it is measured again."""
        return " ".join(sha256 for _, sha256 in _champions(bench)[0].values())

    def measure(self, bench: Bench) -> Numbers:
        """Pull, verify and run them; nothing is trained.

        Raises:
            WorkError: no task has one.
        """
        there, missing = _champions(bench)
        if not there:
            raise WorkError(f"no task has a registered model ({next(iter(missing.values()))})")
        models = {name: _measured(bench, name, model) for name, (model, _) in there.items()}
        return {"missing": missing, "models": models}

    def present(self, numbers: Numbers) -> Section:
        """A row a task, then the rollouts."""
        models: dict[str, Any] = numbers["models"]
        rows = []
        for task, one in models.items():
            known = paper.SINGLE_STEP[task]
            card_error = "other test pairs" if one["card"] is None else short(one["card"])
            rows.append([
                task, one["model"], short(one["raw"]), short(one["mse"]), card_error,
                short(one["mse"] / one["raw"]), short(known[PAPERS_OWN] / known["RawSim"]),
            ])  # fmt: skip
        head = ["task", "model", "RawSim", "MSE", "its card's", "/ RawSim", "paper's / RawSim"]
        rolled = [one["rollouts"] for one in models.values() if one["rollouts"]]
        return Section(
            "The champions of the registry, each one ONNX graph whose bytes are verified, on "
            "the test pairs of its task, and in the rollouts of figure 4.",
            [
                Grid(head, rows),
                *(Grid(*table) for one in rolled for table in figure_4.horizon_tables(one)),
            ],
            {},
            [f"{task}: {said}." for task, said in numbers["missing"].items()],
        )


def _measured(bench: Bench, name: str, reference: str) -> Numbers:
    study = bench.study(name)
    pairs = study.data.test
    model = registered.load(reference, study.world.spec, study.config.tracking.uri)
    card = model.card
    same = card.heldout.data_hash == study.split.selection.hash
    rollouts: Numbers = {}
    if name == figure_4.TASK:
        world, truth = figure_4.truth_of(study, bench.quick, START_SEED)
        steps = {"RawSim": ("RawSim", simulator), reference: (OURS, model.step())}
        for label, (method, step) in steps.items():
            alignment = alignment_of(study.config, method)
            rolled = roll_out(world, truth, step, study.scales.state, alignment)
            figure_4.keep(rollouts, label, rolled, study)
    return {
        "model": reference,
        "raw": errors(pairs.sim_next, pairs, study.scales).mse,
        "mse": errors(model.on(pairs), pairs, study.scales).mse,
        "card": card.metrics.get(f"{OURS}/mse") if same else None,
        "rollouts": rollouts,
    }


def _champions(bench: Bench) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """By task: reference and hash of the champions, and why there is none."""
    there, missing = {}, {}
    for name in (task.name for task in bench.tasks):
        try:
            there[name] = registered.champion(bench.config(name))
        except RegistryError as error:
            missing[name] = str(error)
    return there, missing
