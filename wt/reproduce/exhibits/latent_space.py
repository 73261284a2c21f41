"""The latent space before and after translation, for the eye (the paper's UMAP figure)."""

from __future__ import annotations

import numpy as np

from wt.evaluate.embedding import NAMES, best_embedding, embed
from wt.evaluate.figures import latent_picture
from wt.reproduce.bench import FULL, Bench
from wt.reproduce.exhibit import Exhibit, Numbers, Section, register

POINTS, POINTS_QUICK = 1500, 400
"""Features of each kind that are drawn: more hide each other."""


@register
class LatentSpace(Exhibit):
    """Features of S, of S translated and of R in one plane."""

    name = "latent-space"
    order = 50
    title = "The latent space before and after translation"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Embed all three kinds together, of the model of the first seed."""
        study = bench.study("r5_force")
        bench.train(study, [FULL])
        seed = study.config.seeds[0]
        sim, real = bench.features(study, FULL, seed)
        count = POINTS_QUICK if bench.quick else POINTS
        rng = np.random.default_rng(seed)
        rows = [rng.permutation(len(data.z))[:count] for data in (sim, real)]
        kinds = {"s": sim.z[rows[0]], "translated": sim.across[rows[0]], "r": real.z[rows[1]]}
        how = best_embedding()
        plane = embed(np.concatenate(list(kinds.values())), how, seed)
        ends = np.cumsum([len(z) for z in kinds.values()])[:-1]
        parts = dict(zip(kinds, np.split(plane, ends), strict=True))
        centres = {name: z.mean(axis=0) for name, z in kinds.items()}
        apart = {
            name: float(np.linalg.norm(centres[name] - centres["r"]))
            for name in ("s", "translated")
        }
        points = {name: np.round(part.astype(float), 3).tolist() for name, part in parts.items()}
        return {"embedding": how, "points": points, "apart": apart}

    def present(self, numbers: Numbers) -> Section:
        """The picture, and how far apart the centres lie."""
        parts = {name: np.array(points) for name, points in numbers["points"].items()}
        axis = NAMES[numbers["embedding"]]
        drawn = latent_picture(parts["s"], parts["translated"], parts["r"], axis)
        apart = numbers["apart"]
        line = (
            f"The centre of S's features lies {apart['s']:.2f} from that of R's, after translation "
            f"{apart['translated']:.2f}"
        )
        how = "" if numbers["embedding"] == "umap" else (
            f" {axis}, since UMAP is not installed (pip install '.[report]')."
        )  # fmt: skip
        return Section(
            "Dynamics features of the R5 under forces. Left as encoded, right with S's translated "
            f"to R; one plane for all.{how}",
            figures={"latent_space": drawn},
            differences=[
                line
                + (": as in the paper, they are apart before and together after."
                   if apart["translated"] < 0.5 * apart["s"] else
                   ": other than in the paper, translation hardly moves the centre.")
            ],
        )  # fmt: skip
