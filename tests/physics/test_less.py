"""What a model has too much of is taken away, at most all of it."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import Run, edited, motion, scene, simulate
from tests.physics.laws import J1
from wt.mjcf.edit import patched_xml
from wt.physics.effect import effects, forms_of
from wt.physics.hooks import shaped
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

J1_HAS = f'{J1} damping="0.6" frictionloss="0.4"'
AT = Location("joint", "j1")
HAS = {"joint.armature": 0.02, "joint.friction_viscous": 0.6, "joint.friction_coulomb": 0.4}
FIELD = {
    "joint.armature": "dof_armature",
    "joint.friction_viscous": "dof_damping",
    "joint.friction_coulomb": "dof_frictionloss",
}
SAID = {
    "joint.armature": "Joint j1 has 0.01 kg·m² less rotor inertia",
    "joint.friction_viscous": "Joint j1 has 0.3 N·m·s/rad less viscous friction",
    "joint.friction_coulomb": "Joint j1 loses 0.2 N·m less to dry friction",
}
EACH = pytest.mark.parametrize("name", HAS)


@pytest.fixture(scope="module")
def recorded() -> Run:
    return simulate(edited((J1, J1_HAS)), seconds=0.2)


@EACH
def test_only_what_the_model_has_can_be_too_much(name: str, tmp_path: Path, recorded: Run) -> None:
    effect = effects()[name]
    has, has_none = (scene(tmp_path, edited((J1, xml))) for xml in (J1_HAS, 'name="j1"'))
    assert effect.shapes(motion(has, recorded), AT) == [(), (HAS[name],)]
    assert effect.shapes(motion(has_none, recorded), AT) == [()]


@EACH
def test_it_is_bound_to_how_much_that_is(name: str) -> None:
    effect, own = effects()[name], HAS[name]
    assert shaped(effect, ()) is effect and pickle.loads(pickle.dumps(effect)).id == name
    less = shaped(effect, (own,))
    assert [end.tolist() for end in less.bounds()] == [[-own], [0.0]]
    assert shaped(less, (own,)) is less and pickle.loads(pickle.dumps(less)) is less
    assert forms_of(less) == (less,)  # what is left of it creeps as it did
    assert Planted(less, AT, np.array([-own])).at_limit() is None
    assert less.statement(AT, np.array([-0.5 * own])).startswith(SAID[name])


@EACH
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_the_patched_model_has_less_of_it(name: str, share: float, tmp_path: Path) -> None:
    given = scene(tmp_path, edited((J1, J1_HAS)))
    less = Planted(shaped(effects()[name], (HAS[name],)), AT, np.array([-share * HAS[name]]))
    path = tmp_path / "patched.xml"
    path.write_text(patched_xml(given, (less,), ("",)))
    model, dof = Scene(path).model, given.dof("j1")
    assert getattr(model, FIELD[name])[dof] == pytest.approx((1.0 - share) * HAS[name])
    for field in set(FIELD.values()) - {FIELD[name]}:
        assert getattr(model, field)[dof] == getattr(given.model, field)[dof]
    assert (model.dof_solref[dof] == given.model.dof_solref[dof]).all()
