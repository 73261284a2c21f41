"""The card of a model: everything one must know to run it and to trust it, as JSON.

``card.json`` lies beside ``model.onnx`` and names its sha256. Reading is strict: a key that is
missing, foreign or of another type is an error, since a card half understood is worse than none.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float, Float32
from pydantic import ConfigDict, StringConstraints, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from wt.errors import RegistryError
from wt.types import Channel, TransitionSpec

MODEL_FILE = "model.onnx"
CARD_FILE = "card.json"
PACKAGES = ("torch", "onnx", "onnxruntime", "numpy", "mujoco")

_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Rows = tuple[tuple[float, ...], ...]

_Given = Float[np.ndarray, "_ _"]  # the card checks the widths, with a message


@dataclass(frozen=True, config=_STRICT)
class Port:
    """One input or output of the graph.

    Attributes:
        name: name in the graph.
        shape: ``("batch", number of channels)``, float32.
        channels: name and unit of every column.
    """

    name: str
    shape: tuple[Literal["batch"], int]
    channels: tuple[Channel, ...]

    def __post_init__(self) -> None:
        """Refuse a shape that the channels contradict."""
        if self.shape[1] != len(self.channels):
            raise ValueError(f"shape {self.shape} but {len(self.channels)} channels")


@dataclass(frozen=True, config=_STRICT)
class HeldOut:
    """The metric by which versions of a model are compared: lower is better.

    Attributes:
        set: which data, e.g. ``"held-out transitions"``, or ``"validation pairs"``.
        data_hash: hash of that data; only equal hashes are comparable.
        metric: e.g. ``"energy_distance"`` of transitions, or ``"mse"`` of normalised o′ [-].
        value: the metric.
    """

    set: str
    data_hash: str
    metric: str
    value: float


@dataclass(frozen=True, config=_STRICT)
class Golden:
    """A few rows of inputs with the eager model's answers, physical units.

    Attributes:
        o: observations, (K, n_obs).
        a: actions, (K, n_action).
        o_next_sim: o′ of S, (K, n_obs).
        o_next_real: the model's o′ of R, (K, n_obs).
    """

    o: Rows
    a: Rows
    o_next_sim: Rows
    o_next_real: Rows

    def arrays(
        self,
    ) -> tuple[
        Float32[np.ndarray, "row obs"],
        Float32[np.ndarray, "row action"],
        Float32[np.ndarray, "row obs"],
        Float32[np.ndarray, "row obs"],
    ]:
        """o, a, o′ of S and o′ of R."""
        rows = (self.o, self.a, self.o_next_sim, self.o_next_real)
        o, a, o_next_sim, o_next_real = (np.array(x, dtype=np.float32) for x in rows)
        return o, a, o_next_sim, o_next_real


@dataclass(frozen=True, config=_STRICT)
class Carried:
    """What a graph says of how hidden variables go on, beside its translation.

    Attributes:
        hidden: an input that may be left out: hidden variables of S before the step. The output
            ``hidden_shift``, which a simulator that is to go on as R adds to them after the step,
            has the same channels.
        golden_hidden: rows of it beside the golden o, a and o′ of S, physical units.
        golden_shift: the eager model's ``hidden_shift``.
    """

    hidden: Port
    golden_hidden: Rows
    golden_shift: Rows

    def __post_init__(self) -> None:
        """Refuse golden rows that do not fit the channels."""
        width = self.hidden.shape[1]
        if any(len(row) != width for row in (*self.golden_hidden, *self.golden_shift)):
            raise ValueError(f"golden rows of {self.hidden.name!r} are not {width} wide")

    def arrays(
        self,
    ) -> tuple[Float32[np.ndarray, "row hidden"], Float32[np.ndarray, "row hidden"]]:
        """Hidden variables, and what is added to them."""
        hidden, shift = (np.array(x, np.float32) for x in (self.golden_hidden, self.golden_shift))
        return hidden, shift


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class Card:
    """All that travels beside a model.

    Attributes:
        schema: version of this layout.
        name: registered name, e.g. ``"wt-r5"``.
        task: task it was trained on.
        rate_hz: control rate [Hz] of the transitions.
        joints: joint names in the order of the position channels.
        inputs: o, a and o_next_sim.
        outputs: o_next_real; behind it the features of the graph, which have no unit.
        data_hash: hash of the training data.
        config_hash: hash of the resolved configuration.
        commit: commit of the code that trained it.
        metrics: any further metrics by name, of ``wt fit`` each method's on the test pairs.
        heldout: the metric that decides about ``champion``.
        parity: largest |ONNX - eager| / max(1, |eager|) found; None if never checked.
        golden: rows to replay wherever the model is used.
        sha256: of ``model.onnx``.
        created: UTC, ISO 8601.
        packages: versions of Python and of the libraries that made the model.
        opset: version of ONNX's operator set that the graph needs; None on older cards.
        normalizer: where it is, as the graph says; None where it says nothing.
        features: whose the outputs behind o_next_real are, as the graph says; None where it says
            nothing.
        carried: how what is hidden goes on, of a model that says so.
    """

    schema: Literal[1] = 1
    name: str
    task: str
    rate_hz: float
    joints: tuple[str, ...]
    inputs: tuple[Port, Port, Port]
    outputs: tuple[Port, ...]
    data_hash: str
    config_hash: str
    commit: str
    metrics: dict[str, float]
    heldout: HeldOut
    parity: float | None
    golden: Golden
    sha256: Sha256
    created: Annotated[str, StringConstraints(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00$")]
    packages: dict[str, str]
    opset: int | None = None
    normalizer: str | None = None
    features: str | None = None
    carried: Carried | None = None

    def __post_init__(self) -> None:
        """Refuse golden rows that do not fit the ports."""
        for port in (*self.inputs, *self.outputs[:1]):  # features have no truth to compare with
            rows = getattr(self.golden, port.name, None)
            if rows is None:
                raise ValueError(f"{port.name!r} is no input or output of a translation")
            if len(rows) != len(self.golden.o) or not rows:
                raise ValueError(f"golden {port.name!r} has {len(rows)} rows")
            if any(len(row) != port.shape[1] for row in rows):
                raise ValueError(f"golden {port.name!r} has rows of another width than the port")
        rows_of = self.carried and (self.carried.golden_hidden, self.carried.golden_shift)
        if rows_of and any(len(rows) != len(self.golden.o) for rows in rows_of):
            raise ValueError(f"golden rows of what is hidden are not {len(self.golden.o)}")

    def save(self, folder: Path) -> None:
        """Write ``card.json`` into ``folder``, whole or not at all."""
        temporary = folder / (CARD_FILE + ".tmp")
        text = json.dumps(asdict(self), indent=1, ensure_ascii=False, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")
        os.replace(temporary, folder / CARD_FILE)

    @classmethod
    def load(cls, folder: Path) -> Card:
        """Read ``card.json`` from ``folder``.

        Raises:
            RegistryError: there is none, or it says less, more or other than a card says.
        """
        path = folder / CARD_FILE
        try:
            return TypeAdapter(cls).validate_json(path.read_bytes())
        except FileNotFoundError:
            raise RegistryError(
                f"{folder} has no {CARD_FILE}; a model is a folder with {MODEL_FILE} and "
                f"{CARD_FILE}, as 'wt fit' and 'wt registry pull' leave it"
            ) from None
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or "card"
            raise RegistryError(
                f"{path}: {where}: {first['msg'].splitlines()[0]} ({error.error_count()} in all); "
                "the card was changed or is of another version: pull or train the model again"
            ) from None


def describe(
    onnx_path: Path,
    spec: TransitionSpec,
    *,
    name: str,
    data_hash: str,
    config_hash: str,
    commit: str,
    metrics: Mapping[str, float],
    heldout: HeldOut,
    parity: float | None,
    golden: tuple[_Given, _Given, _Given, _Given],
    carried: tuple[_Given, _Given] | None = None,
) -> Card:
    """The card of an exported model.

    Args:
        onnx_path: the exported graph.
        spec: layout of the task's transitions.
        name: registered name.
        data_hash: of the training data.
        config_hash: of the resolved configuration.
        commit: of the code that trained it (``wt.run.track.source``).
        metrics: any further metrics by name.
        heldout: the metric that decides about ``champion``.
        parity: what ``registry.parity.check`` returned; None if it was not called.
        golden: o, a, o′ of S and the eager model's o′ of R, a few rows each.
        carried: hidden variables beside them and the eager model's ``hidden_shift``; None for a
            model that does not say how they go on.
    """
    opset, outputs, said = _of_graph(onnx_path)
    o, a, o_next_sim, o_next_real = map(_rows, golden)
    hidden = _port("hidden", spec.hidden)
    return Card(
        name=name,
        task=spec.task,
        rate_hz=spec.rate_hz,
        joints=spec.joints,
        inputs=(
            _port("o", spec.observation),
            _port("a", spec.action),
            _port("o_next_sim", spec.observation),
        ),
        outputs=(_port("o_next_real", spec.observation), *outputs),
        data_hash=data_hash,
        config_hash=config_hash,
        commit=commit,
        metrics={key: float(value) for key, value in metrics.items()},
        heldout=heldout,
        parity=parity,
        golden=Golden(o, a, o_next_sim, o_next_real),
        sha256=sha256(onnx_path),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        packages={"python": platform.python_version()}
        | {package: importlib.metadata.version(package) for package in PACKAGES},
        opset=opset,
        normalizer=said.get("normalizer"),
        features=said.get("features"),
        carried=Carried(hidden, *map(_rows, carried)) if carried else None,
    )


def _rows(values: _Given) -> Rows:
    return tuple(tuple(float(v) for v in row) for row in np.asarray(values, np.float32))


def _port(name: str, channels: tuple[Channel, ...]) -> Port:
    return Port(name, ("batch", len(channels)), channels)


def _of_graph(path: Path) -> tuple[int, list[Port], dict[str, str]]:
    """Operator set of a graph, its features behind o_next_real, and what it says of itself."""
    import onnx

    graph = onnx.load(path)
    said = {entry.key: entry.value for entry in graph.metadata_props}
    opset = next(x.version for x in graph.opset_import if not x.domain)
    widths = {
        info.name: info.type.tensor_type.shape.dim[1].dim_value for info in graph.graph.output
    }
    outputs = [
        _port(name, tuple(Channel(str(k), "1") for k in range(width)))
        for name, width in widths.items()
        if name not in ("o_next_real", "hidden_shift")
    ]
    return opset, outputs, said


def sha256(path: Path) -> str:
    """Hex digest of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
