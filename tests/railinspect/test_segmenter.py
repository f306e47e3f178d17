import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from railinspect.bundle import MAX_BYTES, golden_image, read_bytes, unpack_labels
from railinspect.errors import BadInputError, BundleError
from railinspect.labels import CLASSES
from railinspect.segmenter import Segmenter, fitted_wh, segment_at, verify
from tests.railinspect.hand_bundle import SIZE_WH, bundle, golden_outputs, metadata, model

GOLDEN_SUM = 111840107
"""Sum of all values of the golden image of 640 × 368."""


@pytest.fixture
def segmenter() -> Segmenter:
    return Segmenter(bundle(), threads=1)


def noise(width: int, height: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def test_runs_the_graph_at_its_own_size(segmenter: Segmenter) -> None:
    image = noise(*SIZE_WH)
    result = segmenter(image)
    assert np.array_equal(result.labels, image[..., 0] % 19)
    assert np.array_equal(result.confidence, image[..., 1])
    assert np.array_equal(result.rail_score, image[..., 2])


@pytest.mark.parametrize("size", [(96, 64), (24, 16), (61, 47), (48, 33), (64, 400)])
def test_other_sizes_come_back_at_their_own_size(
    segmenter: Segmenter, size: tuple[int, int]
) -> None:
    # Blocks of constant colour survive any resampling away from their edges.
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    image[:, width // 2 :] = (11, 200, 90)
    result = segmenter(image)
    for part, left, right in (
        (result.labels, 0, 11),
        (result.confidence, 0, 200),
        (result.rail_score, 0, 90),
    ):
        assert part.shape == (height, width)
        assert part.dtype == np.uint8
        assert part[height // 2, 0] == left
        assert part[height // 2, -1] == right
    assert set(np.unique(result.labels)) <= set(range(19))


@pytest.mark.parametrize(
    ("image_wh", "fitted"),
    [((640, 360), (640, 360)), ((1920, 1080), (640, 360)), ((640, 480), (491, 368))],
)
def test_pictures_keep_their_proportions(
    image_wh: tuple[int, int], fitted: tuple[int, int]
) -> None:
    seen = []

    def run(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        seen.append(rgb)
        return rgb[..., 0], rgb[..., 1], rgb[..., 2]

    image = np.full((image_wh[1], image_wh[0], 3), 7, np.uint8)
    image[-1:], image[:, -1:] = 9, 9
    result = segment_at(image, (640, 368), run)
    assert seen[0].shape == (368, 640, 3)
    wide, high = fitted
    if fitted == image_wh:  # not resampled at all
        assert np.array_equal(seen[0][:high, :wide], image)
        assert np.array_equal(result.labels, image[..., 0])
    # the border goes on below and to the right
    assert np.all(seen[0][high:] == seen[0][high - 1])
    assert np.all(seen[0][:, wide:] == seen[0][:, wide - 1 : wide])
    assert fitted_wh(image_wh, (640, 368)) == fitted
    assert result.labels.shape == (image_wh[1], image_wh[0])


def test_labels_are_never_blended(segmenter: Segmenter) -> None:
    image = np.zeros((320, 480, 3), np.uint8)
    image[:, 240:, 0] = 18
    near_edge = segmenter(image).labels[:, 200:280]
    # area-averaging the *image* may blend its colours, but the map itself only repeats ids
    small = segmenter(np.ascontiguousarray(image[::10, ::10])).labels
    assert set(np.unique(small)) == {0, 18}
    assert near_edge.shape == (320, 80)


def test_views_that_are_not_contiguous(segmenter: Segmenter) -> None:
    image = noise(96, 64)[::2, ::-2]
    assert np.array_equal(segmenter(image).labels, image[..., 0] % 19)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((1, 1, 3), np.uint8), "at least 16×16 pixels, got 1×1"),
        (np.zeros((32, 48), np.uint8), r"RGB of shape \(H, W, 3\), got \(32, 48\); repeat a grey"),
        (np.zeros((32, 48, 4), np.uint8), "drop an alpha channel"),
        (np.zeros((32, 48, 3), np.uint16), "8-bit values, got uint16; scale it"),
        (np.zeros((32, 48, 3), np.float32), "8-bit values, got float32"),
        (np.zeros((0, 48, 3), np.uint8), "at least 16×16"),
        ([[0, 0, 0]], "must be a NumPy array, got list"),
    ],
)
def test_images_of_another_kind_are_refused(
    segmenter: Segmenter, image: np.ndarray, message: str
) -> None:
    with pytest.raises(BadInputError, match=message):
        segmenter(image)


def test_metadata_reads_back_equal(segmenter: Segmenter) -> None:
    assert segmenter.metadata == metadata()
    assert segmenter.metadata.classes == CLASSES


def test_verify_passes_here(segmenter: Segmenter) -> None:
    result = verify(segmenter, repeats=2)
    assert result.identical
    assert result.passed
    assert result.agreement == 1
    assert result.frame_s > 0


def test_verify_judges_by_agreement_where_bytes_differ() -> None:
    hashes = {**metadata().golden_sha256, "confidence": "0" * 64}
    rounded = verify(Segmenter(bundle(golden_sha256=hashes)), repeats=0)
    assert (rounded.identical, rounded.passed) == (False, True)


def test_verify_fails_another_graph() -> None:
    changed = model()
    changed.graph.initializer[1].CopyFrom(
        helper.make_tensor("nineteen", TensorProto.UINT8, [1], [7])
    )
    result = verify(Segmenter(bundle(changed)), repeats=0)
    assert (result.identical, result.passed) == (False, False)


def test_golden_image_is_what_it_was() -> None:
    # The formula is part of the file format: a change here breaks every bundle in the field.
    image = golden_image((640, 368))
    assert image.shape == (368, 640, 3)
    assert int(image.astype(np.int64).sum()) == GOLDEN_SUM
    assert golden_outputs((640, 368))["labels"].max() < 19


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"hello", "not an ONNX file that can be run"),
        (bundle()[:200], "not an ONNX file that can be run"),
        (bundle(key="other"), "not one of ours: it has no 'railinspect' metadata"),
        (bundle(change=lambda text: text[:-20]), "metadata of .* is damaged"),
        (bundle(change=lambda text: "[]"), "metadata of .* is damaged"),
        (bundle(change=lambda text: text.replace('"classes"', '"klasses"')), "is damaged"),
        (bundle(format=2), "has format 2, this package reads 1"),
        (bundle(classes=("road", "rail")), "made for other classes"),
        (bundle(colour_order="BGR"), "made for other colour order"),
        (bundle(golden_input="else"), "made for other golden input"),
        (bundle(input_size_wh=(64, 32)), "disagrees with its metadata"),
        (bundle(model(input_name="picture")), "disagrees with its metadata"),
        (
            bundle(model(kind=TensorProto.INT32)),
            r"image is tensor\(int32\), expected tensor\(uint8\)",
        ),
    ],
    ids=range(13),
)
def test_other_bundles_are_refused(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "b.onnx"
    path.write_bytes(data)
    with pytest.raises(BundleError, match=message) as caught:
        Segmenter.load(path)
    assert "b.onnx" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="No such file"):
        Segmenter.load(tmp_path / "none.onnx")
    with pytest.raises(BundleError, match="Is a directory"):
        Segmenter.load(tmp_path)
    empty = tmp_path / "empty.onnx"
    empty.touch()
    with pytest.raises(BundleError, match="is empty"):
        Segmenter.load(empty)


def test_huge_files_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.onnx"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(BundleError, match="more than the 256 MiB a bundle may have"):
        read_bytes(path)


def test_weights_in_another_file_are_refused(tmp_path: Path) -> None:
    built = model()
    (tmp_path / "weights").write_bytes(bytes(8))
    tensor = built.graph.initializer[0]
    tensor.ClearField("int64_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", "weights"), ("length", "8")):
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    path = tmp_path / "b.onnx"
    path.write_bytes(bundle(built))
    with pytest.raises(BundleError, match="keeps weights in another file"):
        Segmenter.load(path)


@pytest.mark.parametrize("text", ["%%%", "aGVsbG8=", ""])
def test_damaged_golden_labels(text: str) -> None:
    with pytest.raises(BundleError, match="golden labels are damaged"):
        unpack_labels(text, SIZE_WH)


def test_threads_must_be_positive() -> None:
    with pytest.raises(BadInputError, match="threads must be at least 1, got 0"):
        Segmenter(bundle(), threads=0)


def test_runs_where_the_training_stack_is_absent(tmp_path: Path) -> None:
    """Import and run in a process in which importing any of it fails."""
    path = tmp_path / "b.onnx"
    path.write_bytes(bundle())
    code = (
        "import sys\n"
        "for name in ('torch', 'torchvision', 'lightning', 'albumentations', 'onnx'):\n"
        "    sys.modules[name] = None\n"
        "import numpy as np\n"
        "from railinspect.segmenter import Segmenter\n"
        "{control}\n"
        "print(Segmenter.load(sys.argv[1])(np.zeros((64, 64, 3), np.uint8)).labels.shape)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}

    def run(control: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", code.format(control=control), str(path)],
            capture_output=True,
            text=True,
            env=environment,
            check=False,
        )

    assert run("").stdout == "(64, 64)\n"
    assert "ModuleNotFoundError: import of torch halted" in run("import torch").stderr


def test_hand_built_graph_is_valid() -> None:
    onnx.checker.check_model(model())


def test_close_ups_look_at_the_whole_picture_with_any_number_of_threads() -> None:
    shown: list[np.ndarray] = []

    def look(rgb: np.ndarray, track: object) -> str:
        shown.append(rgb)
        return "seen"

    image = noise(96, 64)
    segmenter = Segmenter(bundle(), threads=2, close_ups=look)
    for one in (segmenter, segmenter.on_one_thread()):
        result = one(image)
        assert result.close_ups is not None
        assert result.close_ups(None) == "seen"
        assert shown.pop() is image
    assert Segmenter(bundle(), threads=1)(image).close_ups is None
