"""``physics.py``: one class for what a patched MJCF has no element for, as readable text.

It needs numpy, MuJoCo and, for learned laws, onnxruntime, and nothing of ours. The text is that of
:class:`wt.mjcf.template.Physics` with the lines of each effect (:class:`wt.physics.script.Script`)
under the sentence that says what it is, and without the helpers that nothing calls.
"""

from __future__ import annotations

import ast
import json
import re
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from wt.mjcf import template
from wt.physics.hooks import InReplay
from wt.physics.planted import Hypothesis, Planted, in_order
from wt.physics.scene import Scene
from wt.physics.script import WIDTH, Helper, Script, number

HELPERS: dict[Helper, tuple[str, ...]] = {
    "joint": ("_joint",),
    "drive": ("_drive",),
    "drives": ("_drives", "_drive"),
    "given": (),
    "bristle": ("_bristle",),
    "push": ("_push", "_scratch"),
    "residual": ("_residual", "_learned"),
    "creep": ("_creep",),
    "swing": ("_swing",),
    "gear": ("_gear", "_drives", "_drive"),
    "command": ("_command",),
    "profile": ("_profile", "_command"),
}
"""What lines of effects may ask for, and the methods that it takes."""
_DRIVES: set[Helper] = {"drive", "drives", "given"}
"""Those of them by which laws see drives as the given model has them."""
_INIT: dict[Helper, tuple[str, ...]] = {
    "push": ("self._scratch = mujoco.MjData(model)",),
    "residual": (
        'path = str(Path(__file__).with_name("residual.onnx"))',
        "alone = onnxruntime.SessionOptions()",
        "alone.intra_op_num_threads = 1  # it is small: more threads would only wait",
        'cpu = ["CPUExecutionProvider"]',
        "self._learned = onnxruntime.InferenceSession(path, alone, providers=cpu)",
    ),
}
_HEAD = '''"""What model.xml cannot say in MJCF.

Written by wt diagnose. It needs {needs}, and nothing else.

    p = Physics(model)          # model: mujoco.MjModel of model.xml, which it changes: see __init__
    p.reset(data)               # data: mujoco.MjData, with its positions and commands set
    p.step(data)                # in place of mujoco.mj_step(model, data)
    p.attach(); p.detach()      # or: as MuJoCo's callback, for code that steps by itself
    q, v = p.sense(t, q, v)     # what the real sensors would report of a motion
    f = p.forces(qpos, qvel, ctrl, t)  # of many simulations at once, for parallel simulators
"""
'''


def physics_py(
    scene: Scene,
    hypothesis: Hypothesis,
    recordings: Sequence[str] = (),
    shown: int = 0,
) -> str | None:
    """The text of ``physics.py``; None if MJCF says it all.

    Args:
        scene: the model as given.
        hypothesis: the findings, and corrections, in the order in which they are patched.
        recordings: names of the recordings, by index; events have times in each.
        shown: the recording whose events act if nothing else is said.
    """
    written = [(p.effect.script(p.at, p.theta), p) for p in in_order(hypothesis)]
    scripts = [(script, p.statement(scene)) for script, p in written if script is not None]
    if not any(script.acts for script, _ in scripts):
        return None
    patched, without = _models(scene, hypothesis)
    asked = dict.fromkeys(helper for script, _ in scripts for helper in script.helpers)
    lines = {
        "joints": [f"joints = {_tuple(scene.joints)}  # columns of sense"],
        "init": [
            *(line for helper in asked for line in _INIT.get(helper, ())),
            *_restored(patched, without),
        ],
        "given": _as_given(scene, without) if _DRIVES & asked.keys() else [],
        "base": [],
        **{part: list(_part(scripts, part)) for part in ("start", "sense", "undo", "force")},
    }
    if len(recordings) > 1:
        lines["joints"].append(f"recordings = {_tuple(recordings)}  # see __init__")
    for part in ("sense", "undo"):
        if lines[part]:
            lines[part].insert(0, "joint = self.joints.index")
    methods = {method for helper in asked for method in HELPERS[helper]}
    if scene.free and "_joint" in methods:
        methods.add("_base")
        whose = "if name not in self._joints:"
        lines["base"] = [whose, "    return self._base(name, qpos, qvel)"]
    body = _filled(_template(methods), lines)
    body = body.replace("recording: int = 0", f"recording: int = {shown}")
    return _headed(body, "residual" in asked)


def _part(scripts: Sequence[tuple[Script, str]], part: str) -> Iterator[str]:
    """Lines of all effects for one method, each under its sentence."""
    # what the last sensor did to a signal is undone first
    for script, said in reversed(scripts) if part == "undo" else scripts:
        if lines := getattr(script, part):
            yield from textwrap.wrap(said, WIDTH, initial_indent="# ", subsequent_indent="# ")
            yield from lines


def _restored(patched: mujoco.MjModel, without: mujoco.MjModel) -> list[str]:
    """Assignments that take the stand-ins for what acts exactly here out of a compiled model."""
    lines = list(_differences(patched, without))
    why = "# for these model.xml has the nearest that MJCF can say, which would now act twice"
    return [why, *lines] if lines else []


def _models(scene: Scene, hypothesis: Hypothesis) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The patched model, and the same without the stand-ins for what acts exactly here."""
    patched, without = scene.written(), scene.written()
    for p in hypothesis:
        p.effect.patch(patched, p.at, p.theta)
        if not _acts(p):
            p.effect.patch(without, p.at, p.theta)
        elif isinstance(p.effect, InReplay):
            p.effect.cleared(without, p.at)
    return patched.compile(), without.compile()


def _as_given(scene: Scene, model: mujoco.MjModel) -> list[str]:
    """Assignments that let laws see drives as the given model has them, as replays do.

    Friction by a drive's force is a share of that one, also where the drive is found to be weak.
    """
    lines = []
    for given in scene.drives:
        i = model.actuator(given.name).id
        before = ((given.gain,), given.bias)
        after = (model.actuator_gainprm[i, :1], model.actuator_biasprm[i, :3])
        for name, own, now in zip(("_gain", "_bias"), before, after, strict=True):
            changed = np.flatnonzero(np.asarray(own) != now).tolist()
            lines += [f"self.{name}[{i}, {k}] = {number(own[k])}" for k in changed]
    why = "# laws see drives as they are without what was found of them"
    return [why, *lines] if lines else []


def _acts(planted: Planted) -> bool:
    script = planted.effect.script(planted.at, planted.theta)
    return script is not None and script.acts


def _differences(one: mujoco.MjModel, other: mujoco.MjModel) -> Iterator[str]:
    """Assignments that make of one model the other, which has the same elements."""
    for name in dir(one):
        before = getattr(one, name) if not name.startswith("_") else None
        after = getattr(other, name, None)
        if not isinstance(before, np.ndarray) or not isinstance(after, np.ndarray):
            continue
        if before.shape == after.shape:
            for place in np.argwhere(before != after):
                value = number(float(after[tuple(place)]))
                yield f"model.{name}[{', '.join(map(str, place))}] = {value}"


def _template(methods: set[str]) -> str:
    """The class as text, without helpers that are not asked for."""
    source = Path(template.__file__).read_text(encoding="utf-8")
    (body,) = (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    optional = {"_base", *(name for names in HELPERS.values() for name in names)} - methods
    rows, dropped = source.splitlines(), set[int]()
    for node in body.body:
        first, last = node.lineno - 1, node.end_lineno or node.lineno
        if isinstance(node, ast.FunctionDef) and node.name in optional:
            dropped |= {first - 1, *range(first, last)}  # and the empty line before it
        elif isinstance(node, ast.AnnAssign) and ast.unparse(node.target) in optional:
            dropped |= set(range(first, last))
    kept = range(body.lineno - 1, body.end_lineno or len(rows))
    return "\n".join(rows[i] for i in kept if i not in dropped) + "\n"


def _filled(text: str, lines: dict[str, list[str]]) -> str:
    """The text with lines in the place of marks."""

    def fill(mark: re.Match[str]) -> str:
        return "".join(f"{mark[1]}{line}\n" for line in lines[mark[2]])

    return re.sub(r"^( *)# <(\w+)>\n", fill, text, flags=re.MULTILINE)


def _headed(body: str, learned: bool) -> str:
    """The whole file."""
    needs = "numpy, mujoco and onnxruntime" if learned else "numpy and mujoco"
    head = _HEAD.format(needs=needs)
    imports = "from __future__ import annotations\n\nfrom collections.abc import Callable\n"
    imports += "from pathlib import Path\nfrom typing import Any\n" if learned else ""
    imports += "\nimport mujoco\nimport numpy as np\n" + ("import onnxruntime\n" if learned else "")
    return f"{head}\n{imports}\nArray = np.ndarray\n\n\n{body}"


def _tuple(names: Sequence[str]) -> str:
    inside = ", ".join(json.dumps(name, ensure_ascii=False) for name in names)
    return f"({inside},)" if names else "()"
