"""What keeps a frame from being called clear although nothing was found in it.

Two things do, beside a track that cannot be followed:

1. **A suspicion.** Something stands on the track that the segmentation is not sure of
   (``Finding.doubt``). In one frame of a video this is mostly the play of light on the ballast, so
   it has to last as a finding has to last to become an event, and come nearer as what stands does.
2. **A lost event.** Something was found, cannot have been passed yet, and is not seen any more.

The rules of :mod:`railinspect.events` tell what is one thing in successive frames.
"""

from __future__ import annotations

from railinspect.events import EventSettings, EventTracker, Sighting


class Suspicions:
    """Follows sure and doubtful sightings through a recording, apart from its events.

    Args:
        settings: When sightings are one thing, and when it lasts.
    """

    def __init__(self, settings: EventSettings | None = None) -> None:
        self._tracker = EventTracker(settings)

    def update(
        self,
        frame_index: int,
        time_s: float,
        sightings: tuple[Sighting, ...],
        why: tuple[str | None, ...],
        ego_speed_mps: float | None = None,
        vanishing_uv: tuple[float, float] | None = None,
        seen_speed_mps: float | None = None,
    ) -> str | None:
        """Take in one frame.

        Args:
            frame_index: Index of the frame, rising.
            time_s: Its media time, seconds, rising.
            sightings: Its findings, sure and doubtful ones.
            why: For each doubtful one what it may be and why it may not; None for sure ones.
            ego_speed_mps: The train's speed, m/s, >= 0; None if unknown.
            vanishing_uv: Vanishing point of the track, pixels; None if unknown.
            seen_speed_mps: The speed as the picture shows it, m/s; None if unknown.

        Returns:
            What may stand on the track in this frame, beside what surely does; None where nothing
            lasts that might.
        """
        if not sightings and not self._tracker.following:
            return None
        update = self._tracker.update(
            frame_index, time_s, sightings, ego_speed_mps, vanishing_uv, seen_speed_mps
        )
        seen = {number for number, text in zip(update.ids, why, strict=True) if text is None}
        for text, number, doubt in zip(why, update.ids, update.doubts, strict=True):
            if number is not None and number not in seen and doubt is None:
                return f"perhaps {text}"
        return None
