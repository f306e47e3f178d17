"""A run's state in Prometheus' text format, as a file renamed into place or over HTTP.

The format is that of https://prometheus.io/docs/instrumenting/exposition_formats/ (version 0.0.4).
"""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Final

from railinspect.errors import BadInputError, OutputError
from railinspect.progress import Progress

EVERY_S: Final = 5.0
"""The file is renewed at most this often, seconds; a node exporter reads every 15 s or so."""

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

Reader = Callable[[Progress], float | None]

_METRICS: Final[tuple[tuple[str, str, str, Reader], ...]] = (
    ("frames_total", "counter", "Frames inspected.", lambda p: p.frames),
    (
        "unknown_frames_total",
        "counter",
        "Frames in which nothing can be said.",
        lambda p: p.unknown_frames,
    ),
    ("events_total", "counter", "Events that ended.", lambda p: p.events),
    (
        "dropped_frames_total",
        "counter",
        "Frames of a live source that were not inspected.",
        lambda p: p.dropped_frames,
    ),
    (
        "latency_seconds",
        "gauge",
        "From the last live frame's arrival to its record.",
        lambda p: p.latency_s,
    ),
    ("inputs", "gauge", "Inputs of the run.", lambda p: p.inputs),
    ("inputs_done", "gauge", "Inputs that are finished.", lambda p: p.inputs_done),
    ("inputs_bad", "gauge", "Inputs that could not be read.", lambda p: p.inputs_bad),
    ("progress_ratio", "gauge", "Share of all inputs that is done, 0 to 1.", lambda p: p.share),
)


class Metrics:
    """The state that is published; fed by a run, read from any thread."""

    def __init__(self) -> None:
        self._start_s, self._start_unix_s = time.monotonic(), time.time()
        self._now: Progress | None = None
        self._updated_unix_s = self._start_unix_s
        self._running = True
        self._complete = False

    def show(self, progress: Progress) -> None:
        """Take in how far the run is."""
        self._now, self._updated_unix_s = progress, time.time()

    def end(self, complete: bool) -> None:
        """The run is over; ``complete`` is False where it was interrupted or failed."""
        self._running, self._complete = False, complete

    def text(self) -> str:
        """The metrics in Prometheus' text format; what is not known is left out."""
        now = self._now
        values: list[tuple[str, str, str, float | None]] = [
            (name, kind, help_, None if now is None else read(now))
            for name, kind, help_, read in _METRICS
        ]
        elapsed_s = max(time.monotonic() - self._start_s, 1e-6)
        rate = now.frames / elapsed_s if now else 0.0
        values += [
            ("frames_per_second", "gauge", "Frames inspected per second of the run.", rate),
            ("running", "gauge", "1 while the run goes on.", float(self._running)),
            (
                "complete",
                "gauge",
                "1 once the run has ended without being interrupted.",
                float(self._complete),
            ),
            ("start_time_seconds", "gauge", "Unix time of the start.", self._start_unix_s),
            (
                "updated_time_seconds",
                "gauge",
                "Unix time of the last frame's record; a value that stands still is a stall.",
                self._updated_unix_s,
            ),
        ]
        lines: list[str] = []
        for name, kind, help_, value in values:
            if value is not None:
                full = f"railinspect_{name}"
                lines += [f"# HELP {full} {help_}", f"# TYPE {full} {kind}", f"{full} {value!r}"]
        if now is not None:
            lines += [
                "# HELP railinspect_input_info Name of the present input.",
                "# TYPE railinspect_input_info gauge",
                f'railinspect_input_info{{input="{escaped(now.name)}"}} 1',
            ]
        return "\n".join(lines) + "\n"


def escaped(label: str) -> str:
    r"""A label's value as the format wants it.

    Example:
        >>> print(escaped('a "b"' + chr(10) + "c"))
        a \"b\"\nc
    """
    return label.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


class MetricsFile:
    """Renews a text file by atomic rename, so that a reader never sees half of it.

    Args:
        path: The file, usually ``NAME.prom`` in a node exporter's textfile folder.
        metrics: What to write.
        every_s: At most one renewal in this wall-clock time, seconds.

    Raises:
        OutputError: if it cannot be written.
    """

    def __init__(self, path: str | Path, metrics: Metrics, every_s: float = EVERY_S) -> None:
        self._path, self._metrics, self._every_s = Path(path), metrics, every_s
        self._written_s = -float("inf")
        self.refresh()

    def refresh(self, due: bool = True) -> None:
        """Write the file; with ``due`` False only if it is old enough."""
        now_s = time.monotonic()
        if not due and now_s - self._written_s < self._every_s:
            return
        self._written_s = now_s
        # A name that no collector takes for a finished file, and no other run uses.
        part = self._path.with_name(f".{self._path.name}.{os.getpid()}.part")
        try:
            part.write_text(self._metrics.text(), encoding="utf-8")
            part.replace(self._path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise OutputError(
                f"cannot write metrics to {self._path}: {error.strerror or error}; choose a file "
                "in an existing folder you may write to"
            ) from error


_ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9.-]*|\[[0-9A-Fa-f:]+\]):(?P<port>[0-9]{1,5})")


class MetricsEndpoint:
    """Serves ``/metrics`` over HTTP in a background thread.

    Args:
        address: ``HOST:PORT``; an empty host is this machine alone, port 0 any free one.
        metrics: What to serve.

    Raises:
        BadInputError: if the address is malformed or taken.
    """

    def __init__(self, address: str, metrics: Metrics) -> None:
        match = _ADDRESS.fullmatch(address)
        if match is None or int(match["port"]) > 65535:
            raise BadInputError(
                f"metrics address is {address!r}; give HOST:PORT, such as 127.0.0.1:9464"
            )

        class Handler(BaseHTTPRequestHandler):
            timeout = 10  # seconds; a silent client must not hold a thread for ever

            def do_GET(self) -> None:
                """Answer a scrape."""
                found = self.path.split("?")[0] == "/metrics"
                body = metrics.text().encode() if found else b"see /metrics\n"
                self.send_response(200 if found else 404)
                self.send_header("Content-Type", CONTENT_TYPE)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *arguments: object) -> None:
                """A scrape is no news."""

        host = match["host"].strip("[]") or "127.0.0.1"
        try:
            self._server = ThreadingHTTPServer((host, int(match["port"])), Handler)
        except OSError as error:
            raise BadInputError(
                f"cannot serve metrics at {address}: {error.strerror or error}; choose another port"
            ) from error
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.1,), name="railinspect-metrics", daemon=True
        )
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that is listened on."""
        return int(self._server.server_address[1])

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
