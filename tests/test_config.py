"""Configuration: every shipped file composes, and every mistake is one clear line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tests.tasks import CONF, TASKS
from wt.config import FitConfig, load, to_yaml, vary
from wt.errors import ConfigError
from wt.worlds.base import make


def r5(*overrides: str) -> FitConfig:
    return load(CONF / "r5.yaml", overrides)


def refused(*overrides: str, file: Path = CONF / "r5.yaml") -> str:
    """The one line that a mistake is answered with."""
    with pytest.raises(ConfigError) as caught:
        make(load(file, overrides).world)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
    return str(caught.value)


def written(folder: Path, text: str, name: str = "own.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_there_are_tasks() -> None:
    assert {"r5.yaml", "r5_normal.yaml", "so101.yaml", "debug.yaml"} <= set(TASKS)


@pytest.mark.parametrize("name", TASKS)
def test_shipped_files_compose_and_their_worlds_build(name: str) -> None:
    config = load(CONF / name)
    world = make(config.world)
    assert world.spec.task == config.task
    assert config.registry_name.startswith("wt-")


@pytest.mark.parametrize("name", TASKS)
def test_every_table_says_what_features_are_to_beat_and_what_is_possible(name: str) -> None:
    assert {"RawSim", "DirectPred", "PairedCeiling"} <= set(load(CONF / name).baselines.names)


@pytest.mark.parametrize("name", TASKS)
def test_baselines_average_as_many_networks_as_ours_and_see_as_much(name: str) -> None:
    config = load(CONF / name)
    ours, rivals = config.plus.mean, config.baselines
    assert rivals.members == ours.members and rivals.batch == ours.batch
    assert (rivals.width, rivals.depth) == (ours.width, ours.depth)


@pytest.mark.parametrize("name", TASKS)
def test_ours_is_one_configuration_but_where_the_documentation_says_another(name: str) -> None:
    use = load(CONF / name).plus.mean.simulator
    stiff = name.startswith(("go2_stiff", "go2_payload_20min"))
    assert use == ("mean" if stiff else "ignored" if name == "so101.yaml" else "encoded")


@pytest.mark.parametrize("name", [*TASKS, "base.yaml"])
def test_every_key_has_a_comment_or_stands_in_a_commented_file(name: str) -> None:
    text = (CONF / name).read_text()
    assert text.startswith("#")
    assert "\t" not in text


def test_base_holds_every_default_there_is() -> None:
    """A reader of base.yaml sees every key, and defaults in code do not contradict it."""
    base = yaml.safe_load((CONF / "base.yaml").read_text())
    code = yaml.safe_load(to_yaml(FitConfig(task="t", registry_name="r", world={})))
    for section in ("data", "baselines", "tracking"):
        assert base[section] == code[section], section
    for section, keys in code["paper"].items():
        assert base["paper"][section] == keys, section


def test_a_file_wins_over_its_base_and_overrides_over_both(tmp_path: Path) -> None:
    file = written(tmp_path, f"base: {CONF / 'r5.yaml'}\ndata: {{transitions: 77}}\nseeds: [4]\n")
    config = load(file, ["data.test_pairs=5"])
    assert (config.data.transitions, config.data.test_pairs) == (77, 5)
    assert config.data.validation_pairs == r5().data.validation_pairs
    assert config.seeds == [4]
    assert load(file, ["data.transitions=78"]).data.transitions == 78


def test_overrides_of_nested_keys_and_lists() -> None:
    config = r5(
        "seeds=[3,1]", "plus.mean.kind=average", "world.force.max_newton=50",
        "world.sim.stiffness=[1,2,3,4,5,6]", "paper.train.learning_rate=1e-4",
        "baselines.names=[RawSim]", "tracking.uri=sqlite:///a=b.db",
    )  # fmt: skip
    assert config.seeds == [3, 1]
    assert config.plus.mean.kind == "average"
    assert config.paper.mean.kind == "none"
    assert config.world["force"]["max_newton"] == 50
    assert config.world["force"]["appear"] == 0.15
    assert config.world["sim"]["stiffness"] == [1, 2, 3, 4, 5, 6]
    assert config.paper.train.learning_rate == 1e-4
    assert config.baselines.names == ["RawSim"]
    assert config.tracking.uri == "sqlite:///a=b.db"


def test_last_override_wins() -> None:
    assert r5("data.seed=1", "data.seed=2").data.seed == 2


def test_none_turns_the_force_off_and_a_key_below_it_on_again() -> None:
    assert make(r5("world.force=null").world).spec.hidden == ()
    world = make(r5("world.force=null", "world.force.max_newton=9").world)
    assert len(world.spec.hidden) == 3


def test_sections_that_share_an_anchor_stay_apart(tmp_path: Path) -> None:
    text = (CONF / "r5.yaml").read_text().replace("base: base.yaml\n", "")
    text += "\npaper: &small\n  vae: {beta: 0.5}\nplus: *small\n"
    config = load(written(tmp_path, text), ["plus.vae.beta=0.25"])
    assert (config.paper.vae.beta, config.plus.vae.beta) == (0.5, 0.25)


@pytest.mark.parametrize("name", TASKS)
def test_yaml_round_trip(name: str, tmp_path: Path) -> None:
    config = load(CONF / name, ["seeds=[0,5]", "data.dir=some where"])
    again = load(written(tmp_path, to_yaml(config)))
    assert again == config
    assert to_yaml(again) == to_yaml(config)


@pytest.mark.parametrize(
    ("override", "key", "near"),
    [
        ("data.transition=3", "data.transition", "transitions"),
        ("plus.translation.transprot=true", "plus.translation.transprot", "transport"),
        ("seed=3", "seed", "seeds"),
        ("world.frce=null", "world.frce", "force"),
        ("world.force.max_newtons=3", "world.force.max_newtons", "max_newton"),
        ("world.sim.stifness=[1]", "world.sim.stifness", "stiffness"),
    ],
)
def test_unknown_key_names_the_nearest(override: str, key: str, near: str) -> None:
    assert refused(override) == f"unknown key '{key}'; did you mean '{near}'?"


def test_unknown_key_far_from_all_lists_them() -> None:
    assert "allowed: dir, held_out, in_memory, lessons, real_transitions" in refused("data.zzz=1")


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("data.transitions=many", ("data.transitions", "'many'")),
        ("data.transitions=1.5", ("data.transitions", "'1.5'")),
        ("data.transitions=[1]", ("data.transitions", "[1]")),
        ("data.transitions=", ("data.transitions", "null")),
        ("paper.nets.film=maybe", ("paper.nets.film", "'maybe'")),
        ("paper.mean.kind=median", ("paper.mean.kind", "'median'", "'none', 'average', 'mode'")),
        ("seeds=abc", ("seeds", "'abc'", "list")),
        ("seeds=3", ("seeds is 3", "seeds=[3]")),
        ("seeds=[a]", ("seeds", "'a'")),
        ("seeds=[1.5]", ("seeds", "1.5")),
        ("seeds[0]=3", ("seeds", "one value")),
        ("data=5", ("data is 5", "transitions")),
        ("data=[]", ("data is []", "transitions")),
        ("paper.nets=null", ("paper.nets is None", "latent")),
        ("world=[]", ("world is []", "keys with values")),
        ("world=3", ("world is 3", "keys with values")),
        ("world=null", ("world is null",)),
        ("world.force=3", ("world.force is 3", "max_newton")),
        ("world.sim=[1,2]", ("world.sim is [1, 2]", "stiffness")),
        ("world.force.max_newton=abc", ("world.force.max_newton", "'abc'")),
        ("world.sim.stiffness=[1,2,3,4,5,a]", ("world.sim.stiffness", "'a'")),
        ("world.sim.stiffness=80", ("world.sim.stiffness is 80", "list")),
        ("world.name=r6", ("world.name 'r6'", "r5, so101")),
        ("world.name=null", ("world.name",)),
    ],
)
def test_wrong_type(override: str, says: tuple[str, ...]) -> None:
    message = refused(override)
    for words in says:
        assert words in message


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("abc", "'abc' is not of the form key=value"),
        ("=3", "unknown key ''"),
        ("data..seed=3", "unknown key 'data.'"),
        ("data.dir={", "override 'data.dir={': its value is not YAML"),
        ("data.dir=[1", "override 'data.dir=[1': its value is not YAML"),
        ("data.dir=${nowhere}", "data.dir: Interpolation key 'nowhere' not found"),
    ],
)
def test_bad_override(override: str, says: str) -> None:
    assert says in refused(override)


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("data.transitions=0", "data.transitions is 0; it must be above zero"),
        ("data.seed=-1", "data.seed is -1; it must be zero or more"),
        ("data.held_out=0", "data.held_out is 0.0; it must be above zero"),
        ("data.held_out=0.6", "data.held_out is 0.6; it must be at most 0.5"),
        ("baselines.history=-1", "baselines.history is -1; it must be zero or more"),
        ("plus.train.learning_rate=nan", "plus.train.learning_rate is nan"),
        ("plus.train.validate_every=0", "plus.train.validate_every is 0"),
        ("paper.nets.width=0", "paper.nets.width is 0"),
        ("paper.vae.beta=-1", "paper.vae.beta is -1"),
        ("plus.translation.average=1", "plus.translation.average is 1"),
        ("baselines.batch=0", "baselines.batch is 0"),
        ("seeds=[]", "seeds []"),
        ("seeds=[1,1]", "seeds [1, 1]"),
        ("seeds=[-1]", "seeds [-1]"),
        ("plus.train.devices=7", "plus.train.batch 512 is not a multiple of 7, the processes"),
        ("paper.train.nodes=3", "paper.train.batch 256 is not a multiple of 3, the processes"),
        ("paper.train.strategy=ray", "paper.train.strategy is ray with paper.train.nodes 1: ddp"),
        ("paper.train.devices=0", "paper.train.devices is 0"),
        ("paper.train.steps=7", "paper.train.steps 7 is not a multiple of "
         "paper.train.validate_every 500; change either"),
        ("plus.mean.kind=none", "plus.translation.transport needs plus.mean.kind"),
    ],
)  # fmt: skip
def test_impossible_values(override: str, says: str) -> None:
    assert says in refused(override)


def test_zero_is_fine_where_it_means_something() -> None:
    config = r5("paper.vae.blind_weight=0", "paper.translation.identity=0")
    assert config.paper.vae.blind_weight == 0


def test_missing_file_names_the_nearest() -> None:
    message = refused(file=CONF / "r55.yaml")
    assert "does not exist" in message
    assert "did you mean 'r5.yaml'?" in message


def test_missing_file_in_an_empty_or_missing_folder(tmp_path: Path) -> None:
    assert "no YAML file is near it" in refused(file=tmp_path / "a.yaml")
    assert "no YAML file is near it" in refused(file=tmp_path / "nowhere" / "a.yaml")
    assert "does not exist" in refused(file=tmp_path)


@pytest.mark.parametrize("text", ["a: [1", "a: b: c", "\tx", "{"])
def test_not_yaml(tmp_path: Path, text: str) -> None:
    assert "own.yaml is not YAML" in refused(file=written(tmp_path, text))


def test_binary_file(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_bytes(b"\xff\xfe\x00PAR1")
    assert "own.yaml is not YAML" in refused(file=tmp_path / "own.yaml")


@pytest.mark.parametrize(("text", "kind"), [("[1, 2]", "list"), ("just words", "str")])
def test_yaml_without_keys(tmp_path: Path, text: str, kind: str) -> None:
    assert f"own.yaml holds a {kind}" in refused(file=written(tmp_path, text))


@pytest.mark.parametrize("key", ["task", "registry_name", "world"])
def test_missing_value(tmp_path: Path, key: str) -> None:
    values = {"task": "t", "registry_name": "n", "world": {"name": "so101"}}
    del values[key]
    file = written(tmp_path, yaml.safe_dump(values))
    assert refused(file=file) == f"{key} is missing; add it to the YAML"


def test_empty_file(tmp_path: Path) -> None:
    assert "is missing; add it to the YAML" in refused(file=written(tmp_path, ""))


def test_world_without_its_physics(tmp_path: Path) -> None:
    file = written(tmp_path, "task: t\nregistry_name: n\nworld: {name: r5}\n")
    assert refused(file=file).startswith("world.sim")


def test_base_that_is_missing_or_itself(tmp_path: Path) -> None:
    assert "nope.yaml' does not exist" in refused(file=written(tmp_path, "base: nope.yaml\n"))
    assert "its own base" in refused(file=written(tmp_path, "base: own.yaml\n"))
    written(tmp_path, "base: own.yaml\n", "other.yaml")
    assert "its own base" in refused(file=written(tmp_path, "base: other.yaml\n"))
    assert "does not exist" in refused(file=written(tmp_path, "base: 3\n"))


def test_a_variant_differs_in_what_it_says_and_nothing_else() -> None:
    paper = r5().paper
    varied = vary(paper, ["translation.cycle=0", "nets.film=false"])
    assert (varied.translation.cycle, varied.nets.film) == (0.0, False)
    assert vary(varied, ["translation.cycle=3", "nets.film=true"]) == paper


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("translation.cylce=0", "did you mean 'cycle'"),
        ("translation.cycle=-1", "zero or more"),
        ("train.steps=7", "not a multiple"),
        ("translation.transport=true", "needs variant.mean.kind"),
    ],
)
def test_an_impossible_variant_is_refused(change: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        vary(r5().paper, [change])
