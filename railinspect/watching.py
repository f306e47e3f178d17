"""What operators watch a run by: the line on screen, progress lines, metrics and logs.

One group of options for every command that inspects, and one callback that feeds all of it::

    add_watching(parser)
    ...
    with watch(options, "inspecting") as report:
        inspect_inputs(..., progress=report)
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from railinspect.logs import STANDARD_ERROR, log_to
from railinspect.metrics import Metrics, MetricsEndpoint, MetricsFile
from railinspect.progress import Progress, ProgressLine, Report
from railinspect.progress_stream import ProgressStream


def add_watching(parser: argparse.ArgumentParser) -> None:
    """Add ``--quiet``, ``--progress``, ``--metrics``, ``--metrics-at`` and ``--log``."""
    group = parser.add_argument_group("watching a run")
    group.add_argument(
        "--quiet", action="store_true", help="print nothing but errors (and --json's document)"
    )
    group.add_argument(
        "--progress",
        metavar="FILE",
        help="append the progress to FILE as JSON lines, one a second; - for standard error",
    )
    group.add_argument(
        "--metrics",
        metavar="FILE",
        help="keep FILE up to date in Prometheus' text format, renamed into place every 5 s",
    )
    group.add_argument(
        "--metrics-at",
        metavar="HOST:PORT",
        help="serve /metrics over HTTP, such as 127.0.0.1:9464",
    )
    group.add_argument(
        "--log",
        metavar="FILE",
        help="append structured logs to FILE as JSON lines; - for standard error",
    )


@contextmanager
def watch(options: argparse.Namespace, title: str) -> Iterator[Report]:
    """The callback that feeds everything the options ask for; ends it all on leaving.

    Raises:
        OutputError: if a file cannot be written.
        BadInputError: if the address cannot be served.
    """
    quiet = options.quiet or STANDARD_ERROR in (options.progress, options.log)
    metrics = Metrics()
    with ExitStack() as stack:
        if options.log:
            stack.enter_context(log_to(options.log))
        line = ProgressLine(title, quiet=quiet)
        stream = ProgressStream(options.progress) if options.progress else None
        complete = False
        try:
            if options.metrics_at:
                endpoint = MetricsEndpoint(options.metrics_at, metrics)
                stack.callback(endpoint.close)
            file = MetricsFile(options.metrics, metrics) if options.metrics else None

            def report(progress: Progress) -> None:
                line.show(progress.frames, progress.share)
                metrics.show(progress)
                if stream is not None:
                    stream.show(progress)
                if file is not None:
                    file.refresh(due=False)

            try:
                yield report
                complete = True
            finally:
                line.close()
                metrics.end(complete)
                if file is not None:
                    file.refresh()
        finally:
            if stream is not None:
                stream.close(complete)
