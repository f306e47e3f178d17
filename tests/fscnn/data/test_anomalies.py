import albumentations
import numpy as np

from fscnn.data.anomalies import Anomaly
from railinspect.anomalies import GeneratorSettings
from railinspect.labels import HUMAN
from tests.railinspect.anomalies.flat_track import a_camera, flat_picture
from tests.railinspect.anomalies.test_generate import BOARDS


def transform(kind, seed, **extra):
    chain = albumentations.Compose(
        [Anomaly((kind,), BOARDS, p=1.0)],
        bbox_params=albumentations.BboxParams("pascal_voc", label_fields=["ids"]),
        keypoint_params=albumentations.KeypointParams("xy", remove_invisible=False),
    )
    chain.set_random_seed(seed)
    rgb, labels, track = flat_picture(a_camera((640, 360)))
    rail = np.stack([track.left_px, track.rows_px], axis=-1)
    box = np.array([[10.0, 20.0, 60.0, 90.0]])
    out = chain(image=rgb, mask=labels, bboxes=box, ids=[1], keypoints=rail)
    return rgb, labels, rail, out


def test_a_person_comes_into_picture_and_mask_together():
    rgb, labels, rail, out = transform("trespasser", 3)
    where = out["mask"] != labels
    assert where.sum() > 50
    assert (out["mask"][where] == HUMAN).all()
    assert (out["image"] != rgb).any(axis=2)[where].mean() > 0.9
    np.testing.assert_allclose(out["keypoints"], rail, atol=1e-3)
    np.testing.assert_allclose(out["bboxes"], [[10, 20, 60, 90]], atol=1e-3)


def test_rails_labels_and_points_bend_together():
    _, labels, rail, out = transform("distortion", 5)
    moved = np.asarray(out["keypoints"])
    shift = moved[:, 0] - rail[:, 0]
    assert np.abs(shift).max() > 2
    row = int(rail[np.argmax(np.abs(shift)), 1])
    at = moved[np.argmin(np.abs(moved[:, 1] - row)), 0]
    hits = np.flatnonzero(out["mask"][row] == 17)
    assert np.abs(hits - at).min() <= 1.0
    assert set(np.unique(out["mask"])) == set(np.unique(labels))


def test_the_seed_decides():
    first, again, other = (transform("obstruction", seed)[3]["image"] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_a_picture_without_a_track_is_left_alone():
    chain = albumentations.Compose([Anomaly(settings=GeneratorSettings(), p=1.0)])
    rgb = np.random.default_rng(0).integers(0, 255, (200, 300, 3), np.uint8)
    mask = np.full((200, 300), 8, np.uint8)
    out = chain(image=rgb, mask=mask)
    np.testing.assert_array_equal(out["image"], rgb)
    np.testing.assert_array_equal(out["mask"], mask)
