"""A file for the Rerun viewer: pictures, rails, region, findings and ranges over media time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from railinspect.errors import BadInputError, OutputError
from railinspect.sinks.overlay import ACTION_RGB, STATUS_RGB, TYPE_RGB

if TYPE_CHECKING:
    from railinspect.records import FrameRecord, LocatedFinding
    from railinspect.source import Frame

JPEG_QUALITY: Final = 75
"""Quality of the stored pictures, 0 to 100."""

TIMELINE: Final = "media"
"""Name of the timeline of media times."""


class RerunFile:
    """Writes every frame given to it; one root per input.

    Args:
        path: The file to create, ``….rrd``.

    Raises:
        BadInputError: if ``rerun-sdk`` is not installed.
        OutputError: if the file exists or cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            import rerun
        except ImportError as error:
            raise BadInputError(
                "--rerun needs the package rerun-sdk; install railinspect[rerun]"
            ) from error
        path = Path(path)
        if path.exists():
            raise OutputError(f"{path} exists already; name another file, or delete it first")
        try:
            path.touch()
        except OSError as error:
            raise OutputError(
                f"cannot write {path}: {error.strerror or error}; choose a file in an existing "
                "folder you may write to"
            ) from error
        self._rr: Any = rerun
        self._stream = rerun.RecordingStream("railinspect")
        self._stream.save(str(path))

    def write(self, name: str, frame: Frame, record: FrameRecord) -> None:
        """Log one frame of an input and its record."""
        rr, log = self._rr, self._stream.log
        root = self._rr.escape_entity_path_part(name) if name else "input"
        self._stream.set_time(TIMELINE, duration=record.time_s)
        if record.stamp_ns is not None:
            self._stream.set_time("clock", timestamp=np.datetime64(record.stamp_ns, "ns"))
        bgr = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        log(f"{root}/picture", rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg"))
        rails = [r for r in (record.left_uv, record.right_uv) if len(r) > 1]
        log(f"{root}/picture/rails", rr.LineStrips2D(rails, colors=[(60, 225, 235)] * len(rails)))
        roi = [np.vstack([record.roi_uv, record.roi_uv[:1]])] if len(record.roi_uv) > 2 else []
        log(f"{root}/picture/region", rr.LineStrips2D(roi, colors=[(60, 150, 235)] * len(roi)))
        self._log_findings(root, record)
        log(
            f"{root}/status",
            rr.TextLog(
                record.status + (f": {record.reason}" if record.reason else ""),
                color=STATUS_RGB[record.status],
            ),
        )
        for value, what in ((record.reach_m, "reach_m"), (record.speed_mps, "speed_mps")):
            if value is not None:
                log(f"{root}/{what}", rr.Scalars(value))
        if record.advice is not None:
            log(
                f"{root}/advice",
                rr.TextLog(
                    f"{record.advice.action}: {record.advice.reason}",
                    color=ACTION_RGB[record.advice.action],
                ),
            )

    def _log_findings(self, root: str, record: FrameRecord) -> None:
        rr, log = self._rr, self._stream.log
        boxes = [found.finding.box_xyxy for found in record.findings]
        log(
            f"{root}/picture/findings",
            rr.Boxes2D(
                array=np.asarray(boxes, float).reshape(-1, 4),
                array_format=rr.Box2DFormat.XYXY,
                labels=[_label(found) for found in record.findings],
                colors=[TYPE_RGB[found.finding.type] for found in record.findings],
            ),
        )
        for found in record.findings:
            if found.range is not None and found.event_id is not None:
                path = f"{root}/range_m/event-{found.event_id}"
                log(path, rr.Scalars(found.range.range_m))

    def close(self) -> None:
        """Finish the file."""
        self._stream.disconnect()


def _label(found: LocatedFinding) -> str:
    event = "" if found.event_id is None else f"#{found.event_id} "
    distance = "" if found.range is None else f" {found.range.range_m:.0f} m"
    return f"{event}{found.finding.type}{distance}"


@contextmanager
def opened_viewer(path: Path | None) -> Iterator[RerunFile | None]:
    """A Rerun file that is finished on leaving; None where none is wanted."""
    if path is None:
        yield None
        return
    file = RerunFile(path)
    try:
        yield file
    finally:
        file.close()
