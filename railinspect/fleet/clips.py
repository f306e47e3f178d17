"""Short films of events, cut from the overlay or from the recording itself."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import av

from railinspect.errors import BadInputError
from railinspect.fleet.finished import FinishedInput
from railinspect.images import check_size

BEFORE_S: Final = 1.0
"""A clip begins so long before its event is confirmed, seconds."""

LENGTH_S: Final = 3.0
"""And lasts so long, seconds."""

RATE_HZ: Final = 10.0
"""Pictures per second of a clip."""

WIDTH_PX: Final = 480
"""Width of a clip, pixels."""

MAX_DECODED: Final = 2000
"""After so many decoded pictures a cut is given up: the recording does not say where it is."""

_SEVERITY: Final = {"emergency": 3, "service": 2, "warn": 1}


def top_events(events: Sequence[Mapping[str, Any]], count: int) -> list[Mapping[str, Any]]:
    """The events to look at first: not in doubt, then by the brake advised, then by confidence.

    Equal ones come in the order of their inputs and ids, so the choice is the same every time.
    """

    def order(event: Mapping[str, Any]) -> tuple[Any, ...]:
        severity = _SEVERITY.get(event["advice"] or "", 0)
        doubtful = event["doubt"] is not None
        return doubtful, -severity, -event["confidence"], event["input"], event["id"]

    return sorted(events, key=order)[:count]


def clip_of(event: Mapping[str, Any], one: FinishedInput) -> bytes | None:
    """A film of an event as MP4, or None where there is no picture to cut it from.

    Args:
        event: A row of the events.
        one: The input it was seen in.
    """
    start_s = event["confirmed_time_s"] - BEFORE_S
    overlay = one.folder / "overlay.mp4"
    recording = Path(one.counts.address)
    if overlay.is_file():
        path, start_s = overlay, start_s - (one.counts.first_time_s or 0.0)
    elif one.counts.kind == "video" and recording.is_file():
        path = recording
    else:
        return None
    try:
        return _encoded(_pictures(path, start_s))
    except (av.FFmpegError, OSError, ValueError, BadInputError):
        return None  # the report shows the event's picture instead


def _pictures(path: Path, start_s: float) -> Iterator[av.VideoFrame]:
    """Pictures of a stretch, at most ``RATE_HZ`` of them per second."""
    with av.open(str(path), metadata_errors="replace") as container:
        stream = container.streams.video[0]
        stream.codec_context.thread_count = 1
        context = stream.codec_context
        check_size((context.width, context.height), str(path))
        container.seek(max(round(start_s * av.time_base), 0), backward=True)
        next_s, given, decoded = start_s, False, 0
        for packet in container.demux(stream):
            # Before the clip begins only those pictures are needed that later ones build on.
            before = packet.pts is not None and packet.pts * packet.time_base < start_s - 1e-3
            context.skip_frame = "NONREF" if before else "DEFAULT"
            for frame in packet.decode():
                decoded += 1
                if decoded > MAX_DECODED or frame.time is None or frame.time > start_s + LENGTH_S:
                    return
                check_size((frame.width, frame.height), str(path))
                if frame.time >= next_s - 1e-6:
                    next_s = (next_s if given else frame.time) + 1 / RATE_HZ
                    given = True
                    yield frame


def _encoded(frames: Iterator[av.VideoFrame]) -> bytes | None:
    file = io.BytesIO()
    first = next(frames, None)
    if first is None:
        return None
    width = min(WIDTH_PX, first.width) // 2 * 2
    height = max(round(first.height * width / first.width / 2) * 2, 2)
    with av.open(file, "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=Fraction(RATE_HZ).limit_denominator(100))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.thread_count = 1
        stream.options = {"preset": "veryfast", "crf": "29"}
        number = 0
        frame: av.VideoFrame | None = first
        while frame is not None:
            small = frame.reformat(width=width, height=height, format="yuv420p")
            small.pts, small.time_base = number, Fraction(1, round(RATE_HZ))
            out.mux(stream.encode(small))
            frame, number = next(frames, None), number + 1
        out.mux(stream.encode())
    return file.getvalue()
