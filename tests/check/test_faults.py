"""Each fault of a log is said, at its column and no other, and mended; two at once too."""

from __future__ import annotations

import numpy as np
import pytest

from tests.check.faults import FAULTS, both
from tests.check.machines import MACHINES, Fault, record, write_model
from wt.check.run import Checked, check
from wt.physics.scene import Scene


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scene]:
    folder = tmp_path_factory.mktemp("models")
    return {name: Scene(write_model(name, folder)) for name in MACHINES}


def said(checked: Checked) -> set[tuple[str, frozenset[str]]]:
    return {(f.kind, frozenset(f.columns)) for f in checked.findings if f.sure}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.id)
def test_a_fault_is_said(fault: Fault, scenes: dict[str, Scene]) -> None:
    checked = check(scenes[fault.machine], fault.log())
    assert said(checked) == {(fault.kinds[0], fault.columns)}


MENDED = [f for f in FAULTS if f.id.startswith(("sign", "swap", "degrees", "ms", "wrap", "comm"))]


@pytest.mark.parametrize("fault", MENDED[::3], ids=lambda f: f.id)
def test_a_mended_log_is_as_it_was(fault: Fault, scenes: dict[str, Scene]) -> None:
    clean = record(fault.machine, fault.seed, **fault.options)  # type: ignore[arg-type]
    mended = check(scenes[fault.machine], fault.log()).recording
    assert mended is not None
    np.testing.assert_allclose(mended.t, clean.t, atol=1e-9)
    for name, column in clean.columns.items():
        np.testing.assert_allclose(mended.columns[name], column, atol=1e-6, err_msg=name)


PAIRS = [
    ("sign-arm4-lift", "degrees-arm4-yaw"),
    ("sign-planar-knee", "command-sign-planar-hip"),
    ("swap-arm4-lift-bend", "velocity-degrees"),
    ("ms-planar", "sign-planar-hip"),
    ("sign-gantry-rail", "degrees-gantry-swing"),
    ("wrap-arm4-yaw", "sign-arm4-lift"),
]


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_two_faults_are_said(pair: tuple[str, str], scenes: dict[str, Scene]) -> None:
    known = {f.id: f for f in FAULTS}
    one, other = (known[name] for name in pair)
    assert one.machine == other.machine
    found = said(check(scenes[one.machine], both(one, other)))
    assert found == {(f.kinds[0], f.columns) for f in (one, other)}
