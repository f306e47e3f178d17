"""Frames come in order with the media's own times; what cannot be read is refused or recorded."""

from __future__ import annotations

import struct
import sys
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.errors import BadInputError
from railinspect.image_folder import natural_key
from railinspect.image_times import times_from_names
from railinspect.video import open_source
from tests.railinspect.painted_ride import paint, write_video


def grey(level: int, size_wh: tuple[int, int] = (64, 48)) -> np.ndarray:
    return np.full((size_wh[1], size_wh[0], 3), level, np.uint8)


def read(path: Path, **rest):
    source = open_source(path, **rest)
    try:
        return list(source), source
    finally:
        source.close()


def test_frames_come_in_order_with_their_times(tmp_path):
    levels = [40, 90, 140, 190, 240]
    path = write_video(tmp_path / "a.mp4", [grey(level) for level in levels], rate=10)
    frames, source = read(path)
    assert [f.index for f in frames] == [0, 1, 2, 3, 4]
    assert [f.time_s for f in frames] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4], abs=1e-4)
    assert [int(f.rgb.mean()) for f in frames] == pytest.approx(levels, abs=3)
    assert source.kind == "video"
    assert source.size_wh == (64, 48)
    assert source.breaks == []


def test_reordered_frames_come_in_presentation_order(tmp_path):
    levels = list(range(20, 240, 10))
    path = write_video(
        tmp_path / "a.mp4",
        [grey(level) for level in levels],
        codec_options={"preset": "medium", "bf": "3", "crf": "10"},
    )
    frames, _ = read(path)
    assert [int(f.rgb.mean()) for f in frames] == pytest.approx(levels, abs=4)
    assert all(a.time_s < b.time_s for a, b in pairwise(frames))


def test_a_variable_frame_rate_keeps_its_times(tmp_path):
    times = [0.0, 0.04, 0.1, 0.5, 0.52, 2.0]
    path = write_video(tmp_path / "a.mp4", [grey(100)] * 6, times)
    frames, source = read(path)
    assert [f.time_s for f in frames] == pytest.approx(times, abs=1e-3)
    assert source.breaks == []


@pytest.mark.parametrize("degrees", [90, 180, -90])
def test_rotation_is_applied(tmp_path, degrees):
    picture = grey(30)
    picture[:16, :16] = 220  # a bright corner, top left
    probe = write_video(tmp_path / "probe.mp4", [picture] * 3)
    path = tmp_path / "turned.mp4"
    rotate_track(probe, path, degrees)
    frames, _ = read(path)
    expected = np.rot90(picture, degrees // 90 % 4)
    assert frames[0].rgb.shape == expected.shape
    assert np.abs(frames[0].rgb.astype(int) - expected).mean() < 6
    assert frames[0].rgb.flags.c_contiguous


def rotate_track(source: Path, target: Path, degrees: int) -> None:
    """Write a display matrix that turns counterclockwise into the track header (ISO 14496-12)."""
    data = bytearray(source.read_bytes())
    at = data.index(b"tkhd") + 4
    at += 40 if data[at] == 0 else 52  # version 0 or 1
    one = 0x10000
    matrix = {
        90: (0, -one, one, 0),
        180: (-one, 0, 0, -one),
        -90: (0, one, -one, 0),
    }[degrees]
    a, b, c, d = matrix
    data[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 0x40000000)
    target.write_bytes(data)


def test_ten_bits_and_other_pixel_formats_are_read(tmp_path):
    for name, codec, pix_fmt in (
        ("ten.mkv", "libx265", "yuv420p10le"),
        ("full.mkv", "ffv1", "bgr0"),
        ("wide.mkv", "ffv1", "yuv444p16le"),
        ("plain.mkv", "ffv1", "gray"),
    ):
        options = {"x265-params": "log-level=none"} if codec == "libx265" else {"g": "1"}
        path = write_video(
            tmp_path / name, [grey(77)] * 3, codec=codec, pix_fmt=pix_fmt, codec_options=options
        )
        frames, _ = read(path)
        assert len(frames) == 3
        assert abs(int(frames[1].rgb.mean()) - 77) <= 3
        assert frames[1].rgb.dtype == np.uint8


def test_non_square_pixels_are_made_square(tmp_path):
    def stretch(stream):
        stream.codec_context.sample_aspect_ratio = 2

    path = write_video(tmp_path / "a.mkv", [grey(80)] * 2, prepare=stretch)
    frames, source = read(path)
    assert frames[0].rgb.shape == (48, 128, 3)
    assert source.size_wh == (128, 48)


def long_clip(path: Path, options: dict[str, str] | None = None) -> Path:
    rng = np.random.default_rng(3)
    pictures = [rng.integers(0, 255, (48, 64, 3)).astype(np.uint8) for _ in range(60)]
    return write_video(path, pictures, container_options=options, codec_options={"g": "10"})


@pytest.mark.parametrize(("name", "options"), [("a.mp4", {"movflags": "faststart"}), ("a.mkv", {})])
def test_a_recording_cut_in_the_middle_keeps_what_is_before(tmp_path, name, options, capfd):
    path = long_clip(tmp_path / name, options)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    frames, source = read(path)
    assert 20 <= len(frames) <= 40
    (broken,) = source.breaks
    assert broken.frame_index == frames[-1].index
    assert broken.time_s == frames[-1].time_s
    assert "earlier" in broken.reason
    assert capfd.readouterr().err == ""


def test_damage_inside_a_recording_is_recorded_and_reading_goes_on(tmp_path):
    path = long_clip(tmp_path / "a.mkv")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = bytes(3000)
    path.write_bytes(data)
    frames, source = read(path)
    assert frames[-1].time_s > 4.0
    assert source.breaks or any(f.damaged for f in frames) or len(frames) < 60


def test_an_mp4_without_its_index_says_so(tmp_path):
    path = long_clip(tmp_path / "a.mp4")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(BadInputError, match=r"index \(moov\) is missing, so it was cut off"):
        open_source(path)


def test_missing_empty_and_mislabelled_files_are_refused(tmp_path):
    with pytest.raises(BadInputError, match="does not exist"):
        open_source(tmp_path / "none.mp4")
    (tmp_path / "empty.mp4").touch()
    with pytest.raises(BadInputError, match=r"is empty \(0 bytes\)"):
        open_source(tmp_path / "empty.mp4")
    (tmp_path / "text.mp4").write_text("this is no video\n" * 20)
    with pytest.raises(BadInputError, match="is text, not a video"):
        open_source(tmp_path / "text.mp4")
    (tmp_path / "noise.mp4").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(BadInputError, match="not a video this program can read"):
        open_source(tmp_path / "noise.mp4")


def test_a_video_without_frames_is_refused(tmp_path):
    path = tmp_path / "zero.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        container.start_encoding()
    with pytest.raises(BadInputError, match=r"no frame of .*zero\.mp4|no video stream"):
        open_source(path)


def test_a_recording_of_sound_only_is_refused(tmp_path):
    path = tmp_path / "sound.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
    with pytest.raises(BadInputError, match="holds no video stream"):
        open_source(path)


def test_one_image_is_one_frame(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), paint()[..., ::-1])
    frames, source = read(tmp_path / "a.png")
    assert [(f.index, f.time_s) for f in frames] == [(0, 0.0)]
    assert source.kind == "image"


def folder_of(path: Path, names: list[str]) -> Path:
    path.mkdir()
    for level, name in enumerate(names):
        cv2.imwrite(str(path / name), grey(10 * level))
    return path


def test_a_folder_is_sorted_as_people_count(tmp_path):
    path = folder_of(tmp_path / "f", ["f1.png", "f2.png", "f10.png"])
    (path / "notes.txt").write_text("ignored")
    frames, source = read(path)
    assert [int(f.rgb.mean()) for f in frames] == [0, 10, 20]
    assert [f.time_s for f in frames] == pytest.approx([0, 0.1, 0.2])
    assert source.kind == "folder"


def test_a_folder_takes_its_times_from_rate_or_names(tmp_path):
    path = folder_of(tmp_path / "f", ["cab_10.00.png", "cab_10.04.png", "cab_10.12.png"])
    assert [f.time_s for f in read(path)[0]] == pytest.approx([0, 0.04, 0.12])
    assert [f.time_s for f in read(path, folder_rate_hz=2)[0]] == pytest.approx([0, 0.5, 1.0])


def test_a_damaged_image_in_a_folder_is_skipped_and_recorded(tmp_path):
    path = folder_of(tmp_path / "f", ["1.png", "2.png", "3.png"])
    (path / "2.png").write_bytes(b"broken")
    frames, source = read(path)
    assert [f.index for f in frames] == [0, 1]
    assert [f.time_s for f in frames] == pytest.approx([0, 0.2])
    assert "skipped one file" in source.breaks[0].reason


def test_a_folder_without_images_is_refused(tmp_path):
    (tmp_path / "f").mkdir()
    with pytest.raises(BadInputError, match="holds no image"):
        open_source(tmp_path / "f")


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_is_no_rate_is_refused(tmp_path, rate):
    with pytest.raises(BadInputError, match="give a positive number"):
        open_source(tmp_path, folder_rate_hz=rate)


@given(st.lists(st.integers(0, 10**6), min_size=1, unique=True))
def test_natural_order_is_that_of_the_numbers(numbers):
    names = [f"frame{n}.png" for n in numbers]
    assert sorted(names, key=natural_key) == [f"frame{n}.png" for n in sorted(numbers)]


@given(st.lists(st.integers(1, 10**9), min_size=1, max_size=20), st.integers(0, 10**18))
def test_times_in_nanoseconds_keep_their_precision(steps, start):
    stamps = np.cumsum([10**18 + start, *steps], dtype=object)
    times = times_from_names([f"cam-{stamp}" for stamp in stamps])
    assert times is not None
    assert times == pytest.approx([(s - stamps[0]) * 1e-9 for s in stamps], abs=1e-9)


def test_equal_or_falling_times_are_no_times():
    assert times_from_names(["a_1.0", "a_1.0"]) is None
    assert times_from_names(["a_2.0", "a_1.0"]) is None


@pytest.mark.skipif(sys.platform != "linux", reason="reads the process's memory from /proc")
def test_memory_does_not_grow_with_the_recording(tmp_path):
    def resident_kb() -> int:
        line = next(x for x in Path("/proc/self/status").read_text().splitlines() if "VmRSS" in x)
        return int(line.split()[1])

    picture = grey(90, (640, 360))
    path = write_video(tmp_path / "long.mp4", [picture] * 600)
    source = open_source(path)
    seen = []
    for frame in source:
        if frame.index in (100, 590):
            seen.append(resident_kb())
    source.close()
    # 490 frames of 691 kB would be 339 MB if they were kept.
    assert seen[1] - seen[0] < 20_000


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"bf": "3", "g": "12", "preset": "medium"}),
        ("a.mkv", "libx264", {"bf": "2", "g": "20"}),
        ("a.ts", "libx264", {"bf": "2", "g": "12"}),
        ("a.avi", "mpeg4", {"g": "12"}),
    ],
)
def test_reading_from_a_time_on_gives_the_same_frames_and_times(tmp_path, name, codec, options):
    pictures = [grey(7 * i % 250) for i in range(60)]
    path = write_video(tmp_path / name, pictures, codec=codec, codec_options=options)
    every, _ = read(path)
    source = open_source(path)
    assert source.clock() == (every[0].time_s, every[-1].time_s)
    source.close()
    for time_s in (0.0, 0.5, 2.41, 4.6, 99.0):
        source = open_source(path)
        before = source.seek(time_s, remember=5)
        frames = list(source)
        source.close()
        left_out = len(every) - len(frames)
        assert frames[0].time_s <= max(time_s, every[0].time_s)
        assert [f.index for f in frames] == list(range(len(frames)))
        assert [f.time_s for f in frames] == [f.time_s for f in every[left_out:]]
        assert all(
            np.array_equal(f.rgb, g.rgb) for f, g in zip(frames, every[left_out:], strict=True)
        )
        assert source.breaks == []
        if name != "a.avi":  # which has no presentation times for some of its packets
            assert before == [f.time_s for f in every[:left_out]][-5:]
    if name in ("a.mp4", "a.mkv"):
        assert left_out > 30, "the frames before were not decoded"


def test_a_clock_that_is_set_back_is_no_clock(tmp_path):
    path = write_video(tmp_path / "a.ts", [grey(100)] * 20)
    path.write_bytes(2 * path.read_bytes())
    source = open_source(path)
    assert source.clock() is None
    source.close()


def test_a_folder_is_read_from_a_time_on(tmp_path):
    for index in range(6):
        cv2.imwrite(str(tmp_path / f"f{index}.png"), grey(20 + index))
    source = open_source(tmp_path, 10.0)
    assert source.clock() == (0.0, 0.5)
    assert source.seek(0.35, remember=2) == pytest.approx([0.1, 0.2])
    assert [f.time_s for f in source] == pytest.approx([0.3, 0.4, 0.5])
