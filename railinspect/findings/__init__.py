"""What is wrong with the track in one frame: distorted rails, things on it, people on it.

Nothing here reads the input image: findings come from the segmentation's classes and from the
track's geometry, in metres on the plane of the rails, and are held against close-ups of the track
where the segmentation brings some (:mod:`railinspect.findings.second_look`). A frame whose track is
not followed may still have findings; without any it is unknown, not clear
(``TrackGeometry.followed``).
"""

from __future__ import annotations

from railinspect.findings.distortions import find_distortions
from railinspect.findings.finding import Finding, FindingType
from railinspect.findings.interruptions import find_interruptions
from railinspect.findings.looks import blur
from railinspect.findings.place import place_on_track
from railinspect.findings.second_look import reviewed, searched, watched
from railinspect.findings.things import find_things
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import SegmentationLike, TrackGeometry

_USUAL = Thresholds()

__all__ = ["Finding", "FindingType", "find", "place_on_track"]


def find(
    segmentation: SegmentationLike, track: TrackGeometry, thresholds: Thresholds | None = None
) -> tuple[Finding, ...]:
    """Judge one frame.

    Args:
        segmentation: Masks of the frame.
        track: The track in it, from the same masks.
        thresholds: Limits; defaults are stated there.

    Returns:
        Findings, nearest first, the doubtful ones among them; none without a path.
    """
    if track.path is None or track.profile is None or len(track.path.uv) < 4:
        return ()
    thresholds = thresholds or _USUAL
    found = _by_masks(segmentation, track, thresholds)
    look = getattr(segmentation, "close_ups", None)  # what is no ``Segmentation`` has none
    if look is not None and thresholds.searches:
        weak = _by_masks(segmentation, track, thresholds.weaker())
        found = searched(found, weak, look(track), track, thresholds)
    elif look is not None:
        found = reviewed(found, look, track, thresholds) if found else found
        found = watched(found, look, track, thresholds) if track.followed else found
    return tuple(sorted(found, key=lambda f: -f.foot_uv[1]))


def _by_masks(
    segmentation: SegmentationLike, track: TrackGeometry, thresholds: Thresholds
) -> list[Finding]:
    assert track.profile is not None
    found = find_things(segmentation, track, thresholds)
    uv = track.profile.uv
    share = blur(segmentation, 0.5 * (uv[:, 0] + uv[:, 1]))
    found += find_distortions(track, thresholds, share)
    sure = [finding for finding in found if finding.doubt is None]
    found += find_interruptions(segmentation, track, thresholds, sure)
    return found
