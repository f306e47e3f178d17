import hashlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from fscnn.data.datasets import (
    DrawSampler,
    FolderSource,
    JoinedSource,
    SceneSource,
    SegmentationDataset,
)
from fscnn.data.module import DataConfig, RailData
from fscnn.data.transforms import GroundSmear, RailCrop, training_transform
from railinspect import scenes
from railinspect.errors import BadInputError
from railinspect.labels import HUMAN, RAIL_RAISED, SKY, TRACKBED
from tests.fscnn.drawing import draw, write_set


def digests(data: RailData, epoch: int = 0) -> list[str]:
    loader = data.train_dataloader()
    loader.sampler.set_epoch(epoch)
    return [
        hashlib.sha256(image.numpy().tobytes() + mask.numpy().tobytes()).hexdigest()
        for images, masks in loader
        for image, mask in zip(images, masks, strict=True)
    ]


@pytest.fixture
def one_image(tmp_path: Path) -> str:
    write_set(tmp_path, 8)
    # Eight times the same picture: whatever differs between samples is randomness.
    first_image = (tmp_path / "jpgs/rs00000.jpg").read_bytes()
    first_mask = (tmp_path / "uint8/rs00000.png").read_bytes()
    for i in range(1, 8):
        (tmp_path / f"jpgs/rs{i:05d}.jpg").write_bytes(first_image)
        (tmp_path / f"uint8/rs{i:05d}.png").write_bytes(first_mask)
    return str(tmp_path)


def config(folder: str, workers: int) -> DataConfig:
    return DataConfig(
        train_folders=[folder],
        val_folders=[folder],
        crop_wh=[48, 32],
        batch_size=2,
        workers=workers,
    )


def test_workers_do_not_repeat_each_other(one_image: str) -> None:
    with_two = digests(RailData(config(one_image, 2), seed=7))
    assert len(set(with_two)) == 8


def test_samples_depend_on_seed_and_epoch_but_not_on_workers(one_image: str) -> None:
    alone = digests(RailData(config(one_image, 0), seed=7))
    assert digests(RailData(config(one_image, 2), seed=7)) == alone
    assert not set(digests(RailData(config(one_image, 0), seed=7), epoch=1)) & set(alone)
    assert not set(digests(RailData(config(one_image, 0), seed=8))) & set(alone)


def test_sampler_permutes_every_epoch() -> None:
    sampler = DrawSampler(5, seed=0)
    first = list(sampler)
    sampler.set_epoch(1)
    second = list(sampler)
    assert sorted(i for i, _ in first) == sorted(i for i, _ in second) == list(range(5))
    assert [d for _, d in first + second] == list(range(10))
    assert [i for i, _ in first] != [i for i, _ in second]


@pytest.mark.parametrize(("length", "processes"), [(8, 2), (11, 3)])
def test_processes_share_each_epoch_and_repeat_nothing(length: int, processes: int) -> None:
    whole = DrawSampler(length, seed=4)
    for epoch in (0, 1):
        whole.set_epoch(epoch)
        turns = []
        for rank in range(processes):
            sampler = DrawSampler(length, 4, rank, processes)
            sampler.set_epoch(epoch)
            turns.append(list(sampler))
            assert len(turns[-1]) == len(sampler) == length // processes
        shared = [draw for turn in zip(*turns, strict=True) for draw in turn]
        assert shared == list(whole)[: length // processes * processes]


def test_each_process_validates_its_own_images(one_image: str) -> None:
    seen = []
    for rank in range(3):
        data = RailData(config(one_image, 0))
        data.trainer = SimpleNamespace(global_rank=rank, world_size=3)
        seen += list(data.val_dataloader().sampler)
        assert len(list(data.train_dataloader())) == 1  # two of eight images, a batch
    assert sorted(seen) == list(range(8))
    data.trainer = SimpleNamespace(global_rank=0, world_size=9)
    with pytest.raises(BadInputError, match="8 images to train on cannot be shared by 9 processes"):
        data.train_dataloader()


def test_joined_sources_count_through(tmp_path: Path) -> None:
    write_set(tmp_path / "a", 2)
    write_set(tmp_path / "b", 3)
    joined = JoinedSource([FolderSource(tmp_path / "a"), FolderSource(tmp_path / "b")])
    assert len(joined) == 5
    assert np.array_equal(joined(4)[1], draw(2)[1])
    assert np.array_equal(joined(1)[1], draw(1)[1])


def test_scenes_stream_from_the_renderer() -> None:
    source = SceneSource(start=3, count=2)
    image, mask = SegmentationDataset(source, len(source))[1]
    assert image.dtype == mask.dtype == torch.uint8
    assert image.shape == (3, *mask.shape)


def test_no_data_is_said() -> None:
    with pytest.raises(BadInputError, match=r"set data\.train_folders or data\.train_scenes"):
        RailData(DataConfig())
    with pytest.raises(BadInputError, match=r"\[480, 270\] must be divisible by 16"):
        RailData(DataConfig(crop_wh=[480, 270]))


def test_crops_keep_image_and_mask_together() -> None:
    # Paint the mask into the image: wherever the crop lands, they must still agree.
    mask = draw(0, 192, 128)[1]
    image = np.repeat(mask[..., None], 3, axis=2)
    crop = RailCrop((64, 48), zoom=(1.0, 1.0), aspect=1.0)
    for seed in range(20):
        crop.set_random_seed(seed)
        done = crop(image=image, mask=mask)
        assert done["mask"].shape == (48, 64)
        assert np.array_equal(done["image"][..., 0], done["mask"])


def test_crops_look_for_rails() -> None:
    mask = np.zeros((400, 400), np.uint8)
    mask[390, 5] = RAIL_RAISED
    image = np.zeros((400, 400, 3), np.uint8)
    crop = RailCrop((64, 64), zoom=(1.0, 1.0), aspect=1.0, rail_share=1.0)
    for seed in range(10):
        crop.set_random_seed(seed)
        assert (crop(image=image, mask=mask)["mask"] == RAIL_RAISED).any()


def test_transform_keeps_ids_sizes_and_types() -> None:
    image, mask = draw(3, 192, 128)
    transform = training_transform((96, 64))
    for seed in range(30):
        transform.set_random_seed(seed)
        done = transform(image=image, mask=mask)
        assert done["image"].shape == (64, 96, 3)
        assert done["image"].dtype == np.uint8
        assert set(np.unique(done["mask"])) <= {*np.unique(mask), 255}


def test_smear_changes_the_ground_and_leaves_what_stands_on_it() -> None:
    rng = np.random.default_rng(5)
    image = rng.integers(60, 200, (120, 160, 3)).astype(np.uint8)
    mask = np.full((120, 160), SKY, np.uint8)
    mask[50:] = TRACKBED
    mask[60:, 70:74] = RAIL_RAISED
    mask[60:100, 100:120] = HUMAN
    smear = GroundSmear(length=(0.08, 0.08), darkest=(0.5, 0.5), p=1.0)
    smear.set_random_seed(1)
    done = smear(image=image, mask=mask)
    assert np.array_equal(done["mask"], mask)
    kept = mask != TRACKBED
    assert np.array_equal(done["image"][kept], image[kept])
    near = (mask == TRACKBED) & (np.arange(120)[:, None] > 100)
    assert done["image"][near].std() < 0.6 * image[near].std()  # smooth, as streaming ballast is
    assert 0.5 * image[near].mean() < done["image"][near].mean() < image[near].mean()  # and stained
    smear.set_random_seed(1)
    assert np.array_equal(smear(image=image, mask=mask)["image"], done["image"])
    nothing = smear(image=image, mask=np.full_like(mask, SKY))
    assert np.array_equal(nothing["image"], image)


def test_smeared_ground_takes_no_colour_from_the_rails_beside_it() -> None:
    mask = np.full((80, 80), TRACKBED, np.uint8)
    mask[:, 38:42] = RAIL_RAISED
    image = np.where(mask[..., None] == RAIL_RAISED, 250, 90).astype(np.uint8).repeat(3, axis=2)
    smear = GroundSmear(length=(0.1, 0.1), darkest=(1.0, 1.0), p=1.0)
    smear.set_random_seed(2)
    done = smear(image=image, mask=mask)["image"]
    assert np.abs(done[mask == TRACKBED].astype(int) - 90).max() <= 1


def test_a_share_of_the_training_pictures_gets_an_anomaly() -> None:
    scene = scenes.render(3)
    size_wh = (scene.labels.shape[1], scene.labels.shape[0])
    counts = np.bincount(scene.labels.ravel(), minlength=256)
    for share in (0.0, 1.0):
        transform = training_transform(size_wh, (1.0, 1.0), 0.0, 0.0, 1.0, anomalies=share)
        for seed in range(3):
            transform.set_random_seed(seed)
            mask = transform(image=np.ascontiguousarray(scene.rgb), mask=scene.labels)["mask"]
            same = np.array_equal(np.bincount(mask.ravel(), minlength=256), counts)
            assert same == (share == 0.0)
