"""Torch datasets over folders and over the renderer, and the sampler that makes draws repeatable.

A sample is ``(image, mask)``: uint8 tensors (3, H, W), RGB, and (H, W), class ids. A dataset is
indexed by ``(index, draw)``; ``draw`` numbers every sample of a training run, and all randomness of
a sample comes from the run's seed and that number. Two workers therefore never repeat each other,
and the same run gives the same samples with any number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import albumentations
import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from fscnn.data.splits import Split, pairs_of
from railinspect import scenes
from railinspect.errors import BadInputError
from railinspect.railsem import Image, list_pairs, read_pair

Draw = tuple[int, int]


class SegmentationDataset(Dataset[tuple[Tensor, Tensor]]):
    """Pairs from a source, transformed.

    Args:
        source: Gives image (H, W, 3) and mask (H, W) of an index.
        length: Number of indices.
        transform: Applied to each pair; None leaves it alone.
        seed: Seed of the run.
    """

    def __init__(
        self,
        source: Callable[[int], tuple[Image, Image]],
        length: int,
        transform: albumentations.Compose | None = None,
        seed: int = 0,
    ) -> None:
        self.source = source
        self.length = length
        self.transform = transform
        self.seed = seed

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, item: int | Draw) -> tuple[Tensor, Tensor]:
        index, draw = item if isinstance(item, tuple) else (item, item)
        image, mask = self.source(index)
        if self.transform is not None:
            state = np.random.SeedSequence((self.seed, draw)).generate_state(1)
            self.transform.set_random_seed(int(state[0]))
            done = self.transform(image=image, mask=mask)
            image, mask = done["image"], done["mask"]
        return (
            torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))),
            torch.from_numpy(np.ascontiguousarray(mask)),
        )


class FolderSource:
    """A RailSem19-layout folder, or some of its pairs, or a part of a split of it."""

    def __init__(
        self,
        folder: Path,
        limit: int | None = None,
        split: Split | None = None,
        part: str = "train",
    ) -> None:
        pairs = list_pairs(folder) if split is None else pairs_of(folder, split, part)
        self.pairs = pairs[:limit]

    def __len__(self) -> int:
        return len(self.pairs)

    def __call__(self, index: int) -> tuple[Image, Image]:
        """Read pair number ``index``, in order of file name."""
        return read_pair(self.pairs[index])

    def name(self, index: int) -> str:
        """Name of the image."""
        return self.pairs[index].image.stem

    def range_m(self, index: int) -> None:
        """Pictures alone do not say how far things are."""
        return


class SceneSource:
    """Scenes rendered on the spot: index i is seed ``start + i``."""

    def __init__(self, start: int, count: int) -> None:
        self.start = start
        self.count = count
        self._last: scenes.Rendered | None = None

    def __len__(self) -> int:
        return self.count

    def _rendered(self, index: int) -> scenes.Rendered:
        seed = self.start + index
        if self._last is None or self._last.seed != seed:
            self._last = scenes.render(seed)
        return self._last

    def __call__(self, index: int) -> tuple[Image, Image]:
        """Render scene number ``index``."""
        rendered = self._rendered(index)
        return rendered.rgb, rendered.labels

    def name(self, index: int) -> str:
        """Name of the scene."""
        return f"scene {self.start + index}"

    def range_m(self, index: int) -> npt.NDArray[np.float32]:
        """Range of each pixel along the track, metres; infinite in the sky."""
        return self._rendered(index).depth_m


class JoinedSource:
    """Several sources one after the other."""

    def __init__(self, sources: Sequence[FolderSource | SceneSource]) -> None:
        self.sources = tuple(sources)
        self.ends = np.cumsum([len(source) for source in self.sources])

    def __len__(self) -> int:
        return int(self.ends[-1])

    def __call__(self, index: int) -> tuple[Image, Image]:
        """Pair number ``index``, counted through all sources."""
        which = int(np.searchsorted(self.ends, index, side="right"))
        return self.sources[which](index - (int(self.ends[which - 1]) if which else 0))


class DrawSampler(Sampler[Draw]):
    """A fresh permutation every epoch, each entry with its number within the run.

    Lightning calls :meth:`set_epoch`, so a resumed run goes on with the draws it would have had.
    Of several processes each takes its turn of the one permutation, so that none repeats another;
    what does not go round is left out, for all must take equally many steps.

    Args:
        length: Number of indices.
        seed: Seed of the run.
        rank: Number of this process, 0 … ``processes`` − 1.
        processes: Processes that train together.
    """

    def __init__(self, length: int, seed: int, rank: int = 0, processes: int = 1) -> None:
        self.length = length
        self.seed = seed
        self.rank = rank
        self.processes = processes
        self.epoch = 0

    def __len__(self) -> int:
        return self.length // self.processes

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch the next iteration belongs to."""
        self.epoch = epoch

    def __iter__(self) -> Iterator[Draw]:
        rng = np.random.default_rng((self.seed, self.epoch))
        first = self.epoch * self.length
        order = rng.permutation(self.length)
        for position in range(self.rank, len(self) * self.processes, self.processes):
            yield int(order[position]), first + position


def first_hand(error: BadInputError) -> BadInputError:
    """The error as its own sentence: a loader process hands it on inside a whole traceback."""
    return BadInputError(str(error).rsplit(f"{BadInputError.__name__}: ", 1)[-1].strip())


def quiet_worker(_: int) -> None:
    """Keep OpenCV and torch to one thread in each loader process; the processes are the workers."""
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
