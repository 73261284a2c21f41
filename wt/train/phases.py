"""The losses of Algorithm 1, one function a phase; each returns its loss and its metrics.

The phases only compute; who trains steps the optimizers. Batches hold S first, R second; ``noise``
rows are those of the reparametrisation z = μ + σ ε.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from jaxtyping import Float
from torch import Tensor

from wt.losses import gan, vae
from wt.nets.translator import Translator
from wt.nets.world_model import WorldModel
from wt.train.batches import DomainData, StepBatch
from wt.train.segments import segment_error

Metrics = dict[str, Tensor]

ACTIVE = 0.01
"""Variance of a latent's posterior mean above which it is active (Burda et al. 2016)."""


def sample(
    mean: Float[Tensor, "batch latent"],
    log_variance: Float[Tensor, "batch latent"],
    noise: Float[Tensor, "batch latent"],
) -> Float[Tensor, "batch latent"]:
    """Z ~ N(μ, diag σ²), reparametrised."""
    return mean + torch.exp(0.5 * log_variance) * noise


def iteration(model: WorldModel, batch: StepBatch, metrics: Metrics) -> Iterator[Tensor]:
    """One iteration of Algorithm 1's loop: the losses of its four updates, in their order.

    Each update is made before the next loss is asked for, which is of the networks as they then
    are.

    Args:
        model: the networks.
        batch: data and noise.
        metrics: filled with those of each phase as it is computed.
    """
    # Backward Dynamics Extraction: update φ, θ, ξ, then ψ with z detached
    loss, more, z = extraction(model, batch)
    metrics |= more
    if batch.segment is not None:
        metrics["vae/segment"] = along = segment_error(model, batch.segment)
        loss = loss + model.method.train.segment_weight * along
    yield loss
    loss, more = blind(model, batch, z)
    metrics |= more
    yield loss
    # Unpaired Domain Translation: update both generators, then both discriminators
    z_sim, z_real = encode(model, batch)
    loss, more, fakes = generators(model, batch.gan, z_sim, z_real)
    metrics |= more
    yield loss
    loss, more = discriminators(model, batch.gan, z_sim, z_real, fakes)
    metrics |= more
    yield loss


def extraction(model: WorldModel, batch: StepBatch) -> tuple[Tensor, Metrics, Tensor]:
    """L_VAE on both domains together (equation "vae_loss"): trains E_φ, D_θ and C_ξ.

    Returns:
        Loss, metrics, and the sampled z of S and R stacked, (2 · batch, latent).
    """
    weights = model.method.vae
    sim, real = batch.vae
    x, y = torch.cat([sim.x, real.x]), torch.cat([sim.y, real.y])
    s_next = torch.cat([sim.s_next, real.s_next])
    mean, log_variance = model.encoder(x, y)
    z = sample(mean, log_variance, batch.noise[:2].flatten(0, 1))
    logits = model.classifier(z)
    n = len(sim.x)
    reconstruction = vae.reconstruction(y, model.decoder(x, z))
    kl = vae.kl_divergence(mean, log_variance)
    blind = vae.blind_penalty(s_next, model.blind(z), weights.blind_temperature)
    domain = vae.domain_classification(logits[:n], logits[n:])
    loss = (
        reconstruction
        + weights.beta * kl
        + weights.blind_weight * blind
        + weights.classifier_weight * domain
    )
    right = (logits[:n] < 0).float().mean() + (logits[n:] > 0).float().mean()
    metrics = {
        "vae/reconstruction": reconstruction,
        "vae/kl": kl,
        "vae/blind_penalty": blind,
        "vae/domain_bce": domain,
        "vae/domain_accuracy": 0.5 * right,
        "latent/mean_norm": mean.norm(dim=-1).mean(),
        "latent/active_std": mean.std(dim=0).mean(),
        "latent/active": (mean.var(dim=0) > ACTIVE).float().sum(),
        "latent/noise_std": torch.exp(0.5 * log_variance).mean(),
    }
    return loss, metrics, z


def blind(model: WorldModel, batch: StepBatch, z: Tensor) -> tuple[Tensor, Metrics]:
    """‖o′ − õ′‖² with z detached: trains D_ψ."""
    s_next = torch.cat([d.s_next for d in batch.vae])
    loss = vae.reconstruction(s_next, model.blind(z.detach()))
    return loss, {"vae/blind_error": loss}


@torch.no_grad()
def encode(model: WorldModel, batch: StepBatch) -> tuple[Tensor, Tensor]:
    """z^S and z^R of the translation batch; the encoder is not trained by translation."""
    z = [
        sample(mean, log_variance, noise)
        for d, noise in zip(batch.gan, batch.noise[2:], strict=True)
        for mean, log_variance in [model.encoder(d.x, d.y)]
    ]
    return z[0], z[1]


def generators(
    model: Translator, data: tuple[DomainData, DomainData], z_sim: Tensor, z_real: Tensor
) -> tuple[Tensor, Metrics, tuple[Tensor, Tensor]]:
    """L_adv + λ_cyc L_cyc + λ_id L_id: trains G_{S→R} and G_{R→S}.

    Returns:
        Loss, metrics, and the translated features (ẑ^R from S, ẑ^S from R).
    """
    settings = model.method.translation
    kind = settings.adversarial
    x_sim, x_real = data[0].x, data[1].x
    fake_real, fake_sim = model.to_real(z_sim, x_sim), model.to_sim(z_real, x_real)
    adversarial = gan.generator(kind, model.discriminator_real(fake_real, x_sim))
    adversarial = adversarial + gan.generator(kind, model.discriminator_sim(fake_sim, x_real))
    cycle = gan.distance(z_sim, model.to_sim(fake_real, x_sim))
    cycle = cycle + gan.distance(z_real, model.to_real(fake_sim, x_real))
    loss = adversarial + settings.cycle * cycle
    metrics = {"gan/generator": adversarial, "gan/cycle": cycle}
    if settings.identity:
        identity = gan.distance(z_real, model.to_real(z_real, x_real))
        identity = identity + gan.distance(z_sim, model.to_sim(z_sim, x_sim))
        loss = loss + settings.identity * identity
        metrics["gan/identity"] = identity
    return loss, metrics, (fake_real, fake_sim)


def discriminators(
    model: Translator,
    data: tuple[DomainData, DomainData],
    z_sim: Tensor,
    z_real: Tensor,
    fakes: tuple[Tensor, Tensor],
) -> tuple[Tensor, Metrics]:
    """−E[log D(z)] − E[log(1 − D(ẑ))], or least squares: trains D_S and D_R."""
    kind = model.method.translation.adversarial
    x_sim, x_real = data[0].x, data[1].x
    fake_real, fake_sim = fakes[0].detach(), fakes[1].detach()
    real = model.discriminator_real(z_real, x_real), model.discriminator_real(fake_real, x_sim)
    sim = model.discriminator_sim(z_sim, x_sim), model.discriminator_sim(fake_sim, x_real)
    loss = gan.discriminator(kind, *real) + gan.discriminator(kind, *sim)
    accuracy = 0.5 * (gan.accuracy(kind, *real) + gan.accuracy(kind, *sim))
    return loss, {"gan/discriminator": loss, "gan/accuracy": accuracy}
