"""``railinspect inspect --follow``: one camera or growing file until it ends or is stopped."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from railinspect.errors import BadInputError

if TYPE_CHECKING:
    from railinspect.batch import Viewer
    from railinspect.inspect_settings import InspectSettings
    from railinspect.live import LiveSource
    from railinspect.pipeline import SegmentFunction
    from railinspect.progress import Report
    from railinspect.run_summary import RunSummary


def add_follow(parser: argparse.ArgumentParser) -> None:
    """Add ``--follow`` and what goes with it."""
    group = parser.add_argument_group("live")
    group.add_argument(
        "--follow",
        action="store_true",
        help="INPUT is an rtsp://, rtsps://, udp:// or tcp:// address or a file that is still "
        "being written: inspect its newest frames as they come; frames that would make it late are "
        "dropped and counted. Ctrl-C or SIGTERM ends the run in order.",
    )
    group.add_argument(
        "--idle",
        type=float,
        default=10.0,
        metavar="S",
        help="with --follow: end when nothing has come for S seconds (default: 10)",
    )
    group.add_argument(
        "--for",
        type=float,
        dest="duration_s",
        metavar="S",
        help="with --follow: end after S seconds (default: go on)",
    )
    group.add_argument(
        "--transport",
        choices=("tcp", "udp"),
        default="tcp",
        help="with --follow: how an RTSP camera sends (default: tcp)",
    )


def run_follow(
    options: argparse.Namespace,
    segmenter: SegmentFunction,
    settings: InspectSettings,
    report: Report,
    viewer: Viewer | None = None,
) -> RunSummary:
    """Follow the one input of the options.

    Raises:
        BadInputError: if there are several inputs, or nothing comes.
    """
    from railinspect.batch import inspect_live
    from railinspect.live import LiveSettings, LiveSource
    from railinspect.warmup import warm_up

    if len(options.inputs) != 1:
        raise BadInputError(
            f"--follow takes one input, not {len(options.inputs)}; start one run for each"
        )
    if settings.speed_log is not None:
        raise BadInputError("--follow cannot know the future speeds of a file; give --speed V")
    live = LiveSettings(
        idle_s=options.idle, duration_s=options.duration_s, rtsp_transport=options.transport
    )
    warm_up()  # before the first frame comes, not while it waits
    source = LiveSource(options.inputs[0], live)
    with stopped_by_signals(source):
        return inspect_live(
            source, options.out, segmenter, settings, progress=report, viewer=viewer
        )


@contextmanager
def stopped_by_signals(source: LiveSource) -> Iterator[None]:
    """Let the first interrupt or termination end the recording in order; the second is one."""

    def end(number: int, _: Any) -> None:
        source.stop()
        signal.signal(number, before[number])

    before: dict[int, Any] = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, end)
        yield
    finally:
        for known, handler in before.items():
            signal.signal(known, handler)


def input_of(text: str) -> Path | str:
    """An input as given: an address stays text, for a path would swallow one of its slashes."""
    return text if "://" in text else Path(text)
