from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.baselines.toy import REAL, SIM, Toy
from wt.config import Mean, Method, Nets
from wt.evaluate.embedding import best_embedding, embed
from wt.evaluate.probes import (
    Split,
    condition_accuracy,
    domain_table,
    hidden_baseline,
    hidden_table,
)
from wt.evaluate.representation import Features, features, whole_episodes
from wt.nets.frame import Frame
from wt.nets.world_model import WorldModel
from wt.train.mean_field import fit_normalizers
from wt.types import Domain

N, LATENT = 1200, 3


def seen(domain: Domain, shift: float, across: float, leak: float = 0.0) -> Features:
    """Features of a domain at ``shift``; translation adds ``across``; z holds the hidden size."""
    rng = np.random.default_rng(len(domain))
    z = rng.normal(size=(N, LATENT))
    hidden = np.abs(z[:, :1]) * (3.0, 0.0, 4.0)
    z[:, 1] += shift
    moved = z + across * np.eye(LATENT)[1]
    side = leak if domain == "real" else -leak
    condition = rng.normal(size=(N, 2)) + side
    return Features(
        domain, condition, rng.normal(size=(N, 2)), z, moved, z, z, hidden,
        episode=np.arange(N) // 50,
    )  # fmt: skip


def test_a_probe_finds_what_z_holds_and_nothing_in_noise() -> None:
    sim, real = seen("sim", 0.0, 10.0), seen("real", 10.0, -10.0)
    table = hidden_table(sim, real, 0)
    assert len(table) == 6
    assert min(table.values()) > 0.8  # a shift along another axis keeps it
    assert max(hidden_baseline(sim, real, 0).values()) < 0.1


def test_translated_features_pass_for_the_other_domain() -> None:
    table = domain_table(seen("sim", 0.0, 10.0), seen("real", 10.0, -10.0), 0)
    assert table["zS"] > 0.99
    assert table["zS→R"] > 0.99
    assert table["(o, a)R, zR→S"] > 0.99
    assert 0.4 < table["(o, a)S"] < 0.6


def test_what_is_not_translated_does_not_pass() -> None:
    table = domain_table(seen("sim", 0.0, 0.0), seen("real", 10.0, 0.0), 0)
    assert table["zS→R"] < 0.01
    # beside (o, a) that give the domain away neither
    leaking = domain_table(seen("sim", 0.0, 0.0, 3.0), seen("real", 0.0, 0.0, 3.0), 0)
    assert leaking["(o, a)S"] > 0.95
    assert leaking["(o, a)S, zS→R"] < 0.05


def test_conditions_tell_domains_that_act_differently() -> None:
    toy = Toy(0.0)
    sim, real = toy.collect(SIM, 20, 1), toy.collect(REAL, 20, 2)
    frame = Frame(toy.spec, Mean())
    fit_normalizers(frame, sim, real)
    assert condition_accuracy(frame, sim, sim, 0) == pytest.approx(0.5, abs=0.1)
    other = replace(real, a=real.a + 2.0)
    assert condition_accuracy(frame, sim, other, 0) > 0.9


def test_no_episode_is_on_both_sides() -> None:
    episode = np.repeat([7, 8, 9], 10)
    split = Split.of(episode)
    assert not set(episode[split.train]) & set(episode[split.test])
    alone = Split.of(np.zeros(10, int))
    assert (alone.train.sum(), alone.test.sum()) == (5, 5)


def test_errors_of_table_3_are_what_they_say() -> None:
    toy = Toy(0.0)
    sim, real = toy.collect(SIM, 2, 1), toy.collect(REAL, 2, 2)
    model = WorldModel(toy.spec, Method(nets=Nets(latent=4, width=8, depth=1))).eval()
    fit_normalizers(model.frame, sim, real)
    with torch.no_grad():  # G_{S→R}(z) = z + 0.5, G_{R→S}(z) = z − 0.2
        model.to_real.net[-1].bias.fill_(0.5)
        model.to_sim.net[-1].bias.fill_(-0.2)
    s, r = features(model, sim, real)
    assert s.cycle_error == pytest.approx(0.3, abs=1e-6)
    assert r.identity_error == pytest.approx(0.5, abs=1e-6)
    assert s.identity_error == pytest.approx(0.2, abs=1e-6)
    assert np.allclose(r.across, r.z - 0.2, atol=1e-6)


def test_some_takes_whole_episodes() -> None:
    data = Toy(0.0).collect(SIM, 5, 1)  # 60 transitions each
    assert len(whole_episodes(data, 150)) == 120
    assert whole_episodes(data, 1000) is data


def test_pca_keeps_distances_of_what_is_flat_already() -> None:
    flat = np.random.default_rng(0).normal(size=(40, 2))
    points = flat @ np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0][:2]
    plane = embed(points, "pca", 0)
    between = np.linalg.norm(plane[:, None] - plane[None], axis=2)
    assert np.allclose(between, np.linalg.norm(flat[:, None] - flat[None], axis=2))


def test_tsne_keeps_clusters_apart_and_is_repeatable() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(size=(30, 5)), rng.normal(size=(30, 5)) + 30.0])
    plane = embed(points, "tsne", 3)
    within = np.linalg.norm(plane[:30] - plane[:30].mean(axis=0), axis=1).mean()
    assert np.linalg.norm(plane[:30].mean(axis=0) - plane[30:].mean(axis=0)) > 2 * within
    assert np.array_equal(plane, embed(points, "tsne", 3))
    assert best_embedding() in ("umap", "tsne")
