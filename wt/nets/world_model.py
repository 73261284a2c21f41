"""All networks of World Translation together; what is trained, saved and exported."""

from __future__ import annotations

import copy
from typing import Any

from torch import Tensor, nn

from wt.config import Method
from wt.nets.blind_decoder import BlindDecoder
from wt.nets.classifier import DomainClassifier
from wt.nets.encoder import Encoder
from wt.nets.film_decoder import ConcatDecoder, FiLMDecoder
from wt.nets.frame import Frame
from wt.nets.translator import Translator
from wt.types import TransitionSpec


class WorldModel(Translator):
    """Encoder, decoders, classifier and, as a translator, generators in the frame of one task.

    Attributes:
        frame: normalisation and mean field.
        encoder: E_φ.
        decoder: D_θ.
        blind: D_ψ.
        classifier: C_ξ.
        strength: share of the translation that is applied, as model selection chose it; 1 for
            the paper's model.
    """

    def __init__(self, spec: TransitionSpec, method: Method) -> None:
        """Build the networks.

        Args:
            spec: layout of the task's transitions.
            method: sizes and variants.
        """
        super().__init__()
        self.spec = spec
        nets, condition = method.nets, spec.n_obs + spec.n_action
        latent, width, depth = nets.latent, nets.width, nets.depth
        self.frame = Frame(spec, method.mean)
        self.encoder = Encoder(condition, spec.n_state, latent, width, depth)
        decoder = FiLMDecoder if nets.film else ConcatDecoder
        self.decoder = decoder(condition, spec.n_state, latent, width, depth)
        self.blind = BlindDecoder(latent, spec.n_state, width, depth)
        self.classifier = DomainClassifier(latent, width, 2)
        self._translating(latent, condition if method.translation.conditioned else 0, method)
        self.strength = nn.Parameter(nn.init.ones_(nn.Parameter().new_empty(())), False)

    def with_generator(self, generator: nn.Module) -> WorldModel:
        """The same model with another G_{S→R}, sharing all else."""
        other = copy.copy(self)
        other._modules = {**self._modules, "to_real": generator}
        return other

    def untranslated(self) -> WorldModel:
        """The same model, which decodes S's features as they are."""
        return self.with_generator(_Unchanged())

    def _load_from_state_dict(
        self,
        state_dict: dict[str, Tensor],
        prefix: str,
        *args: Any,  # noqa: ANN401 – torch's signature
    ) -> None:
        # checkpoints of earlier versions call discriminators judges; their runs go on
        for key in [key for key in state_dict if key.startswith(f"{prefix}judge_")]:
            state_dict[key.replace("judge_", "discriminator_", 1)] = state_dict.pop(key)
        super()._load_from_state_dict(state_dict, prefix, *args)


class _Unchanged(nn.Module):
    """Stands in a generator's place where nothing is to be translated."""

    def forward(self, z: Tensor, x: Tensor) -> Tensor:
        """The feature as it is."""
        return z
