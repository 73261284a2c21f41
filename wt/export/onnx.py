"""One ONNX graph of a trained model: (o, a, o′ of S) → o′ of R, in physical units.

Behind that output may come features, which have no units: ``z`` of the transition, taken for one of
R, so that o′ is to be R's then, and ``z_translated``, which R should have where S went to o′.

Of a model that says how what no sensor tells goes on (:mod:`wt.nets.hidden_shift`) the graph has
one input more, ``hidden``, what is hidden in S before the step, and one output, ``hidden_shift``:
what a simulator that is to go on as R adds to its own hidden variables after the step. ``hidden``
may be left out (its default is R's mean), so that whoever only translates need not know of it.

The normaliser is part of the model, so whoever runs the graph needs neither torch nor our
statistics. The file holds everything, weights too; see :mod:`wt.export.graph`. What its channels
are stands in its metadata: :func:`metadata`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32, Shaped

from wt.errors import ModelError
from wt.export.graph import graph, listed
from wt.show.files import write_whole
from wt.types import TransitionSpec

INPUTS = ("o", "a", "o_next_sim")
OUTPUT = "o_next_real"
FEATURES = ("z", "z_translated")
HIDDEN, HIDDEN_SHIFT = "hidden", "hidden_shift"

Example = Shaped[np.ndarray, " ..."]
"""An array whose shape :func:`export` checks itself, with a message."""


def export(
    model: torch.nn.Module,
    spec: TransitionSpec,
    path: Path | str,
    *,
    example: tuple[Example, Example, Example],
    facts: Mapping[str, str] | None = None,
    hidden: Float32[np.ndarray, " hidden"] | None = None,
) -> None:
    """Write ``model`` in evaluation mode as a single ONNX file; the model itself is untouched.

    Args:
        model: maps float32 tensors o (batch, n_obs), a (batch, n_action) and o′ of S
            (batch, n_obs) to o′ of R (batch, n_obs), all in physical units; or to that and the
            two features of :class:`wt.translate.Exported`, to which hidden variables may be given.
        spec: layout of the task's transitions.
        path: the file to write.
        example: o, a and o′ of S, each at least one row, physical units.
        facts: where the model is from, by name, for its metadata.
        hidden: hidden variables that stand for those that are not given, physical units; None for
            a model that does not say how they go on.

    Raises:
        ModelError: the example or the model's output has another shape than ``spec`` says, or
            the model uses something that ONNX cannot express.
    """
    _check(example, spec)
    device = next((p.device for p in model.parameters()), torch.device("cpu"))
    # Two rows: torch.export takes an axis of length 1 for a constant.
    inputs = tuple(
        torch.from_numpy(np.resize(x, (2, x.shape[1])).astype(np.float32)).to(device)
        for x in example
    )
    names: tuple[str, ...] = INPUTS
    if hidden is not None:
        names = (*INPUTS, HIDDEN)
        inputs = (*inputs, torch.from_numpy(np.tile(hidden, (2, 1))).to(device))
    with _evaluating(model), torch.no_grad():
        answer = model(*inputs)
        alone = isinstance(answer, torch.Tensor)
        shape = tuple((answer if alone else answer[0]).shape)
        if shape != (2, spec.n_obs):
            raise ModelError(
                f"export: the model answers two rows with shape {shape}, "
                f"task {spec.task!r} needs (2, {spec.n_obs})"
            )
        content = graph(
            model,
            inputs,
            names,
            OUTPUT,
            *(() if alone else FEATURES),
            *(() if hidden is None else (HIDDEN_SHIFT,)),
            metadata=metadata(spec, hidden is not None) | dict(facts or {}),
            defaults=None if hidden is None else {HIDDEN: hidden},
        )
    write_whole(Path(path), content)


def _check(example: tuple[Example, Example, Example], spec: TransitionSpec) -> None:
    """Refuse examples that a task's transitions cannot be."""
    expected = (spec.n_obs, spec.n_action, spec.n_obs)
    for name, array, width in zip(INPUTS, example, expected, strict=True):
        if array.ndim != 2 or array.shape[1] != width or not len(array):
            raise ModelError(
                f"export: example {name!r} has shape {array.shape}, task {spec.task!r} needs "
                f"(batch, {width}) with at least one row"
            )


def metadata(spec: TransitionSpec, carries: bool = False) -> dict[str, str]:
    """What a graph says of itself: lists are joined by commas, in the order of the channels.

    ``task``; ``rate_hz``, of the control steps; ``joint_names``, in the order of the position
    channels; ``<port>_names`` and ``<port>_units`` of each input and of ``o_next_real``;
    ``normalizer``, which says where it is. With ``carries`` also of ``hidden``, whose channels are
    those of ``hidden_shift``.
    """
    ports = dict(zip((*INPUTS, OUTPUT), (spec.observation, spec.action) + 2 * (spec.observation,),
                     strict=True))  # fmt: skip
    if carries:
        ports[HIDDEN] = spec.hidden
    said = {
        "task": spec.task,
        "rate_hz": f"{spec.rate_hz:g}",
        "joint_names": listed(spec.joints),
        "normalizer": "inside the graph: inputs and o_next_real are in the units given here",
    }
    for port, channels in ports.items():
        said[f"{port}_names"] = listed([c.name for c in channels])
        said[f"{port}_units"] = listed([c.unit for c in channels])
    return said


def eager(model: torch.nn.Module, which: int = 0) -> Callable[..., np.ndarray]:
    """The model in evaluation mode as a function of arrays: what ONNX is compared with.

    Args:
        model: as in :func:`export`.
        which: of its outputs, if it has several.

    Returns:
        A function of o (N, n_obs), a (N, n_action), o′ of S (N, n_obs) and what else the model
        takes, all float32, that returns the output, by default o′ of R (N, n_obs), float32.
    """
    device = next((p.device for p in model.parameters()), torch.device("cpu"))

    def call(*arrays: Float[np.ndarray, "row _"]) -> Float32[np.ndarray, "row out"]:
        with _evaluating(model), torch.no_grad():
            answer = model(*(torch.tensor(x, dtype=torch.float32).to(device) for x in arrays))
            out: torch.Tensor = answer if isinstance(answer, torch.Tensor) else answer[which]
            return out.cpu().numpy()

    return call


@contextmanager
def _evaluating(model: torch.nn.Module) -> Iterator[None]:
    """Evaluation mode inside; afterwards every submodule is in the mode it was in before."""
    training = [(module, module.training) for module in model.modules()]
    model.eval()
    try:
        yield
    finally:
        for module, mode in training:
            module.training = mode
