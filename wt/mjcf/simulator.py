"""``wt.Simulator``: a written diagnosis as something to step, with all that was found."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from wt.errors import UserError


class Simulator:
    """``model.xml`` of a diagnosis, with ``physics.py`` where there is one (which is run).

    Attributes:
        model: the compiled model; changes of it count from the next step on.
        data: its state; likewise.
        physics: what MJCF cannot say; None if it says it all.
    """

    def __init__(self, folder: str | Path) -> None:
        """Load the folder that ``wt diagnose --out`` wrote.

        Raises:
            UserError: it is no such folder, or its files cannot be loaded.
        """
        path, script = Path(folder) / "model.xml", Path(folder) / "physics.py"
        if not path.is_file():
            raise UserError(f"'{folder}' has no model.xml; give what wt diagnose --out wrote")
        try:
            self.model = mujoco.MjModel.from_xml_path(str(path))
            self.physics = _loaded(script, self.model) if script.is_file() else None
        except Exception as error:  # physics.py may raise anything
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise UserError(f"'{folder}' does not load: {reason}") from error
        self.data = mujoco.MjData(self.model)
        self.reset()

    def reset(self, keyframe: int | None = None) -> None:
        """Begin anew, at a keyframe or as the model stands, with what is hidden in balance."""
        if keyframe is None:
            mujoco.mj_resetData(self.model, self.data)
        else:
            mujoco.mj_resetDataKeyframe(self.model, self.data, keyframe)
        self.settle()

    def settle(self) -> None:
        """Let what is hidden come into balance with positions and commands that were set."""
        if self.physics is not None:
            self.physics.reset(self.data)
        mujoco.mj_forward(self.model, self.data)

    def step(self, command: Float[np.ndarray, " actuator"] | None = None) -> None:
        """One physics step under a command, or under the one before."""
        if command is not None:
            self.data.ctrl[:] = command
        if self.physics is None:
            mujoco.mj_step(self.model, self.data)
        else:
            self.physics.step(self.data)


def _loaded(path: Path, model: mujoco.MjModel) -> Any:  # noqa: ANN401 – what the file says
    spec = importlib.util.spec_from_file_location("physics", path)
    if spec is None or spec.loader is None:
        raise UserError(f"'{path}' is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Physics(model)
