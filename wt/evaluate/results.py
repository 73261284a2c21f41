"""The numbers of an evaluation: ``results.json``, ``results.md`` and a table in the terminal.

Errors are in three units: of the state's spread, of its change's, and physical. ``results.json``
follows the public schema 1; after its keys come ``per_channel`` and ``per_group`` (errors in
physical units), ``note`` (what the comparison assumes), ``remarks``, ``model_selection`` and
``extraction`` (what features keep, and what translating them adds).
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from wt.config import ModelSelection
from wt.errors import DataError
from wt.evaluate import paper
from wt.evaluate.single_step import by_kind
from wt.show.files import write_whole
from wt.show.text import markdown_table, short, terminal_table
from wt.types import Channel

SCHEMA = 1
OURS = "WorldTranslationPlus"
PAPERS_OWN = "WorldTranslation"
ENCODER = "SimulatorEncoder"
"""Ours too: it estimates what was hidden, without pairs and without an adversary."""
CEILING = "PairedCeiling"
"""Trained on pairs: what is possible, and no rival."""

ASSUMPTION = (
    "The simulator is given the true hidden variable (the force that acts, the terrain, the "
    "payload), as in the paper: RawSim and the translations start from its output under it."
)


@dataclass(frozen=True)
class MethodScore:
    """One method's single-step error; NaN where it did not converge.

    Attributes:
        mse: mean squared error of the normalised next state, mean over seeds.
        std: standard deviation of ``mse`` over seeds; 0 with one seed.
        mse_change: mean squared error of the normalised change of state, mean over seeds.
    """

    mse: float
    std: float
    mse_change: float

    @classmethod
    def of_seeds(cls, mse: Sequence[float], mse_change: Sequence[float]) -> MethodScore:
        """Mean and spread of one value a seed."""
        return cls(
            mse=statistics.fmean(mse),
            std=statistics.stdev(mse) if len(mse) > 1 else 0.0,
            mse_change=statistics.fmean(mse_change),
        )


@dataclass(frozen=True)
class Extraction:
    """What the feature of a World Translation keeps, and what translating it adds.

    Means over seeds; errors are mean squared ones of the normalised next state.

    Attributes:
        latents: size of z.
        active: of these, whose means vary among R's transitions (:data:`wt.train.phases.ACTIVE`).
        own_outcome: error of R's own outcome, encoded and decoded.
        untranslated: error where S's feature is decoded as it is.
    """

    latents: int
    active: float
    own_outcome: float
    untranslated: float


@dataclass(frozen=True)
class Results:
    """Outcome of an evaluation.

    Attributes:
        task: name of the task, e.g. ``"r5_force"``.
        seeds: the seeds that were trained.
        single_step: each method's score.
        model: name in the registry; None when nothing was registered.
        version: version in the registry.
        channels: the predicted channels that ``rmse`` speaks of.
        rmse: each method's root mean squared error of each channel, in the channel's unit.
        note: what the comparison assumes.
        remarks: sentences on methods whose rows need one; these are marked in tables.
        model_selection: what chose checkpoints, seed and champion.
        extraction: of the World Translations whose features are translated.
    """

    task: str
    seeds: tuple[int, ...]
    single_step: Mapping[str, MethodScore]
    model: str | None = None
    version: int | None = None
    channels: tuple[Channel, ...] = ()
    rmse: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    note: str = ASSUMPTION
    remarks: Mapping[str, str] = field(default_factory=dict)
    model_selection: ModelSelection = "pairs"
    extraction: Mapping[str, Extraction] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every method's errors speak of every channel."""
        for method, errors in self.rmse.items():
            if len(errors) != len(self.channels):
                raise DataError(
                    f"results: {method!r} has errors of {len(errors)} channels, "
                    f"{len(self.channels)} are needed"
                )

    @property
    def paper(self) -> Mapping[str, float]:
        """The paper's MSE of this task by method; empty where it has none."""
        return paper.SINGLE_STEP.get(self.task, {})

    @property
    def ratio_to_best_baseline(self) -> float:
        """MSE of our best over that of the best baseline; NaN when either is missing."""
        baselines = [
            score.mse
            for method, score in self.single_step.items()
            if method not in (OURS, PAPERS_OWN, ENCODER, CEILING) and math.isfinite(score.mse)
        ]
        if OURS not in self.single_step or not baselines:
            return math.nan
        best = min(baselines)
        return self.single_step[OURS].mse / best if best > 0 else math.nan

    def relative(self, method: str) -> float:
        """A method's MSE in units of RawSim's, which is comparable between worlds; NaN without."""
        raw = self.single_step.get("RawSim")
        return self.single_step[method].mse / raw.mse if raw and raw.mse else math.nan

    def physical_mse(self, method: str) -> float:
        """Mean square over all channels in their own units, rad, rad/s and so on; NaN without.

        What moves most weighs most: joint velocities at contact.
        """
        return float(np.mean(np.square(self.rmse[method]))) if method in self.rmse else math.nan

    @property
    def groups(self) -> Mapping[Channel, Mapping[str, float]]:
        """Each method's RMSE over the channels of one kind, e.g. ``qpos`` [rad], physical units."""
        kinds = {m: by_kind(np.array(e), self.channels) for m, e in self.rmse.items()}
        names = next(iter(kinds.values()), {})
        return {kind: {m: float(e[kind]) for m, e in kinds.items()} for kind in names}

    def save(self, folder: Path) -> None:
        """Write ``results.json`` and ``results.md`` into ``folder``.

        Raises:
            OSError: the folder cannot be written; earlier files stay as they were.
        """
        text = json.dumps(self.to_json(), indent=2, ensure_ascii=False, allow_nan=False)
        write_whole(folder / "results.json", text + "\n")
        write_whole(folder / "results.md", self.to_markdown())

    @classmethod
    def load(cls, folder: Path) -> Results:
        """Read ``results.json`` of a run's folder.

        Raises:
            DataError: it is missing, truncated or of another schema.
        """
        path = folder / "results.json"
        try:
            return cls.from_json(json.loads(path.read_text()))
        except FileNotFoundError:
            raise DataError(
                f"{path} does not exist; give the folder of a finished 'wt fit'"
            ) from None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(
                f"{path} is not a results file ({error!r}); make it again with 'wt fit'"
            ) from error

    def to_json(self) -> dict[str, Any]:
        """The content of ``results.json``; NaN becomes null."""
        return {
            "schema": SCHEMA,
            "task": self.task,
            "seeds": list(self.seeds),
            "single_step": {
                method: {
                    "mse": _number(score.mse),
                    "std": _number(score.std),
                    "mse_change": _number(score.mse_change),
                }
                for method, score in self.single_step.items()
            },
            "paper": dict(self.paper),
            "ratio_to_best_baseline": _number(self.ratio_to_best_baseline),
            "model": self.model,
            "version": self.version,
            "per_channel": {
                channel.name: {
                    "unit": channel.unit,
                    "rmse": {method: _number(errors[c]) for method, errors in self.rmse.items()},
                }
                for c, channel in enumerate(self.channels)
            },
            "per_group": {
                kind.name: {
                    "unit": kind.unit,
                    "rmse": {method: _number(error) for method, error in errors.items()},
                }
                for kind, errors in self.groups.items()
            },
            "note": self.note,
            "remarks": dict(self.remarks),
            "model_selection": self.model_selection,
            "extraction": {method: asdict(kept) for method, kept in self.extraction.items()},
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Results:
        """The results a ``results.json`` holds.

        Raises:
            DataError: it is of another schema.
        """
        if content["schema"] != SCHEMA:
            raise DataError(
                f"results of schema {content['schema']!r} cannot be read, only {SCHEMA}; "
                "use the version of wt that wrote them"
            )
        rows = content.get("per_channel", {})
        methods = next(iter(rows.values()))["rmse"] if rows else {}
        return cls(
            task=content["task"],
            seeds=tuple(content["seeds"]),
            single_step={
                method: MethodScore(**{key: _nan_if_null(value) for key, value in score.items()})
                for method, score in content["single_step"].items()
            },
            model=content["model"],
            version=content["version"],
            channels=tuple(Channel(name, row["unit"]) for name, row in rows.items()),
            rmse={
                method: tuple(_nan_if_null(row["rmse"][method]) for row in rows.values())
                for method in methods
            },
            note=content.get("note", ASSUMPTION),
            remarks=content.get("remarks", {}),
            model_selection=content.get("model_selection", "pairs"),
            extraction={m: Extraction(**k) for m, k in content.get("extraction", {}).items()},
        )

    def to_markdown(self) -> str:
        """The content of ``results.md``: ours beside the paper's, then errors in physical units."""
        lines = [
            f"# {self._title()}",
            "",
            *markdown_table(self._head(), self._rows(bold="**{}**")),
            "",
            self._ratio(),
            "",
            *([*self._remarks(), ""] if self.remarks else []),
            " ".join(
                [
                    _LEGEND,
                    self.selected,
                    *([_PAPER_LEGEND] * bool(self.paper)),
                    self.note,
                ]
            ),
        ]
        if self.extraction:
            lines += ["", f"## {_EXTRACTION}", "", *markdown_table(*self.extracted())]
        if self.channels:
            lines += ["", f"## {_PHYSICAL}", "", *markdown_table(*self.physical())]
            head = ["channel", *self.rmse]
            rows = [
                [f"{channel.name} [{channel.unit}]", *(f"{e[c]:.3g}" for e in self.rmse.values())]
                for c, channel in enumerate(self.channels)
            ]
            lines += [
                "",
                "## Error per channel (RMSE, physical units)",
                "",
                *markdown_table(head, rows),
            ]
        return "\n".join(lines) + "\n"

    def print_table(self, console: Console) -> None:
        """Print the table of methods to a terminal."""
        rows = self._rows(bold="[bold]{}[/bold]")
        console.print(terminal_table(self._head(), rows, self._title()))
        if self.extraction:
            console.print(terminal_table(*self.extracted(), _EXTRACTION))
        if self.channels:
            head, rows = self.physical()
            console.print(terminal_table([escape(name) for name in head], rows, _PHYSICAL))
        console.print(self._ratio(), highlight=False)
        for remark in self._remarks():
            console.print(remark, highlight=False, markup=False)
        for line in (self.selected, self.note):
            console.print(line, style="dim", highlight=False, markup=False)

    def _title(self) -> str:
        seeds = f"{len(self.seeds)} seed" + ("s" if len(self.seeds) != 1 else "")
        return f"Single-step prediction, {self.task}, {seeds}"

    def _head(self) -> list[str]:
        head = ["method", "MSE", "± std", "of change", "/ RawSim"]
        return [*head, *(["paper's", "/ RawSim"] * bool(self.paper))]

    def _rows(self, bold: str) -> list[list[str]]:
        """One row a method, ours first and the rest by error; the smallest MSE through ``bold``."""
        rivals = (score for method, score in self.single_step.items() if method != CEILING)
        best = min((_or_inf(score.mse) for score in rivals), default=math.inf)
        rows = []
        for method in self._order():
            score = self.single_step[method]
            mse = short(score.mse) if math.isfinite(score.mse) else "diverged"
            row = [
                method + "*" * (method in self.remarks),
                bold.format(mse) if score.mse == best and method != CEILING else mse,
                short(score.std) if len(self.seeds) > 1 else "–",
                short(score.mse_change),
                short(self.relative(method)),
            ]
            if self.paper:
                known = method in self.paper
                row.append(short(self.paper[method]) if known else "–")
                row.append(short(self.paper[method] / self.paper["RawSim"]) if known else "–")
            rows.append(row)
        return rows

    def physical(self) -> tuple[list[str], list[list[str]]]:
        """Head and rows of the table in physical units, methods in the order of the other one."""
        groups = self.groups
        order = [m for m in self._order() if m in self.rmse]
        rows = [
            [m, *(f"{errors[m]:.3g}" for errors in groups.values()), short(self.physical_mse(m))]
            for m in order
        ]
        kinds = (f"{kind.name} [{kind.unit}]" for kind in groups)
        return ["method", *kinds, "all, squared"], rows

    def extracted(self) -> tuple[list[str], list[list[str]]]:
        """Head and rows of the table of features; DirectPred's error is what they are to beat."""
        direct = self.single_step.get("DirectPred")
        rows = [
            [
                method,
                f"{kept.active:.3g} of {kept.latents}",
                short(kept.own_outcome),
                short(direct.mse) if direct else "–",
                short(kept.untranslated),
                short(self.single_step[method].mse),
            ]
            for method, kept in self.extraction.items()
        ]
        return ["method", "active z", "R's own", "DirectPred", "untranslated", "translated"], rows

    def _order(self) -> list[str]:
        """Methods, ours first, the rest by error, and what is possible at the end."""
        return sorted(self.single_step, key=lambda m: (_rank(m), _or_inf(self.single_step[m].mse)))

    @property
    def selected(self) -> str:
        """A sentence on what chose checkpoint, seed and champion."""
        return _SELECTED[self.model_selection]

    def _remarks(self) -> list[str]:
        return [f"* {method}: {remark}" for method, remark in self.remarks.items()]

    def _ratio(self) -> str:
        ratio = self.ratio_to_best_baseline
        if math.isnan(ratio):
            return f"No ratio: {OURS} or the baselines are missing."
        return f"{OURS} makes {ratio:.3f} of the error of the best baseline."


_LEGEND = "MSE in units of the state's variance (and of its change's), under teacher forcing."
_SELECTED: Mapping[ModelSelection, str] = {
    "unpaired": "Seed and champion were selected without pairs, on held-out transitions of S and "
    "of R (model_selection: unpaired); of each training the last checkpoint is kept.",
    "pairs": "Checkpoints, seed and champion were selected on pairs of S and R, which a real robot "
    "with something hidden does not give (model_selection: pairs); none is a test pair.",
}
_EXTRACTION = "Features: R's own outcome, encoded and decoded, and S's, by MSE of the state"
_PHYSICAL = "Error in physical units (RMSE of each kind of channel; mean square of all)"
_PAPER_LEGEND = (
    "The paper's numbers are those of its figure 3, on its own worlds and in a unit that it does "
    "not name: compare ratios with them, not absolute values."
)


def _rank(method: str) -> int:
    return {OURS: 0, ENCODER: 1, PAPERS_OWN: 2, CEILING: 4}.get(method, 3)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _nan_if_null(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _or_inf(value: float) -> float:
    return value if math.isfinite(value) else math.inf
