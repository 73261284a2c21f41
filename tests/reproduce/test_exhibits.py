"""Every exhibit on two tasks as small as can be, by the command itself."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from registry.push import push
from registry.store import Store
from tests.toy_models import shifted
from wt.cli.main import main
from wt.config import load, to_yaml
from wt.errors import ConfigError, WorkError
from wt.evaluate import paper, probes
from wt.evaluate.results import MethodScore, Results
from wt.reproduce import bench, report
from wt.reproduce.exhibit import Exhibit, exhibits, register
from wt.reproduce.exhibits import figure_4, latent_space, online
from wt.reproduce.tasks import QUICK, TASKS
from wt.run import track
from wt.worlds.base import make

CONF = Path(__file__).resolve().parents[2] / "conf"
SMALL = [
    "data.transitions=1200", "data.validation_pairs=200", "data.test_pairs=200", "workers=1",
    "baselines.steps=5", "baselines.width=16",
    *(f"{who}.{key}" for who in ("paper", "plus") for key in (
        "mean.steps=5", "mean.width=16", "nets.width=16", "train.steps=10", "train.batch=32",
        "train.validate_every=10", "train.log_every=5",
    )),
]  # fmt: skip
NAMED = ("r5_force", "go2_payload")
OFF = 1e-5


WORLDS = {
    "r5.yaml": "{arms: 8, episode_steps: 50, motion: {routes: 2, route_seconds: 5}, threads: 1}",
    "go2_payload.yaml": "{robots: 8, episode_steps: 50, threads: 1}",
}


def store(out: Path) -> str:
    """The registry of a report's folder."""
    return f"sqlite:///{out}/mlflow.db"


def champion(out: Path, shift: float) -> None:
    """Register a model of a walking Go2: S's answer, moved by a constant."""
    config, uri = load(out / "conf" / "go2_payload.yaml"), store(out)
    spec = make(config.world).spec
    folder = shifted(out / f"model-{shift}", spec, shift, config.registry_name)
    with track.run("test", spec.task, uri=uri) as run:
        version = push(config.registry_name, folder, 0.5, run.id, uri=uri)
    Store(uri).set_alias(version, "champion")


def words(out: Path, *more: str) -> list[str]:
    tasks = [word for name in NAMED for word in ("--task", name)]
    conf = out / "conf"
    conf.mkdir(exist_ok=True)
    for name, world in WORLDS.items():
        (conf / name).write_text(
            f"base: {CONF / name}\nworld: {world}\ntracking: {{uri: '{store(out)}'}}\n"
        )
    return ["reproduce", "--quick", *tasks, "--conf", str(conf), "--out", str(out), *SMALL,
            f"data.dir={out / 'data'}", *more]  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of a report of everything."""
    folder = tmp_path_factory.mktemp("reproduce")
    words(folder)
    for name in NAMED:  # figure 3 finds finished runs: wt fit has tests of its own
        run = folder / name
        run.mkdir()
        task = next(task for task in TASKS if task.name == name)
        settings = load(
            folder / "conf" / task.config, [*QUICK, *SMALL, f"data.dir={folder / 'data'}"]
        )
        (run / "config.yaml").write_text(to_yaml(settings))
        scores = {m: MethodScore(0.1, 0.0, 0.1) for m in ("RawSim", "WorldTranslation", "RSSM")}
        Results(name, (0,), scores).save(run)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "_DPI", 30)
        patch.setattr(bench, "FEATURES_QUICK", 400)
        patch.setattr(probes, "EPOCHS", 2)
        patch.setattr(figure_4, "ROLLOUTS_QUICK", 4)
        patch.setattr(figure_4, "HORIZON", 6)
        patch.setattr(figure_4, "SHOWN", (1, 6))
        patch.setattr(figure_4, "GAINS_AT", (6,))
        patch.setattr(latent_space, "POINTS_QUICK", 40)
        patch.setattr(online, "PART_QUICK", 60)
        patch.setattr(online, "PAIRS_QUICK", 60)
        patch.setattr(online, "ADAPTING", ("online.iterations=3",))
        champion(folder, OFF)
        assert main(words(folder)) == 0
        yield folder


def found(out: Path, name: str) -> dict[str, object]:
    content: dict[str, object] = json.loads((out / "numbers" / f"{name}.json").read_text())["found"]
    return content


@pytest.mark.long
def test_every_exhibit_is_measured_and_reported(out: Path) -> None:
    text, page = (out / "report.md").read_text(), (out / "report.html").read_text()
    for exhibit in exhibits():
        assert (out / "numbers" / f"{exhibit.name}.json").is_file(), exhibit.name
        assert f"## {exhibit.title}" in text
    assert "Not run" not in text
    pictures = sorted(path.name for path in out.glob("*.png"))
    assert pictures == sorted(line.partition("](")[2][:-1] for line in text.splitlines()
                              if line.startswith("!["))  # fmt: skip
    assert page.count("<img") == len(pictures)
    assert 'src="http' not in page  # one file, no network


@pytest.mark.long
def test_the_papers_numbers_stand_beside_ours(out: Path) -> None:
    text = (out / "report.md").read_text()
    for table in (paper.HIDDEN_R2["full"], paper.DOMAIN["full"], paper.DOMAIN["w/o"]):
        for name, number in table.items():
            line = next(line for line in text.splitlines()
                        if line.startswith(f"| {name} |") and f"{number:.3g} " in line)  # fmt: skip
            assert line
    assert "| w/o cycle |" in text
    assert "0.273 | 0.004 | 0.681" in text


@pytest.mark.long
def test_variants_are_different_models(out: Path) -> None:
    errors = [values["prediction"] for values in found(out, "table-3")["ours"].values()]  # type: ignore[attr-defined]
    assert len({tuple(values) for values in errors}) == len(errors) == 4


@pytest.mark.long
def test_rollouts_have_every_method_and_horizon(out: Path) -> None:
    report = found(out, "figure-4")["go2_payload"]
    methods, shares = report["rolled"], report["shares"]
    assert set(methods) > {"RawSim", "DirectPred", "ResDyn", "RSSM", "WorldTranslation"}
    for values in methods.values():
        assert [len(row) for row in values["mse"]] == [6]  # type: ignore[index]
    # what a recording tells of where trunk and ball are, one seed
    assert shares and all(0 <= share <= 1 for (share,) in shares.values())  # type: ignore[attr-defined]


@pytest.mark.long
def test_a_registered_model_is_run_by_itself(out: Path) -> None:
    report = found(out, "registered")
    assert set(report["models"]) == {"go2_payload"}  # type: ignore[call-overload]
    one = report["models"]["go2_payload"]  # type: ignore[index]
    assert one["model"] == "wt-go2-payload/1"
    assert 0 < abs(one["mse"] - one["raw"]) < 0.1 * one["raw"]  # moved by next to nothing
    assert one["card"] is None  # measured on other pairs
    assert set(one["rollouts"]) == {"RawSim", "wt-go2-payload/1"}
    assert "no model 'wt-r5'" in (out / "report.md").read_text()


def test_without_a_registered_model_it_says_how_to_get_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(tmp_path, "--only", "registered")) == 1
    assert "'wt fit' makes one" in capsys.readouterr().err


@pytest.mark.long
def test_what_is_measured_is_not_measured_again(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (out / "report.md").read_text()
    for exhibit in exhibits():
        monkeypatch.setattr(type(exhibit), "measure", lambda *_: pytest.fail("measured again"))
    assert main(words(out)) == 0
    assert (out / "report.md").read_text() == before
    assert str(out / "report.html") in capsys.readouterr().out


@pytest.mark.long
def test_a_report_of_one_exhibit_says_how_to_get_the_others(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(exhibits(["table-1"])[0]), "measure", lambda *_: found(out, "table-1"))
    assert main(words(tmp_path, "--only", "table-1")) == 0
    text = (tmp_path / "report.md").read_text()
    assert "Not run: wt reproduce --only figure-4 does it." in text
    assert "## The hidden variable in representations (table I)" in text


def test_exhibits_whose_tasks_are_not_chosen_are_left_out(tmp_path: Path) -> None:
    flat = ["reproduce", "--task", "go2_flat", "--only", "table-1", "--conf", str(CONF)]
    assert main([*flat, "--out", str(tmp_path)]) == 0
    assert "it needs r5_force" in (tmp_path / "report.md").read_text()


def test_a_wrong_name_is_told_the_nearest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["reproduce", "--only", "tabel-1", "--out", str(tmp_path), "--conf", str(CONF)]) == 2
    )
    assert "did you mean 'table-1'" in capsys.readouterr().err


@pytest.mark.long
def test_a_damaged_result_is_refused(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = out / "numbers" / "table-2.json"
    whole = path.read_text()
    path.write_text(whole[:100])
    try:
        assert main(words(out)) == 2
        assert "delete it and run again" in capsys.readouterr().err
    finally:
        path.write_text(whole)


@pytest.mark.long
def test_an_exhibit_that_fails_leaves_the_others(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = out / "numbers" / "table-3.json"
    whole = kept.read_text()
    kept.unlink()

    def diverge(*_: object) -> None:
        raise WorkError("training diverged at step 7")

    monkeypatch.setattr(type(exhibits(["table-3"])[0]), "measure", diverge)
    try:
        assert main(words(out)) == 1
    finally:
        kept.write_text(whole)
    assert "table-3: training diverged at step 7" in capsys.readouterr().err
    text = (out / "report.md").read_text()
    assert "Not run: training diverged at step 7." in text
    assert "| (o, a)S, zS→R |" in text


def test_a_name_used_twice_is_refused_with_both_files() -> None:
    known = type(exhibits(["table-1"])[0])
    copy: type[Exhibit] = type("Copy", (known,), {"__module__": "elsewhere"})
    with pytest.raises(ConfigError, match=r"exhibits\.table_1 and elsewhere"):
        register(copy)
