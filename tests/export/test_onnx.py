"""The exported graph against torch, numpy and onnx's own checker."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from registry import parity
from wt.errors import ModelError
from wt.export.onnx import eager, export
from wt.types import Channel, TransitionSpec

SPEC = TransitionSpec(
    task="toy",
    rate_hz=50.0,
    joints=("j1", "j2"),
    observation=tuple(Channel(f"c{i}", "rad") for i in range(6)),
    n_state=4,
    action=tuple(Channel(f"a{i}", "rad") for i in range(2)),
)


class Net(torch.nn.Module):
    """Normaliser, dropout, batch norm and FiLM: what differs between training and evaluation."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor([0.1, -0.2, 0.3, 1.0, -5.0, 0.0]))
        self.register_buffer("scale", torch.tensor([1.0, 2.0, 0.5, 4.0, 10.0, 1.0]))
        self.film = torch.nn.Linear(2, 32)
        self.inner = torch.nn.Linear(12, 16)
        self.norm = torch.nn.BatchNorm1d(16)
        self.drop = torch.nn.Dropout(0.5)
        self.outer = torch.nn.Linear(16, 6)

    def forward(self, o: torch.Tensor, a: torch.Tensor, o_next_sim: torch.Tensor) -> torch.Tensor:
        x = torch.cat([(o - self.mean) / self.scale, (o_next_sim - self.mean) / self.scale], -1)
        gain, bias = self.film(a).chunk(2, dim=-1)
        h = torch.nn.functional.elu(self.norm(self.inner(x)) * (1 + gain) + bias)
        return o_next_sim + self.outer(self.drop(h)) * self.scale


def example(rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(rows)
    return tuple(rng.normal(size=(rows, n)).astype(np.float32) * 3 for n in (6, 2, 6))


@pytest.fixture(scope="module")
def net() -> Net:
    torch.manual_seed(0)
    return Net().train()


@pytest.fixture(scope="module")
def exported(net: Net, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "model.onnx"
    export(net, SPEC, path, example=example(3))
    return path


def test_names_shapes_and_opset_are_the_promised(exported: Path) -> None:
    proto = onnx.load(exported)
    onnx.checker.check_model(proto, full_check=True)
    assert {o.domain: o.version for o in proto.opset_import}[""] >= 18

    def ports(values: object) -> dict[str, list[object]]:
        return {
            v.name: [d.dim_param or d.dim_value for d in v.type.tensor_type.shape.dim]
            for v in values
        }

    assert ports(proto.graph.input) == {
        "o": ["batch", 6],
        "a": ["batch", 2],
        "o_next_sim": ["batch", 6],
    }
    assert ports(proto.graph.output) == {"o_next_real": ["batch", 6]}


def test_the_graph_says_what_its_channels_are(net: Net, tmp_path: Path) -> None:
    export(net, SPEC, tmp_path / "m.onnx", example=example(3), facts={"commit": "abc"})
    said = {p.key: p.value for p in onnx.load(tmp_path / "m.onnx").metadata_props}
    assert (said["task"], said["rate_hz"], said["joint_names"]) == ("toy", "50", "j1,j2")
    assert said["o_names"] == said["o_next_real_names"] == "c0,c1,c2,c3,c4,c5"
    assert (said["a_names"], said["a_units"]) == ("a0,a1", "rad,rad")
    assert said["commit"] == "abc" and "inside the graph" in said["normalizer"]
    session = parity.session(tmp_path / "m.onnx")
    assert session.get_modelmeta().custom_metadata_map == said


def test_one_file_that_holds_the_weights_and_nothing_of_this_machine(exported: Path) -> None:
    assert [p.name for p in exported.parent.iterdir()] == ["model.onnx"]
    proto = onnx.load(exported, load_external_data=False)
    assert all(not t.external_data for t in proto.graph.initializer)
    text = str(proto)
    assert "stack_trace" not in text and __file__ not in text and ".py" not in text


def test_matches_torch_in_evaluation_mode_at_every_batch_size(exported: Path, net: Net) -> None:
    o, a, o_next_sim = (torch.from_numpy(x) for x in example(256))
    net.eval()
    with torch.no_grad():
        expected = net(o, a, o_next_sim).numpy()
    net.train()
    graph = parity.load(exported)
    for rows in (1, 7, 256):
        got = graph(*(x[:rows] for x in example(256)))
        np.testing.assert_allclose(got, expected[:rows], rtol=1e-5, atol=1e-5)
    assert parity.check(exported, eager(net), example(5)) <= 1e-5


def test_leaves_the_model_as_it_was(net: Net, tmp_path: Path) -> None:
    net.drop.eval()  # a mix of modes must come back as that mix
    modes = [m.training for m in net.modules()]
    state = {k: v.clone() for k, v in net.state_dict().items()}
    rng = torch.get_rng_state()
    export(net, SPEC, tmp_path / "again.onnx", example=example(1))
    eager(net)(*example(4))
    assert [m.training for m in net.modules()] == modes
    assert all(torch.equal(v, state[k]) for k, v in net.state_dict().items())
    assert all(p.requires_grad and p.grad is None for p in net.parameters())
    assert torch.equal(torch.get_rng_state(), rng)
    net.drop.train()


def test_same_weights_same_bytes_and_quiet(
    exported: Path, net: Net, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    export(net, SPEC, tmp_path / "again.onnx", example=example(9))
    assert (tmp_path / "again.onnx").read_bytes() == exported.read_bytes()
    assert capfd.readouterr() == ("", "")


def test_a_wrong_example_or_output_is_refused_before_anything_is_written(
    net: Net, tmp_path: Path
) -> None:
    o, a, o_next_sim = example(3)
    path = tmp_path / "model.onnx"
    with pytest.raises(ModelError, match=r"'a' has shape \(3, 6\).*\(batch, 2\)"):
        export(net, SPEC, path, example=(o, o, o_next_sim))

    class Short(torch.nn.Module):
        def forward(self, o: torch.Tensor, a: torch.Tensor, n: torch.Tensor) -> torch.Tensor:
            return n[:, :4] + a.sum() + o[:, :4]

    with pytest.raises(ModelError, match=r"\(2, 4\).*needs \(2, 6\)"):
        export(Short(), SPEC, path, example=(o, a, o_next_sim))
    assert not list(tmp_path.iterdir())


class Fixed(torch.nn.Module):
    """Turns the batch size into a number, as ``len`` does, so that the graph holds only one."""

    def forward(self, o: torch.Tensor, a: torch.Tensor, o_next_sim: torch.Tensor) -> torch.Tensor:
        return o_next_sim + o.new_zeros(len(o), 6) + 0.0 * a.sum(dim=1, keepdim=True) + 0.0 * o


def test_a_graph_of_one_batch_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="fixes the batch size of 'o'"):
        export(Fixed(), SPEC, tmp_path / "model.onnx", example=example(4))
    assert not (tmp_path / "model.onnx").exists()


def test_a_model_that_onnx_cannot_express_says_so_in_one_line(tmp_path: Path) -> None:
    class Foreign(torch.nn.Module):
        def forward(self, o: torch.Tensor, a: torch.Tensor, n: torch.Tensor) -> torch.Tensor:
            return n + a.sum() if float(o.sum()) > 0 else n

    with pytest.raises(ModelError, match="Foreign cannot be written as an ONNX graph") as caught:
        export(Foreign(), SPEC, tmp_path / "m.onnx", example=example(2))
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
