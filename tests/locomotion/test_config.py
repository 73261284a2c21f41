"""The base file says every key with the default that the code has."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import yaml
from omegaconf import OmegaConf

from wt.locomotion.config import PolicyConfig, load
from wt.schema import to_yaml


def test_the_base_file_is_the_defaults(root: Path) -> None:
    said = yaml.safe_load((root / "conf" / "policy_base.yaml").read_text())
    own = OmegaConf.to_container(OmegaConf.structured(PolicyConfig(name="?", robot="go2")))
    assert isinstance(own, dict)
    del own["name"], own["robot"]
    assert said == own


def test_a_resolved_configuration_reads_back_unchanged(root: Path, tmp_path: Path) -> None:
    config = load(root / "conf" / "policy_g1_uneven.yaml", ["scene.blocks.seed=7"])
    (tmp_path / "again.yaml").write_text(to_yaml(config))
    again = load(tmp_path / "again.yaml")
    assert dataclasses.asdict(again) == dataclasses.asdict(config)
    assert again.scene.blocks is not None and again.scene.blocks.seed == 7
