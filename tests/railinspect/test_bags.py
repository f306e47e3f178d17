"""Pictures of bags come with the camera's own times; what is damaged or hostile is one sentence."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
import tracemalloc
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType

from railinspect import bag_readers
from railinspect.bag_readers import BagError
from railinspect.errors import BadInputError
from railinspect.ros_images import decode_picture
from railinspect.video import open_source
from tests.railinspect.bags import START_NS, compressed, raw, write_db3, write_mcap

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
STEPS_NS = [0, 40_000_000, 79_999_999, 200_000_001]


def picture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, (48, 64, 3)).astype(np.uint8)


def rows(make=raw, type_=IMAGE, topic="/cab/image"):
    stamps = [START_NS + step for step in STEPS_NS]
    chatter = ("/chatter", "std_msgs/msg/String", {"data": "hello"}, START_NS)
    return [
        chatter,
        *[(topic, type_, make(picture(i), at), at + 7_000_000) for i, at in enumerate(stamps)],
    ]


def read(path: Path, **rest):
    source = open_source(path, **rest)
    try:
        return list(source), source
    finally:
        source.close()


@pytest.mark.parametrize("write", [write_mcap, write_db3])
@pytest.mark.parametrize(("make", "type_"), [(raw, IMAGE), (compressed, COMPRESSED)])
def test_pictures_and_times_survive_to_the_nanosecond(tmp_path, write, make, type_):
    suffix = ".mcap" if write is write_mcap else ".db3"
    frames, source = read(write(tmp_path / f"a{suffix}", rows(make, type_)))
    assert source.kind == "bag"
    assert source.stamped_by == "message header"
    assert [f.stamp_ns for f in frames] == [START_NS + step for step in STEPS_NS]
    assert [f.time_s for f in frames] == [0.0, 0.04, 0.079999999, 0.200000001]
    assert [f.index for f in frames] == [0, 1, 2, 3]
    for seed, frame in enumerate(frames):
        assert np.array_equal(frame.rgb, picture(seed))
    assert source.breaks == []


@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_compression_is_read(tmp_path, compression):
    frames, source = read(write_mcap(tmp_path / "a.mcap", rows(), compression))
    assert len(frames) == source.frames_expected == 4
    assert source.duration_s == pytest.approx(0.207, abs=0.01)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "mono8", "mono16"])
def test_encodings_and_padded_rows(tmp_path, encoding):
    made = rows(lambda rgb, at: raw(rgb, at, encoding, padding=13))
    frames, _ = read(write_mcap(tmp_path / "a.mcap", made))
    expected = picture(0)
    if encoding.startswith("mono"):
        expected = np.repeat(expected[..., :1], 3, axis=2)
    assert np.array_equal(frames[0].rgb, expected)


def test_an_empty_header_leaves_the_recorder_s_time(tmp_path):
    made = rows(lambda rgb, _: raw(rgb, 0))
    frames, source = read(write_mcap(tmp_path / "a.mcap", made))
    assert source.stamped_by == "recorder"
    assert [f.stamp_ns for f in frames] == [START_NS + step + 7_000_000 for step in STEPS_NS]


def test_a_folder_of_split_files_is_one_recording(tmp_path):
    first, later = rows()[:3], rows()[3:]
    write_mcap(tmp_path / "bag_10.mcap", later)
    write_mcap(tmp_path / "bag_2.mcap", first)
    (tmp_path / "metadata.yaml").write_text("relative_file_paths: [../../etc/passwd]")
    frames, _ = read(tmp_path)
    assert [f.stamp_ns for f in frames] == [START_NS + step for step in STEPS_NS]


def test_several_topics_have_to_be_chosen_from(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", rows() + rows(topic="/rear/image"))
    with pytest.raises(BadInputError, match=r"/cab/image, /rear/image.*--topic"):
        open_source(path)
    assert len(read(path, topic="/rear/image")[0]) == 4
    with pytest.raises(BadInputError, match="no pictures on topic '/chatter'"):
        open_source(path, topic="/chatter")


def test_a_bag_without_pictures_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="only std_msgs/msg/String"):
        open_source(write_mcap(tmp_path / "a.mcap", rows()[:1]))


def test_times_that_do_not_rise_are_skipped_and_recorded(tmp_path):
    made = rows()
    made[3], made[4] = made[4], made[3]
    frames, source = read(write_mcap(tmp_path / "a.mcap", made))
    assert [f.stamp_ns - START_NS for f in frames] == [0, 40_000_000, 200_000_001]
    assert "not later" in source.breaks[0].reason


@pytest.mark.parametrize("share", [0.5, 0.8, 0.97])
def test_a_cut_off_file_keeps_what_is_before(tmp_path, share):
    made = [
        ("/cab", IMAGE, raw(picture(i), START_NS + 40_000_000 * i), START_NS + 40_000_000 * i)
        for i in range(20)
    ]
    path = write_mcap(tmp_path / "a.mcap", made)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    frames, source = read(path)
    assert 5 <= len(frames) <= 20
    assert [f.stamp_ns for f in frames] == [START_NS + 40_000_000 * i for i in range(len(frames))]
    assert "breaks off or is damaged" in source.breaks[-1].reason


@given(st.data())
def test_flipped_bits_never_crash(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp()
    path = folder / "flipped.mcap"
    whole = folder / "whole.mcap"
    if not whole.exists():
        write_mcap(whole, rows(), CompressionType.NONE)
    content = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        content[data.draw(st.integers(8, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(content)
    with contextlib.suppress(BadInputError):  # any other exception fails
        frames, _ = read(path)
        assert all(a.time_s < b.time_s for a, b in pairwise(frames))


@given(st.binary(max_size=200), st.sampled_from([IMAGE, COMPRESSED]))
def test_random_messages_are_one_sentence(data, type_):
    with pytest.raises(BadInputError):
        decode_picture(b"\0\1\0\0" + data, type_)


def image_claiming(width: int, height: int, step: int) -> bytes:
    text = struct.pack("<I", 5) + b"rgb8\0"
    body = struct.pack("<iI", 1, 0) + struct.pack("<I", 1) + b"\0" + b"\0" * 3
    body += struct.pack("<II", height, width) + text + b"\0" + b"\0" * 2
    return b"\0\1\0\0" + body + struct.pack("<I", step) + struct.pack("<I", 0)


@pytest.mark.parametrize(
    ("size", "words"),
    [((2**31, 2**31), "at most 100 million"), ((640, 480), "cut off"), ((0, 0), "at least 32")],
)
def test_claimed_sizes_cost_nothing(size, words):
    tracemalloc.start()
    with pytest.raises(BadInputError, match=words):
        decode_picture(image_claiming(*size, 3 * size[0] % 2**32), IMAGE)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


class FakeChunk:
    def __init__(self, data: bytes, size: int, compression: str = "zstd") -> None:
        self.data, self.uncompressed_size, self.compression = data, size, compression


def test_a_chunk_unpacks_to_what_it_announces_or_not_at_all():
    bomb = zstandard.compress(b"\0" * 200_000_000)
    tracemalloc.start()
    with pytest.raises(BagError, match="announces 1000 bytes"):
        bag_readers._decompressed(FakeChunk(bomb, 1000))
    with pytest.raises(BagError, match="at most"):
        bag_readers._decompressed(FakeChunk(bomb, 2**40))
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
    with pytest.raises(BagError, match="not zstd or lz4"):
        bag_readers._decompressed(FakeChunk(zlib.compress(b"a"), 1, "zlib"))


def test_what_is_no_bag_is_one_sentence(tmp_path):
    for name in ("a.mcap", "a.db3"):
        (tmp_path / name).write_bytes(b"not at all")
        with pytest.raises(BadInputError, match="whatever its name says"):
            open_source(tmp_path / name)
    base = sqlite3.connect(tmp_path / "b.db3")
    base.execute("CREATE TABLE a(b)")
    base.close()
    with pytest.raises(BadInputError, match="no ROS 2 bag"):
        open_source(tmp_path / "b.db3")
    base = sqlite3.connect(tmp_path / "c.db3")
    base.execute("CREATE VIEW topics AS SELECT 1 AS id")
    base.execute("CREATE TABLE messages(id)")
    base.commit()
    base.close()
    with pytest.raises(BadInputError, match="no ROS 2 bag"):
        open_source(tmp_path / "c.db3")


def test_a_bag_is_never_written_to(tmp_path):
    path = write_db3(tmp_path / "a.db3", rows())
    before = path.read_bytes()
    read(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.db3"]
