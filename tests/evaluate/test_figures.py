"""The figures show the numbers they were given, and can be drawn without a screen."""

import io
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wt.evaluate import figures
from wt.evaluate.results import MethodScore, Results
from wt.show import colors
from wt.types import Channel

CHANNELS = (Channel("qpos/a", "rad"), Channel("qvel/a", "rad/s"), Channel("qpos/b", "rad"))


def draw(figure: Figure) -> None:
    """Render the figure: layout and text are only worked out then."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=40)
    assert buffer.getvalue().startswith(b"\x89PNG")


def scores() -> dict[str, MethodScore]:
    """Three methods and one that diverged."""
    nan = float("nan")
    return {
        "RawSim": MethodScore(0.7, 0.1, 0.8),
        "WorldTranslationPlus": MethodScore(0.2, 0.05, 0.3),
        "ResDyn": MethodScore(nan, nan, nan),
        "RSSM": MethodScore(0.5, 0.0, 0.6),
    }


def test_bar_table_shows_each_mse_smallest_first_with_the_papers() -> None:
    figure = figures.bar_table(Results("r5_force", (0, 1), scores()))
    draw(figure)
    (axes,) = figure.axes
    widths = [p.get_width() for p in axes.patches if isinstance(p, Rectangle)]
    # in units of RawSim's error, so that the paper's world and ours can share an axis
    assert widths == pytest.approx([0.2 / 0.7, 0.5 / 0.7, 1.0, 0.0])
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["WorldTranslationPlus", "RSSM", "RawSim", "ResDyn"]
    texts = [text.get_text() for text in axes.texts]
    assert texts == [
        "0.2 ± 0.05; change 0.3", "0.5 ± 0; change 0.6", "0.7 ± 0.1; change 0.8", "diverged",
    ]  # fmt: skip
    diamonds = next(line for line in axes.lines if line.get_label() == "in the paper")
    points = np.asarray(diamonds.get_xydata())
    assert points[:, 1].tolist() == [1, 2, 3]
    assert points[:, 0] == pytest.approx([0.515493 / 0.706230, 1.0, 0.762682 / 0.706230])


def test_bar_table_of_a_task_the_paper_lacks_has_no_diamonds() -> None:
    figure = figures.bar_table(Results("so101", (0,), scores()))
    draw(figure)
    assert "in the paper" not in [line.get_label() for line in figure.axes[0].lines]


def test_per_channel_has_a_panel_a_unit() -> None:
    rmse = {"RawSim": np.array([0.1, 1.0, 0.2]), "RSSM": np.array([0.3, 2.0, 0.4])}
    figure = figures.per_channel(rmse, CHANNELS)
    draw(figure)
    above, below = figure.axes
    assert (above.get_ylabel(), below.get_ylabel()) == ("RMSE [rad]", "RMSE [rad/s]")
    assert [label.get_text() for label in above.get_xticklabels()] == ["qpos\na", "qpos\nb"]
    shown = {line.get_label(): np.asarray(line.get_ydata()).tolist() for line in above.lines}
    assert shown["RawSim"] == [0.1, 0.2]
    assert shown["RSSM"] == [0.3, 0.4]


def test_prediction_trace_shows_values_above_and_errors_below() -> None:
    t = np.arange(4) / 50
    real = np.array([0.0, 1.0, 2.0, 3.0])
    figure = figures.prediction_trace(t, real, {"RawSim": real + 0.5}, CHANNELS[0])
    draw(figure)
    above, below = figure.axes
    assert above.get_ylabel() == "qpos/a [rad]"
    assert [line.get_label() for line in above.lines] == ["real", "RawSim"]
    assert np.asarray(below.lines[0].get_ydata()).tolist() == [0.5] * 4


def test_latent_picture_shows_translated_over_r() -> None:
    rng = np.random.default_rng(0)
    s, r = rng.normal(size=(5000, 2)), rng.normal(size=(300, 2)) + 20.0
    figure = figures.latent_picture(s, s + 20.0, r, "PCA")
    draw(figure)
    before, after = (
        {str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.lines}
        for axes in figure.axes
    )
    assert np.array_equal(before["R"], after["R"])
    assert np.allclose(after["S translated"] - before["S"], 20.0)
    assert len(before["S"]) <= 2000
    assert figure.axes[0].get_xlabel() == "PCA 1"


def test_curves_keep_a_methods_colour_and_tell_its_lines_apart() -> None:
    x = np.arange(5.0)
    lines = {name: (x, x + 1.0) for name in ("RawSim", "RSSM", "RSSM, adapting", "another")}
    figure = figures.curves([("error", lines), ("again", lines)], "step")
    draw(figure)
    drawn = {str(line.get_label()): line for line in figure.axes[0].lines}
    assert drawn["RSSM"].get_color() == drawn["RSSM, adapting"].get_color()
    assert drawn["RSSM"].get_linestyle() != drawn["RSSM, adapting"].get_linestyle()
    assert drawn["RawSim"].get_color() != drawn["another"].get_color()
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["error", "again"]


def test_one_line_far_above_does_not_flatten_the_others() -> None:
    x = np.arange(5.0)
    lines = {"a": (x, x), "b": (x, x), "c": (x, 1e6 * x)}
    tops = [figures.curves([("error", lines)], "step", zoom=z).axes[0].get_ylim()[1]
            for z in (False, True)]  # fmt: skip
    assert tops[0] > 1e6
    assert 4.0 < tops[1] < 10.0


def test_every_method_of_the_table_has_its_own_colour() -> None:
    methods = (
        "WorldTranslation", "WorldTranslationPlus", "RawSim", "DirectPred", "ResDyn", "ResDynSim",
        "RSSM", "MeanShiftOT", "DeltaAction", "FlowTranslation", "SimulatorEncoder",
        "PairedCeiling", "SomethingElse",
    )  # fmt: skip
    assert len({colors.of_method(method) for method in methods}) == len(methods)


def test_no_global_plotting_state() -> None:
    code = "import sys, wt.evaluate.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
