"""A policy acts as its graph says, and one that does not fit is refused in one line."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from wt.errors import ModelError
from wt.worlds.policy import CARD, GRAPH, Policy, PolicyCard, gains, metadata, observed
from wt.worlds.robots import G1, GO2

# of digits: as numbers they would be equal, or none
COMMIT, MODEL = "0e12345678", "1e99999999"
WEIGHT = np.random.default_rng(0).normal(size=(45, 12)).astype(np.float32)


def write(folder: Path, weight: np.ndarray, clock_period: float | None = None) -> None:
    """A policy written by hand: action = observation · weight."""
    ports = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", width])
        for name, width in zip(("observation", "action"), weight.shape, strict=True)
    ]
    node = helper.make_node("MatMul", ["observation", "weight"], ["action"])
    tensor = numpy_helper.from_array(weight, "weight")
    graph = helper.make_graph([node], "policy", ports[:1], ports[1:], [tensor])
    opset = [helper.make_opsetid("", 18)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=8)
    onnx.checker.check_model(model)
    stiffness, velocity_gain = gains(GO2, GO2.physics)
    channels = observed(GO2, clock_period is not None)
    card = PolicyCard(
        name="test", robot="go2", task="walking", rate_hz=50.0, joints=list(GO2.joints),
        default=list(GO2.default), action_scale=list(GO2.action_scale), stiffness=stiffness,
        velocity_gain=velocity_gain, observation=[c.name for c in channels],
        observation_units=[c.unit for c in channels], command_limits=[1.0, 0.5, 1.0], sha256="",
        made_by="a test", commit=COMMIT, run_path="toys/1", sources={"model": MODEL}, training={},
        config={"seed": 3, "ppo": {"gamma": 0.5}}, clock_period=clock_period,
    )  # fmt: skip
    (folder / CARD).write_text(card.text())
    onnx.save(model, folder / GRAPH)
    say(folder, metadata(card))


def say(folder: Path, words: Mapping[str, str]) -> None:
    """Write metadata into the graph, as its exporter does, and hash it anew."""
    model = onnx.load(folder / GRAPH)
    helper.set_model_props(model, dict(words))
    content = model.SerializeToString()
    (folder / GRAPH).write_bytes(content)
    edit(folder, sha256=hashlib.sha256(content).hexdigest())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path, WEIGHT)
    return tmp_path


def edit(folder: Path, **changes: object) -> None:
    card = json.loads((folder / CARD).read_text())
    (folder / CARD).write_text(json.dumps({**card, **changes}))


@pytest.mark.parametrize("file", ["", GRAPH])
def test_actions_are_the_graph_s_of_observation_and_command(folder: Path, file: str) -> None:
    policy = Policy.load(folder / file, GO2)
    rng = np.random.default_rng(1)
    observation, command = rng.normal(size=(5, 42)), rng.normal(size=(5, 3))
    action = policy.act(observation, command, np.zeros((5, 0)))
    assert action.dtype == np.float32
    expected = np.concatenate([observation, command], axis=1) @ WEIGHT
    np.testing.assert_allclose(action, expected, rtol=1e-4, atol=1e-5)


def test_the_gains_of_other_physics_are_refused_unless_asked_for(folder: Path) -> None:
    soft = dataclasses.replace(GO2.physics, stiffness=(40.0,))
    with pytest.raises(ModelError, match=r"stiffness differs .*number 0 is 50.0 instead of 40.0"):
        Policy.load(folder, GO2, soft)
    edit(folder, stiffness=[40.0] * 12)
    say(folder, metadata(PolicyCard.read(folder / CARD)))
    assert Policy.load(folder, GO2, soft).card.stiffness[0] == 40.0


def test_joints_in_another_order_are_refused(folder: Path) -> None:
    joints = list(GO2.joints)
    joints[0], joints[3] = joints[3], joints[0]
    edit(folder, joints=joints)
    with pytest.raises(ModelError, match=r"joints differs .*number 0 is 'FR_hip_joint' instead of"):
        Policy.load(folder, GO2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rate_hz": 100.0}, "rate_hz differs"),
        ({"default": [0.0] * 12}, "default differs"),
        ({"action_scale": [0.3] * 12}, "action_scale differs"),
        ({"observation": ["gyro/x"]}, "observation differs.*1 values instead of 45"),
        ({"sha256": "0" * 64}, "sha256 differ"),
        ({"observation_units": ["1"] * 45}, "observation_units differs"),
        ({"schema": 1}, "no card of schema 2"),
        ({"colour": "red"}, "no card of schema 2"),
    ],
)
def test_what_does_not_fit_is_refused(
    folder: Path, changes: dict[str, object], message: str
) -> None:
    edit(folder, **changes)
    with pytest.raises(ModelError, match=message):
        Policy.load(folder, GO2)


def test_a_policy_with_a_clock_sees_it_last(tmp_path: Path) -> None:
    weight = np.zeros((len(observed(GO2, True)), 12), np.float32)
    weight[-2, 0] = weight[-1, 1] = 1.0  # actions 0 and 1 are the clock
    write(tmp_path, weight, clock_period=0.5)
    policy = Policy.load(tmp_path, GO2)
    assert policy.card.observation[-2:] == ["clock/sin", "clock/cos"]
    clock = np.array([[0.6, 0.8], [0.0, 0.0]])
    action = policy.act(np.ones((2, 42)), np.ones((2, 3)), clock)
    np.testing.assert_allclose(action[:, :2], clock, atol=1e-6)
    edit(tmp_path, clock_period=None)
    with pytest.raises(ModelError, match=r"observation differs.*47 values instead of 45"):
        Policy.load(tmp_path, GO2)


def test_another_robot_s_policy_is_refused(folder: Path) -> None:
    with pytest.raises(ModelError, match="its robot differs from g1's"):
        Policy.load(folder, G1)


@pytest.mark.parametrize("file", [GRAPH, CARD])
def test_a_missing_file_is_named(folder: Path, file: str) -> None:
    (folder / file).unlink()
    with pytest.raises(ModelError, match=rf"{file} is missing"):
        Policy.load(folder, GO2)


def test_a_missing_key_is_named(folder: Path) -> None:
    card = json.loads((folder / CARD).read_text())
    del card["joints"]
    (folder / CARD).write_text(json.dumps(card))
    with pytest.raises(ModelError, match="'joints'"):
        Policy.load(folder, GO2)


def test_a_card_that_is_no_json_is_refused(folder: Path) -> None:
    (folder / CARD).write_text("{")
    with pytest.raises(ModelError, match="is not JSON"):
        Policy.load(folder, GO2)


def test_a_policy_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ModelError, match="'nobody' does not exist"):
        Policy.load("nobody", GO2)


def test_the_graph_speaks_as_mjlab_s_do(folder: Path) -> None:
    said = {p.key: p.value for p in onnx.load(folder / GRAPH).metadata_props}
    assert said["joint_names"].split(",") == list(GO2.joints)
    for key in ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale"):
        assert len([float(x) for x in said[key].split(",")]) == 12
    assert len(said["observation_names"].split(",")) == 45
    assert said["observation_history_lengths"] == ",".join(["1"] * 45)
    assert len(said["command_names"].split(",")) == 3
    assert Policy.load(folder, GO2).card.name == "test"


def test_its_identity_is_how_it_acts_whoever_exported_it(folder: Path) -> None:
    known = Policy.load(folder, GO2).identity
    edit(folder, commit="0e99999999", task="walking on", sources={"checkpoint": MODEL})
    say(folder, metadata(PolicyCard.read(folder / CARD)))
    again = Policy.load(folder, GO2)
    assert again.card.commit == "0e99999999" and again.identity == known
    for others in ((1.01 * WEIGHT, None), (np.pad(WEIGHT, ((0, 2), (0, 0))), 0.6)):
        write(folder, *others)
        assert Policy.load(folder, GO2).identity != known


def test_its_clock_is_part_of_its_identity(folder: Path) -> None:
    wide, found = np.pad(WEIGHT, ((0, 2), (0, 0))), set()
    for period in (0.6, 0.7):
        write(folder, wide, period)
        found.add(Policy.load(folder, GO2).identity)
    assert len(found) == 2


def test_the_graph_says_its_units_and_what_made_it(folder: Path) -> None:
    said = {p.key: p.value for p in onnx.load(folder / GRAPH).metadata_props}
    units = dict(
        zip(said["observation_names"].split(","), said["observation_units"].split(","), strict=True)
    )
    assert (units["gyro/z"], units["gravity/z"], units["command/turn"]) == ("rad/s", "1", "rad/s")
    assert {units[f"qpos/{j}"] for j in GO2.joints} == {"rad"}
    assert said["command_units"] == "m/s,m/s,rad/s"
    assert said["action_units"] == ",".join(["1"] * 12)
    made = {key: said[key] for key in ("task", "commit", "run_path", "model_sha256")}
    assert list(made.values()) == ["walking", COMMIT, "toys/1", MODEL]
    config = hashlib.sha256(b'{"ppo": {"gamma": 0.5}, "seed": 3}').hexdigest()
    assert said["config_hash"] == config


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("joint_names", lambda v: [*v[1:], v[0]]),
        ("joint_stiffness", lambda v: [str(float(v[0]) * 1.01), *v[1:]]),
        ("joint_damping", lambda v: [str(float(v[0]) + 0.001), *v[1:]]),
        ("default_joint_pos", lambda v: v[:-1]),
        ("action_scale", lambda v: ["nan", *v[1:]]),
        ("observation_history_lengths", lambda v: ["5", *v[1:]]),
        ("robot", lambda v: ["g1"]),
        ("task", lambda v: ["running"]),
        ("observation_units", lambda v: [*v[:-1], "deg/s"]),
        ("action_units", lambda v: ["rad"] * 12),
        ("command_units", lambda v: ["km/h", *v[1:]]),
        ("config_hash", lambda v: ["0" * 64]),
        ("commit", lambda v: ["0e00000000"]),
        ("model_sha256", lambda v: ["1e88888888"]),
        ("run_path", lambda v: ["local"]),
    ],
)
def test_a_graph_that_contradicts_its_card_is_refused(
    folder: Path, key: str, change: Callable[[list[str]], list[str]]
) -> None:
    said = metadata(PolicyCard.read(folder / CARD))
    say(folder, said | {key: ",".join(change(said[key].split(",")))})
    with pytest.raises(ModelError, match=f"metadata and its card differ in {key}") as caught:
        Policy.load(folder, GO2)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["joint_names", "action_scale", "rate_hz", "commit", "run_path"])
def test_a_graph_that_does_not_say_what_its_card_does_is_refused(folder: Path, key: str) -> None:
    said = metadata(PolicyCard.read(folder / CARD))
    del said[key]
    say(folder, said)
    with pytest.raises(ModelError, match=f"metadata lack {key}, which its card has"):
        Policy.load(folder, GO2)


def test_numbers_may_have_the_three_decimals_that_mjlab_writes(folder: Path) -> None:
    said = metadata(PolicyCard.read(folder / CARD))
    numbers = ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale")
    rounded = {k: ",".join(f"{float(x):.3f}" for x in said[k].split(",")) for k in numbers}
    say(folder, said | rounded)
    assert Policy.load(folder, GO2).card.name == "test"
