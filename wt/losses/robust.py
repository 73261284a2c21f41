"""Regression towards the most frequent answer instead of the average one."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def cauchy(error: Float[Tensor, "batch channel"], width: float) -> Float[Tensor, ""]:
    """Negative log likelihood of a Cauchy-shaped error vector, up to a constant.

    A hidden variable that is often absent leaves an atom in p(o′ | o, a): the transitions in
    which it does nothing. Least squares averages over all of them; this loss, whose pull falls
    as 1 / r, settles on the atom. It needs no annealing: over widths of 0.02 … 0.1 it found the
    same answer on an arm that is pushed 37 % of the time, where losses whose pull vanishes
    altogether (Geman-McClure) and the L1 norm got stuck.

    Args:
        error: normalised error of each channel.
        width: root-mean-square error over channels up to which it acts like least squares.
    """
    # log(1 + r² / w²), r² the mean square over channels
    return torch.log1p((error**2).mean(-1) / width**2).mean()
