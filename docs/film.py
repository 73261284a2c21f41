"""The moving picture of the README: recorded, simulated before, simulated after.

``python docs/film.py MODEL.xml PATCHED.xml RECORDING.parquet OUT.gif``, for a machine of one joint
that swings about y. Both models are stepped by plain MuJoCo under the recorded commands alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter

from wt.data import recording
from wt.types import Recording

FRAMES, LARGER = 72, 8.0
"""Number of pictures, and how many times larger than they are errors are drawn on the machine."""
COLORS = {"recorded": "#1d2126", "model as given": "#d55e00", "patched model": "#0072b2"}


def replay(path: Path, recorded: Recording, joint: str) -> np.ndarray:
    """Positions (time,) [rad] of a joint under the recorded commands."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    commands = np.stack([recorded.columns[f"ctrl/{model.actuator(i).name}"]
                         for i in range(model.nu)], axis=1)  # fmt: skip
    for other in range(model.njnt):  # joints that a patch added move along
        data.qpos[other] = recorded.columns[f"qpos/{joint}"][0]
    out, address = np.empty(len(recorded.t)), model.joint(joint).qposadr[0]
    for k, t in enumerate(recorded.t):
        while data.time < t - 1e-9:
            mujoco.mj_step(model, data)
        out[k] = data.qpos[address]
        data.ctrl[:] = commands[k]
    return out


def film(given: Path, patched: Path, take: Path, out: Path) -> None:
    """Write the picture."""
    recorded = recording.read(take)
    joint = next(c.removeprefix("qpos/") for c in recorded.columns if c.startswith("qpos/"))
    truth = recorded.columns[f"qpos/{joint}"]
    paths = {"recorded": truth, "model as given": replay(given, recorded, joint),
             "patched model": replay(patched, recorded, joint)}  # fmt: skip
    figure, (machine, errors) = plt.subplots(
        1, 2, figsize=(7.2, 2.7), width_ratios=(1, 2.2), layout="constrained"
    )
    machine.set(xlim=(-0.36, 0.36), ylim=(-0.38, 0.06), aspect="equal", xticks=[], yticks=[])
    machine.set_title(f"errors × {LARGER:g}", fontsize=9, color="#5c6570")
    machine.spines[:].set_visible(False)
    rods, lines = {}, {}
    for name in paths:
        rods[name] = machine.plot([], [], "-o", color=COLORS[name], lw=3, ms=7, alpha=0.8)[0]
        if name != "recorded":
            lines[name] = errors.plot([], [], color=COLORS[name], lw=1.3, label=name)[0]
    errors.plot([], [], color=COLORS["recorded"], lw=3, label="recorded")  # a rod alone
    most = 1.1e3 * np.abs(paths["model as given"] - truth).max()
    errors.set(xlim=recorded.t[[0, -1]], ylim=(-most, most), xlabel="time [s]",
               ylabel="error of replay [mrad]")  # fmt: skip
    errors.legend(fontsize=8, loc="upper right", frameon=False)
    errors.spines[["top", "right"]].set_visible(False)
    rows = np.linspace(0, len(truth) - 1, FRAMES).astype(int)

    def draw(row: int) -> None:
        for name, path in paths.items():
            angle = truth[row] + LARGER * (path[row] - truth[row])
            rods[name].set_data([0, -0.3 * np.sin(angle)], [0, -0.3 * np.cos(angle)])
            if name in lines:
                lines[name].set_data(recorded.t[:row], 1e3 * (path - truth)[:row])

    figure.canvas.draw()
    figure.set_layout_engine("none")  # what was laid out once stays, and is quick to draw
    moving = FuncAnimation(figure, draw, frames=rows)
    moving.save(out, PillowWriter(fps=9), dpi=80)


if __name__ == "__main__":
    film(*map(Path, sys.argv[1:5]))
