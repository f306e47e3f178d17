"""Pictures of every kind come out as the same RGB, or are refused with one sentence."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.errors import BadInputError
from railinspect.images import MAX_PIXELS, check_size, header_size_wh, read_image

PIL_Image = pytest.importorskip("PIL.Image", reason="Pillow writes the CMYK test image")


@pytest.fixture
def colours() -> np.ndarray:
    """Four flat quarters: red, green, blue, grey; shape (48, 64, 3)."""
    rgb = np.zeros((48, 64, 3), np.uint8)
    rgb[:24, :32], rgb[:24, 32:] = (200, 30, 40), (30, 190, 60)
    rgb[24:, :32], rgb[24:, 32:] = (40, 50, 210), (128, 128, 128)
    return rgb


def save(path: Path, bgr: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), bgr)
    return path


def test_png_is_read_exactly(tmp_path, colours):
    path = save(tmp_path / "a.png", colours[..., ::-1])
    assert np.array_equal(read_image(path), colours)


@pytest.mark.parametrize("suffix", [".jpg", ".bmp", ".tif", ".webp"])
def test_other_formats_keep_the_colours(tmp_path, colours, suffix):
    path = save(tmp_path / f"a{suffix}", colours[..., ::-1])
    seen = read_image(path)
    assert seen.shape == colours.shape
    assert np.abs(seen[12, 16].astype(int) - colours[12, 16]).max() <= 6


def test_sixteen_bits_are_scaled_from_their_full_range(tmp_path, colours):
    deep = colours[..., ::-1].astype(np.uint16) * 257  # 255 becomes 65535
    assert np.array_equal(read_image(save(tmp_path / "a.png", deep)), colours)
    assert np.array_equal(read_image(save(tmp_path / "a.tif", deep)), colours)


def test_a_dark_sixteen_bit_image_stays_dark(tmp_path):
    deep = np.full((40, 40), 300, np.uint16)
    assert read_image(save(tmp_path / "a.png", deep)).max() == 1


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_becomes_three_equal_channels(tmp_path, dtype):
    grey = np.full((40, 50), 100 if dtype == np.uint8 else 100 * 257, dtype)
    seen = read_image(save(tmp_path / "a.png", grey))
    assert seen.shape == (40, 50, 3)
    assert (seen == 100).all()


def test_transparent_pixels_lie_over_black(tmp_path, colours):
    alpha = np.full((48, 64, 1), 255, np.uint8)
    alpha[:, 32:] = 0
    path = save(tmp_path / "a.png", np.concatenate([colours[..., ::-1], alpha], axis=2))
    seen = read_image(path)
    assert np.array_equal(seen[:, :32], colours[:, :32])
    assert (seen[:, 32:] == 0).all()


def test_cmyk_jpeg_has_the_right_colours(tmp_path, colours):
    path = tmp_path / "a.jpg"
    PIL_Image.fromarray(colours).convert("CMYK").save(path, quality=98)
    seen = read_image(path)
    for row, column in ((12, 16), (12, 48), (36, 16), (36, 48)):
        assert np.abs(seen[row, column].astype(int) - colours[row, column]).max() <= 12


def test_palette_png_is_read(tmp_path, colours):
    path = tmp_path / "a.png"
    PIL_Image.fromarray(colours).quantize(4).save(path)
    assert np.abs(read_image(path).astype(int) - colours).max() <= 4


def test_camera_orientation_is_applied(tmp_path, colours):
    path = tmp_path / "a.jpg"
    exif = PIL_Image.Exif()
    exif[0x0112] = 6  # the top of the scene is on the right of the stored picture
    PIL_Image.fromarray(colours).save(path, quality=98, exif=exif)
    seen = read_image(path)
    assert seen.shape == (64, 48, 3)
    assert np.abs(seen[16, 36].astype(int) - colours[12, 16]).max() <= 8


def test_one_pixel_is_refused(tmp_path):
    path = save(tmp_path / "dot.png", np.zeros((1, 1, 3), np.uint8))
    with pytest.raises(BadInputError, match=r"1×1 pixels; each side must be at least 32"):
        read_image(path)


def test_missing_and_empty_files_are_refused(tmp_path):
    with pytest.raises(BadInputError, match="cannot read image"):
        read_image(tmp_path / "none.png")
    (tmp_path / "empty.png").touch()
    with pytest.raises(BadInputError, match=r"is empty \(0 bytes\)"):
        read_image(tmp_path / "empty.png")


def test_text_with_an_image_name_is_refused(tmp_path):
    path = tmp_path / "a.png"
    path.write_text("not an image")
    with pytest.raises(BadInputError, match="is not a PNG, JPEG, BMP, TIFF or WebP image"):
        read_image(path)


def test_a_damaged_image_is_refused_without_noise(tmp_path, colours, capfd):
    path = save(tmp_path / "a.png", colours[..., ::-1])
    data = path.read_bytes()
    path.write_bytes(data[:60])
    with pytest.raises(BadInputError, match="damaged"):
        read_image(path)
    assert capfd.readouterr().err == ""


def test_a_decompression_bomb_is_refused_from_its_header(tmp_path):
    def chunk(kind: bytes, body: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + body))
        return struct.pack(">I", len(body)) + kind + body + check

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    path = tmp_path / "bomb.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1000))))
    with pytest.raises(BadInputError, match=r"claims 60000×60000 pixels; at most 100 million"):
        read_image(path)


def test_the_largest_size_is_the_stated_one():
    check_size((10_000, MAX_PIXELS // 10_000), "x")
    with pytest.raises(BadInputError):
        check_size((10_000, MAX_PIXELS // 10_000 + 1), "x")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "TIFF", "WEBP"])
@given(width=st.integers(1, 300), height=st.integers(1, 300), mode=st.sampled_from(["RGB", "L"]))
def test_the_header_gives_the_size(kind, width, height, mode):
    buffer = io.BytesIO()
    PIL_Image.new(mode, (width, height)).save(buffer, kind)
    assert header_size_wh(buffer.getvalue()) == (width, height)


@given(st.binary(max_size=99), st.sampled_from([b"\xff\xd8", b"II*\0", b"RIFF0000WEBP", b"BM"]))
def test_no_header_is_a_surprise(body, start):
    header_size_wh(start + body)  # never raises
