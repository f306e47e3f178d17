"""Following a camera or a growing file: the newest frames, never a queue without end.

A reader thread decodes what comes in. Frames wait at most a moment and at most a few of them; when
the inspector is slower than the source, the oldest are dropped and counted. What was already in a
file when following began is skipped but for its last group of pictures.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import av

from railinspect.errors import BadInputError
from railinspect.images import check_size
from railinspect.latency import Latencies
from railinspect.source import Frame, LiveCount, Source
from railinspect.video import rgb_of

SCHEMES: Final = ("rtsp", "rtsps", "udp", "tcp")
"""Addresses that can be followed; nothing else is opened, whatever the library could."""

MAX_GROUP_BYTES: Final = 64 * 1024 * 1024
"""Of a file's last group of pictures at most this is kept while catching up, bytes."""

_FORMATS: Final = "rtsp,sdp,rtp,mpegts,mov,matroska,flv,h264,hevc,mjpeg"
_PROTOCOLS: Final = "rtsp,rtsps,rtp,udp,tcp,tls,srtp,crypto"
_POLL_S: Final = 0.01


@dataclass(frozen=True)
class LiveSettings:
    """How a source is followed.

    Attributes:
        max_wait_s: Once a frame has waited longer than this, only the newest is kept, seconds.
        max_waiting: At most this many decoded frames wait.
        behind_s: When the decoder is this far behind the source and does not catch up, pictures
            are left out up to the next one that stands alone, seconds.
        idle_s: Nothing new for this long ends a file, or a connection that cannot be made again,
            seconds.
        open_s: Longest wait for the first picture, seconds.
        duration_s: End after this much time, seconds; None goes on.
        rtsp_transport: "tcp" or "udp".
    """

    max_wait_s: float = 0.1
    max_waiting: int = 8
    behind_s: float = 0.25
    idle_s: float = 10.0
    open_s: float = 10.0
    duration_s: float | None = None
    rtsp_transport: str = "tcp"

    def __post_init__(self) -> None:
        for name in ("idle_s", "open_s", "duration_s"):
            value = getattr(self, name)
            if value is not None and not 0 < value < 1e9:
                raise BadInputError(f"{name} is {value}; give a positive number of seconds")
        if self.rtsp_transport not in ("tcp", "udp"):
            raise BadInputError(f"transport is {self.rtsp_transport!r}; give tcp or udp")


@dataclass(frozen=True)
class _Waiting:
    """A decoded picture that nobody has taken yet."""

    picture: av.VideoFrame
    time_s: float
    arrived_s: float
    stamp_ns: int


class LiveSource(Source):
    """The frames of a camera or of a file that is still being written, as they come.

    A frame's time is the source's own, counted from the first one; ``stamp_ns`` is when it came
    in. A lost connection is made again and recorded as a break; time then goes on by the clock.

    Args:
        address: ``rtsp://``, ``rtsps://``, ``udp://`` or ``tcp://`` address, or a file.
        settings: How to follow it.

    Raises:
        BadInputError: if no picture comes; the message names no password.
    """

    kind = "live"

    def __init__(self, address: str | Path, settings: LiveSettings | None = None) -> None:
        self._address = str(address)
        super().__init__(Path(shown(self._address)))
        self._settings = settings or LiveSettings()
        self._remote = _check_address(self._address)
        self.stamped_by = "arrival at this computer"
        self._news = threading.Condition()
        self._waiting: deque[_Waiting] = deque()
        self._stop = threading.Event()
        self._over = False
        self._problem = "no picture came"
        self._received = self._dropped = self._skipped = self._sessions = 0
        self._delivered = 0
        self._latencies = Latencies()
        self._begin_s: float | None = None
        self._last_s = 0.0
        self._stream: Any = None
        self._thread = threading.Thread(target=self._read, name="railinspect-live", daemon=True)
        self._thread.start()
        self._await_first()

    @property
    def live(self) -> LiveCount:
        """What became of the frames so far."""
        latencies = self._latencies
        return LiveCount(
            received=self._received,
            dropped=self._dropped,
            skipped=self._skipped,
            reconnects=max(self._sessions - 1, 0),
            latency_s=latencies.last_s,
            latency_median_s=latencies.quantile_s(0.5),
            latency_p95_s=latencies.quantile_s(0.95),
            latency_worst_s=latencies.worst_s,
        )

    def done(self, frame: Frame) -> None:
        """The frame's record has been written: its latency is known."""
        if frame.arrived_s is not None:
            self._latencies.add(time.monotonic() - frame.arrived_s)

    def stop(self) -> None:
        """End the recording in order; may be called from a signal handler or another thread."""
        self._stop.set()

    def close(self) -> None:
        """Stop reading; what still waits is dropped."""
        self._stop.set()
        self._thread.join(timeout=2.0)
        with self._news:
            self._dropped += len(self._waiting)
            self._waiting.clear()

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        while (one := self._take()) is not None:
            rgb = rgb_of(one.picture, self._stream)
            if rgb is None:
                self._dropped += 1
                continue
            damaged = bool(one.picture.is_corrupt)
            yield Frame(index, one.time_s, rgb, damaged, one.stamp_ns, one.arrived_s)
            index += 1

    def _take(self) -> _Waiting | None:
        """The next frame, or the newest where the next has waited too long; None at the end."""
        limit_s = self._settings.duration_s
        while True:
            now_s = time.monotonic()
            if self._stop.is_set() or (
                limit_s is not None
                and self._begin_s is not None
                and now_s - self._begin_s > limit_s
            ):
                self._stop.set()
                return None
            with self._news:
                oldest_s = now_s - self._settings.max_wait_s
                if self._waiting and self._waiting[0].arrived_s < oldest_s:
                    self._dropped += len(self._waiting) - 1
                    self._waiting = deque([self._waiting[-1]])  # late already: only the newest
                if self._waiting:
                    return self._waiting.popleft()
                if self._over:
                    return None
                self._news.wait(0.1)

    def _await_first(self) -> None:
        until_s = time.monotonic() + self._settings.open_s
        try:
            with self._news:
                while not self._waiting and not self._over and time.monotonic() < until_s:
                    self._news.wait(0.05)
                if not self._waiting:
                    raise BadInputError(
                        f"cannot follow {self.path}: {self._problem} within "
                        f"{self._settings.open_s:g} s; check that it is being sent or written"
                    )
                picture = self._waiting[-1].picture
            check_size((picture.width, picture.height), str(self.path))
            rgb = rgb_of(picture, self._stream)
            if rgb is None:
                raise BadInputError(f"the first picture of {self.path} cannot be used")
            self.size_wh = (rgb.shape[1], rgb.shape[0])
        except BaseException:
            self.close()
            raise

    def _read(self) -> None:
        """Sessions, one after another, until the end."""
        quiet_since_s = time.monotonic()
        while not self._stop.is_set():
            before = self._received
            try:
                self._session()
                reason = "the source ended"
            except (av.FFmpegError, OSError, ValueError) as error:
                reason = (getattr(error, "strerror", None) or str(error)) or type(error).__name__
            except BadInputError as error:
                reason = str(error)
            self._problem = f"the source gives no pictures ({reason})"
            if self._received > before:
                quiet_since_s = time.monotonic()
                if self._remote and not self._stop.is_set():
                    self.note_break(self._last_s, self._delivered - 1, f"connection lost: {reason}")
            idle_s = time.monotonic() - quiet_since_s
            if not self._remote or idle_s > self._settings.idle_s:
                break
            self._stop.wait(0.5)
        with self._news:
            self._over = True
            self._news.notify_all()

    def _session(self) -> None:
        """Read one connection, or the file, until it ends."""
        with contextlib.ExitStack() as stack:
            tail = None
            if self._remote:
                container = av.open(
                    self._address,
                    mode="r",
                    metadata_errors="replace",
                    options=self._options(),
                    timeout=(self._settings.open_s, min(self._settings.idle_s, 5.0)),
                )
            else:
                tail = stack.enter_context(
                    contextlib.closing(Tail(self.path, self._settings.idle_s, self._stop))
                )
                container = av.open(
                    tail,
                    mode="r",
                    metadata_errors="replace",
                    options={"format_whitelist": _FORMATS},
                    buffer_size=16384,
                )
                tail.waited = False  # what was read to recognise the streams is no news any more
            stack.enter_context(contextlib.closing(container))
            if not container.streams.video:
                raise BadInputError("it holds no video stream")
            stream = container.streams.video[0]
            stream.thread_type = "SLICE"  # whole frames in parallel would each add one of delay
            stream.codec_context.thread_count = 1
            stream.codec_context.flags |= av.codec.context.Flags.low_delay
            self._stream = stream
            self._sessions += 1
            self._decode(container, stream, tail)

    def _options(self) -> dict[str, str]:
        options = {
            "fflags": "nobuffer",
            "format_whitelist": _FORMATS,
            "protocol_whitelist": _PROTOCOLS,
            "analyzeduration": "1000000",
            "max_delay": "100000",
        }
        if self._address.startswith("rtsp"):
            options["rtsp_transport"] = self._settings.rtsp_transport
        return options

    def _decode(self, container: Any, stream: Any, tail: Tail | None) -> None:
        """Decode packet by packet; while catching up keep only the last group of pictures."""
        clock = _SourceClock(stream, self._settings.behind_s)
        offset_s: float | None = None
        group: list[Any] = []
        group_bytes = 0
        at_edge = tail is None
        arrivals: dict[int, float] = {}
        for packet in container.demux(stream):
            if self._stop.is_set():
                return
            arrived_s = time.monotonic()
            if not packet.size:
                continue
            if not at_edge:
                assert tail is not None
                if packet.is_keyframe:
                    self._skipped += len(group)
                    group, group_bytes = [], 0
                group.append(packet)
                group_bytes += packet.size
                if group_bytes > MAX_GROUP_BYTES:
                    self._skipped += len(group)
                    group, group_bytes = [], 0
                if not tail.waited:
                    continue
                at_edge = True
                self._skipped += max(len(group) - 1, 0)
                late, group = group, []
            else:
                late = [packet]
                if clock.leave_out(packet, arrived_s):
                    self._received += 1
                    self._dropped += 1
                    continue
            pictures: list[av.VideoFrame] = []
            for one in late:
                if one.pts is not None:
                    arrivals[one.pts] = arrived_s
                with contextlib.suppress(av.FFmpegError):  # the next key frame mends it
                    pictures += one.decode()
            # Of what a file already held, only the newest picture is of interest.
            for picture in pictures[-1:] if len(late) > 1 else pictures:
                came_s = (
                    arrivals.pop(picture.pts, arrived_s) if picture.pts is not None else arrived_s
                )
                media_s = picture.time if picture.time is not None else came_s
                if offset_s is None:
                    begun_s = self._begin_s
                    self._begin_s = came_s if begun_s is None else begun_s
                    offset_s = media_s - (came_s - self._begin_s)
                self._deliver(picture, media_s - offset_s, came_s)
            while len(arrivals) > 64:
                arrivals.pop(next(iter(arrivals)))

    def _deliver(self, picture: av.VideoFrame, time_s: float, came_s: float) -> None:
        """Put a picture where the inspector takes it; the oldest makes room."""
        if self._delivered and time_s <= self._last_s:
            time_s = self._last_s + 1e-4  # a broken clock must not run backwards
        age_s = time.monotonic() - came_s
        stamp_ns = time.time_ns() - round(age_s * 1e9)
        with self._news:
            self._received += 1
            if len(self._waiting) >= self._settings.max_waiting:
                self._waiting.popleft()
                self._dropped += 1
            self._waiting.append(_Waiting(picture, time_s, came_s, stamp_ns))
            self._delivered += 1
            self._last_s = time_s
            self._news.notify_all()


class _SourceClock:
    """Tells a decoder that falls behind from a network that stalled and catches up.

    The source's media time is set against arrival; the smallest difference so far, forgotten at
    200 parts per million for clocks that run apart, is that of a packet read without delay.
    """

    FORGET: Final = 2e-4

    def __init__(self, stream: Any, behind_s: float) -> None:
        self._time_base = float(stream.time_base or 0)
        self._behind_s = behind_s
        self._least_s: float | None = None
        self._seen_s = 0.0
        self._since: tuple[float, float] | None = None
        self._leaving_out = False

    def leave_out(self, packet: Any, arrived_s: float) -> bool:
        """Whether to drop a packet undecoded; only ever up to the next key frame."""
        stamp = packet.dts if packet.dts is not None else packet.pts
        if stamp is None or not self._time_base:
            return False
        delay_s = arrived_s - stamp * self._time_base
        if self._least_s is not None and abs(delay_s - self._least_s) > 30.0:
            self._least_s = None  # the source set its clock
        if self._least_s is not None:
            self._least_s += self.FORGET * (arrived_s - self._seen_s)
        self._least_s = delay_s if self._least_s is None else min(self._least_s, delay_s)
        self._seen_s = arrived_s
        lag_s = delay_s - self._least_s
        if packet.is_keyframe:
            self._leaving_out = False
        if lag_s < self._behind_s:
            self._since = None
        elif self._since is None or lag_s < self._since[1] - 0.05:
            self._since = (arrived_s, lag_s)  # behind, but catching up
        elif arrived_s - self._since[0] > self._behind_s and not packet.is_keyframe:
            self._leaving_out = True
        return self._leaving_out


class Tail:
    """A file that is still being written, as a stream that waits at its end.

    Args:
        path: The file.
        idle_s: The stream ends when the file has not grown for this long, seconds.
        stop: Ends it at once.
    """

    def __init__(self, path: Path, idle_s: float, stop: threading.Event) -> None:
        self._file = path.open("rb", buffering=0)
        self._idle_s, self._stop = idle_s, stop
        self.waited = False

    def read(self, size: int) -> bytes:
        """At most ``size`` bytes; none at the end, or when the file has been cut short."""
        since_s = time.monotonic()
        while not self._stop.is_set():
            data = self._file.read(size)
            if data:
                return data
            self.waited = True
            if os.fstat(self._file.fileno()).st_size < self._file.tell():
                return b""
            if time.monotonic() - since_s > self._idle_s:
                return b""
            time.sleep(_POLL_S)
        return b""

    def close(self) -> None:
        """Release the file."""
        self._file.close()


_ADDRESS = re.compile(r"([a-z][a-z0-9+.-]*)://", re.IGNORECASE)


def shown(address: str) -> str:
    """An address as it may be written down: without user name, password and query.

    Example:
        >>> shown("rtsp://admin:secret@10.0.0.7:554/cab?token=x")
        'rtsp:/10.0.0.7:554/cab'
        >>> shown("ride.ts")
        'ride.ts'
    """
    match = _ADDRESS.match(address)
    if match is None:
        return address
    rest = address[match.end() :].partition("?")[0].partition("#")[0]
    host, slash, path = rest.partition("/")
    return f"{match[1].lower()}:/{host.rpartition('@')[2]}{slash}{path}"


def _check_address(address: str) -> bool:
    """Whether it is a network address; refuses what cannot be followed."""
    match = _ADDRESS.match(address)
    if match is not None:
        if match[1].lower() not in SCHEMES:
            raise BadInputError(
                f"cannot follow {match[1]}:// addresses; give {', '.join(SCHEMES)} or a file"
            )
        return True
    path = Path(address)
    if not path.exists():
        raise BadInputError(f"input {path} does not exist; start its recorder first")
    if not path.is_file():
        raise BadInputError(f"input {path} is no file; --follow takes a growing file or an address")
    return False
