"""Features in two dimensions, for the eye: UMAP where it is installed, else t-SNE, or PCA."""

from __future__ import annotations

import importlib.util
import warnings
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float
from sklearn.decomposition import PCA
from sklearn.manifold import TSNE

from wt.errors import ConfigError

Embedding = Literal["umap", "tsne", "pca"]
"""``umap`` needs the extra ``report``; the others come with scikit-learn."""

NAMES = {"umap": "UMAP", "tsne": "t-SNE", "pca": "PCA"}


def best_embedding() -> Embedding:
    """The paper's UMAP if it is installed, else t-SNE."""
    return "umap" if importlib.util.find_spec("umap") else "tsne"


def embed(
    points: Float[np.ndarray, "point channel"], kind: Embedding, seed: int
) -> Float[np.ndarray, "point plane=2"]:
    """Points in the plane; all in one picture, so that they compare.

    Args:
        points: what is shown.
        kind: how.
        seed: same seed, same picture.

    Raises:
        ConfigError: UMAP is asked for and not installed.
    """
    if kind not in get_args(Embedding):
        raise ConfigError(f"embedding {kind!r} is none of {', '.join(get_args(Embedding))}")
    if kind == "pca":
        return np.asarray(PCA(2, random_state=seed).fit_transform(points))
    if kind == "tsne":
        perplexity = min(30.0, (len(points) - 1) / 3)
        return np.asarray(
            TSNE(2, perplexity=perplexity, init="pca", random_state=seed).fit_transform(points)
        )
    try:
        import umap
    except ImportError as error:
        raise ConfigError("UMAP is not installed: pip install '.[report]', or take tsne") from error
    with warnings.catch_warnings():
        # a seed makes UMAP use one thread, which it says each time
        warnings.filterwarnings("ignore", message=".*n_jobs value")
        return np.asarray(umap.UMAP(random_state=seed).fit_transform(points))
