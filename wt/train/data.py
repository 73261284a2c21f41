"""The data of a training as Lightning takes it: loaders of training, validation and test."""

from __future__ import annotations

from collections.abc import Iterator

import lightning
import torch
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, TensorDataset

from wt.train.batches import Drawn, StepBatch, StepBatches
from wt.train.score import CHUNK
from wt.train.segments import Segments
from wt.train.selection import Selection
from wt.types import Pairs


class TranslationData(lightning.LightningDataModule):
    """Unpaired transitions that are trained on, and held-out data that choose.

    A batch of training is a pure function of the seed and the step; where several
    processes train together, each takes its share of the rows of every batch.

    Attributes:
        validation: what chooses, the checkpoint too if it tells them; nothing is trained on it.
        test: pairs that neither train nor choose; None where there are none.
    """

    def __init__(
        self,
        sim: Drawn,
        real: Drawn,
        validation: Selection,
        *,
        batch: int,
        latent: int,
        seed: int,
        segments: Segments | None = None,
        test: Pairs | None = None,
    ) -> None:
        """Keep references.

        Args:
            sim: transitions of S in the frame of the model.
            real: transitions of R.
            validation: held-out data.
            batch: transitions per domain and step, of all processes together.
            latent: size of z, for the noise.
            seed: same seed, same batches.
            segments: where training is on segments too.
            test: pairs for ``Trainer.test``.
        """
        super().__init__()
        self._train = sim, real, batch, latent, seed, segments
        self.validation, self.test = validation, test

    def train_dataloader(self) -> DataLoader[StepBatch]:
        """Endless batches, from the step on that is next."""
        trainer = self.trainer
        if trainer is None:
            raise RuntimeError("a trainer says which step is next: give this to Trainer.fit")
        batches = StepBatches(*self._train, part=(trainer.global_rank, trainer.world_size))
        return DataLoader(_FromStep(batches, trainer), batch_size=None, collate_fn=_as_it_is)

    def val_dataloader(self) -> DataLoader[Selection]:
        """What is held out, as one batch; every process sees all, and so chooses the same."""
        return DataLoader([self.validation], batch_size=None, collate_fn=_as_it_is)  # type: ignore[arg-type]

    def test_dataloader(self) -> DataLoader[tuple[Tensor, ...]]:
        """The pairs in order: observations, actions, and the next states of S and of R."""
        if self.test is None:
            raise RuntimeError("these data have no test pairs: make them with test=Pairs(…)")
        real, sim_next = self.test.real, self.test.sim_next
        columns = (torch.tensor(x, device="cpu") for x in (real.o, real.a, sim_next, real.s_next))
        return DataLoader(TensorDataset(*columns), batch_size=CHUNK)

    def to(self, device: torch.device) -> TranslationData:
        """The same data on another device."""
        sim, real, batch, latent, seed, segments = self._train
        return TranslationData(
            sim.to(device),
            real.to(device),
            self.validation,
            batch=batch,
            latent=latent,
            seed=seed,
            segments=segments and segments.to(device),
            test=self.test,
        )


class _FromStep(IterableDataset[StepBatch]):
    """Starts at the trainer's step whenever it is asked anew, also after resume.

    Lightning fetches a batch past an epoch's end, and asks anew when the next begins.
    """

    def __init__(self, batches: StepBatches, trainer: lightning.Trainer) -> None:
        self._batches, self._trainer = batches, trainer

    def __iter__(self) -> Iterator[StepBatch]:
        self._batches.next_step = self._trainer.global_step
        yield from self._batches


def _as_it_is(batch: object) -> object:
    """Batches are tensors already."""
    return batch
