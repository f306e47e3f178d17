"""A real local source is followed: newest frames, drops counted, no queue without end."""

from __future__ import annotations

import json
import signal
import threading
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.live_senders import number_into, number_of, send
from railinspect._threads import one_ahead
from railinspect.batch import inspect_live
from railinspect.errors import BadInputError
from railinspect.inspect_settings import InspectSettings
from railinspect.live import LiveSettings, LiveSource, _SourceClock, shown
from railinspect.live_commands import stopped_by_signals
from railinspect.pipeline import segmented_frames
from railinspect.source import Source
from tests.railinspect.painted_ride import paint, read_paint

PICTURE = paint([40.0])
QUICK = LiveSettings(idle_s=0.6, open_s=20)


class Sender:
    """Sends from a thread; the pictures are numbered from 0 at 25 per second."""

    def __init__(self, kind: str, target: object, seconds: float) -> None:
        self.begun = threading.Event()
        self._thread = threading.Thread(
            target=send,
            args=(kind, str(target), [PICTURE], 25, seconds, lambda _: self.begun.set()),
        )
        self._thread.start()

    def join(self) -> None:
        self._thread.join(timeout=60)
        assert not self._thread.is_alive()


def follow_file(path: Path, kind: str, seconds: float, wait_s: float = 0.3) -> LiveSource:
    sender = Sender(kind, path, seconds)
    sender.begun.wait(20)
    time.sleep(wait_s)
    source = LiveSource(path, QUICK)
    source.sender = sender
    return source


def test_a_number_survives_the_codec():
    assert number_of(number_into(PICTURE, 43690)) == 43690


@pytest.mark.parametrize("kind", ["ts", "mp4"])
def test_a_growing_file_is_followed_to_its_end(tmp_path, kind):
    source = follow_file(tmp_path / f"a.{kind}", kind, seconds=1.2)
    before_ns = time.time_ns()
    frames = [(number_of(f.rgb), f) for f in source]
    source.close()
    source.sender.join()
    numbers = [number for number, _ in frames]
    assert numbers == sorted(set(numbers))
    assert numbers[-1] >= 27
    assert source.kind == "live"
    assert source.size_wh == (640, 360)
    # The source's own clock: as many frame periods between two frames as their numbers differ by.
    for (one, a), (other, b) in pairwise(frames):
        assert b.time_s - a.time_s == pytest.approx((other - one) / 25, abs=2e-3)
    assert all(abs(f.stamp_ns - before_ns) < 60e9 for _, f in frames)
    assert source.live.received == len(frames) + source.live.dropped


def test_what_the_file_held_before_is_skipped_not_inspected(tmp_path):
    path = tmp_path / "a.ts"
    send("ts", str(path), [PICTURE], 25, 2.0)  # two seconds lie there already
    source = LiveSource(path, QUICK)
    numbers = [number_of(f.rgb) for f in source]
    source.close()
    assert len(numbers) <= 2
    assert numbers[0] >= 47
    assert source.live.skipped >= 45


def test_a_slow_inspector_gets_new_frames_and_the_rest_are_counted(tmp_path):
    source = follow_file(tmp_path / "a.ts", "ts", seconds=1.6)
    seen = []
    for frame in source:
        seen.append((number_of(frame.rgb), time.monotonic() - frame.arrived_s))
        time.sleep(0.25)
        source.done(frame)
    source.close()
    source.sender.join()
    assert len(seen) < 12
    assert source.live.dropped >= 5
    assert source.live.received == len(seen) + source.live.dropped
    assert source.live.latency_worst_s >= 0.25


class Counted(Source):
    """A live source without a network: numbers its frames when they are asked for."""

    kind = "live"

    def __init__(self) -> None:
        super().__init__(Path("made"))
        self.asked = 0

    def __iter__(self):
        while self.asked < 6:
            self.asked += 1
            yield SimpleNamespace(rgb=self.asked)

    def close(self) -> None:
        self.asked = 6


def test_no_frame_waits_for_the_network_or_behind_it():
    source = Counted()
    frames = segmented_frames(source, lambda rgb: rgb)
    for taken, (frame, _) in enumerate(frames, start=1):
        deadline = time.monotonic() + 5
        while source.asked < min(taken + 1, 6) and time.monotonic() < deadline:
            time.sleep(0.001)
        time.sleep(0.02)
        assert frame.rgb == taken
        assert source.asked <= taken + 1  # one is in the making, none waits behind it


def test_one_ahead_raises_what_its_producer_raises_and_can_be_left():
    def broken():
        yield 1
        raise OSError("gone")

    items = one_ahead(broken())
    assert next(items) == 1
    with pytest.raises(OSError, match="gone"):
        next(items)
    early = one_ahead(iter(range(100)))
    assert next(early) == 0
    early.close()


def packet(index: int, key_every: int = 25) -> SimpleNamespace:
    return SimpleNamespace(dts=index, pts=index, is_keyframe=index % key_every == 0)


def left_out(arrivals: list[float]) -> list[int]:
    clock = _SourceClock(SimpleNamespace(time_base=0.04), behind_s=0.25)
    return [i for i, at in enumerate(arrivals) if clock.leave_out(packet(i), at)]


def test_a_network_that_stalls_and_catches_up_loses_nothing():
    stall = [0.04 * i for i in range(50)] + [3.0 + 0.005 * i for i in range(30)]
    stall += [3.2 + 0.04 * i for i in range(50)]
    assert left_out(stall) == []


def test_a_decoder_that_falls_behind_leaves_out_up_to_the_next_key_frame():
    slow = [0.06 * i for i in range(100)]
    missing = left_out(slow)
    assert missing
    assert not any(i % 25 == 0 for i in missing)
    assert all(i + 1 in missing or (i + 1) % 25 == 0 for i in missing if i < 99)


def test_clocks_that_run_apart_lose_nothing():
    drifting = [0.04 * i * (1 + 1e-4) for i in range(200_000)]  # 100 ppm for two hours
    assert left_out(drifting) == []


def test_rtsp_is_followed_and_its_end_is_recorded(tmp_path):
    from benchmarks.live import free_port, wait_for_port

    port = free_port()
    sender = Sender("rtsp", port, 3.0)
    wait_for_port(port)
    source = LiveSource(f"rtsp://user:secret@127.0.0.1:{port}/cab", QUICK)
    out = tmp_path / "run"
    with stopped_by_signals(source):
        summary = inspect_live(source, out, read_paint, InspectSettings(overlay=False))
    sender.join()
    assert summary.complete
    assert summary.frames >= 1
    live = summary.inputs[0].live
    assert live.received == summary.frames + live.dropped
    assert "connection lost" in summary.inputs[0].breaks[0].reason
    everything = "".join(
        p.read_text() for p in out.iterdir() if p.suffix in (".html", ".json", ".jsonl")
    )
    assert "secret" not in everything
    assert "Followed live" in (out / "report.html").read_text()
    run = json.loads((out / "run.json").read_text())
    assert run["inputs"][0]["live"]["latency_worst_s"] > 0
    assert run["counts"]["dropped_frames"] == live.dropped


def test_a_signal_ends_a_run_in_order(tmp_path):
    source = follow_file(tmp_path / "a.ts", "ts", seconds=1.5)
    count = 0
    with stopped_by_signals(source):
        for _ in source:
            count += 1
            signal.raise_signal(signal.SIGTERM)
    source.close()
    source.sender.join()
    assert count == 1
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("http://a/b.m3u8", "cannot follow http://"),
        ("concat://a|b", "cannot follow concat://"),
        ("none.ts", "start its recorder first"),
        ("rtsp://user:secret@127.0.0.1:9/x", "rtsp:/127.0.0.1:9/x"),
    ],
)
def test_what_cannot_be_followed_is_one_sentence(address, words):
    with pytest.raises(BadInputError, match=words) as refused:
        LiveSource(address, LiveSettings(open_s=0.5, idle_s=0.5))
    assert "secret" not in str(refused.value)


def test_a_playlist_opens_nothing_else(tmp_path):
    (tmp_path / "a.ts").write_text("#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n")
    with pytest.raises(BadInputError, match="gives no pictures"):
        LiveSource(tmp_path / "a.ts", LiveSettings(open_s=2, idle_s=0.3))


@pytest.mark.parametrize("setting", [{"idle_s": 0}, {"duration_s": -1}, {"rtsp_transport": "ftp"}])
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(BadInputError):
        LiveSettings(**setting)


def test_a_source_without_frames_cannot_be_made():
    with pytest.raises(TypeError, match="abstract"):
        Source(Path("a"))  # type: ignore[abstract]


def test_credentials_and_queries_are_never_shown():
    assert shown("rtsp://a:b@c@host/x?y=z#q") == "rtsp:/host/x"
