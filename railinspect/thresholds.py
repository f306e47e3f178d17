"""Every threshold a finding depends on, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass, replace

from railinspect.labels import (
    CAR,
    CONSTRUCTION,
    FENCE,
    ON_RAILS,
    POLE,
    TRAFFIC_LIGHT,
    TRAFFIC_SIGN,
    TRUCK,
)


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of :func:`railinspect.findings.find`.

    Pixel lengths are those of a 640 pixels wide image and scale with the width: they stand for
    what the segmentation can resolve.

    Attributes:
        clearance_m: Half-width of the clearance envelope for things, metres from the centre line.
            Half a vehicle's width; platform edges lie at about 1.65–1.75 m, and what stands on
            lower ground beside the track appears up to 0.3 m nearer to it than it is.
        core_m: What stays farther out than this and runs along the track is a structure beside
            it, metres, and so is what stands behind a crest, whose foot is hidden;
        along_m: it runs along if it does so for at least this long, metres.
        foot_m: Height of the ground things stand on, metres above the rail tops.
        person_clearance_m: The same for people. A person on a platform appears farther out than
            they stand, because the platform is higher than the plane of the rails.
        reach_share: Things are looked for up to this multiple of the reach of the rails: a thing
            hides the rails it stands on from its foot upwards.
        foreign: Classes that have no business on a track, besides people.
        least_width_m: Least width across the track inside the envelope, metres.
        least_height_m: Least height, metres.
        vehicle_m: Least height of a car, a lorry or a rail vehicle, metres.
        person_height_m: Least height of a person, metres (sitting, lying across).
        least_area_px: Least area, pixels.
        least_confidence: How sure the segmentation must be of a thing at least, 0..1
            (:func:`railinspect.findings.looks.sureness`);
        person_confidence: the same of a person;
        least_doubt: what is below it is doubtful from this on, and nothing where still less sure.
        least_spacing_px: Where the rails are closer than this, things are too small to judge.
        far_spacing_px: Where they are closer than this, the path is sure to a metre at best, and
            only what hides the rails and stands across the centre line counts,
        far_centre_m: reaching so far to both sides of it, metres.
        crest_m: Where the ground ends all across the track and so far to both sides of it, metres,
            a structure that begins there is doubtful: it stands behind a crest, nobody knows where,
        crest_spacing_px: unless the rails are this far apart there, pixels: so near it counts.
        least_foot_px: Least width of a body with its foot inside the envelope, pixels.
        deep_m: A thing at the envelope's edge must come this far inside it, metres,
        deep_px: and this far in pixels at right angles to the track in the image.
        level_m: Foot lines whose heights differ by no more are feet of one body, metres,
        stride_m: if no more than this is between them, metres: a cow's legs.
        overhang_m: What meets the ground's image higher than that and less than this above the foot
            of something it hangs together with is a part of that (an arm, a signal's head), metres,
        overhang_width_m: unless it is wider than this or farther aside: a log behind a railing
            meets the ground's image above the railing's near end too. Metres.
        inside_share: Least share of the body's innermost foot line that lies inside the envelope,
            unless it is ``wide_m`` wide inside it.
        wide_m: Metres inside the envelope that count whatever lies outside.
        bend_px: Least deviation of the rails from the smooth track, pixels: of 1.5 px in the image
            the mean of some measured rows shows a little less.
        bend_m: Least deviation, metres.
        bend_noise: Least deviation as a multiple of the segmentation's own scatter.
        bend_rows: Least number of sampled rows of a deviation.
        bend_sure_rows: Rows of a deviation in which both rails are seen alone, and none where the
            smooth track runs, that make it sure although other rails cross beside it.
        bend_length_m: Least length of a deviation along the track, metres.
        bend_one_rail: Factor on the deviation where only one rail shows it.
        bend_spacing_px: Rails are judged only where they are this far apart across the track.
        bend_join_m: Deviations closer than this along the track are one distortion, metres.
        bend_step_px: Largest jump between neighbouring rows of a rail that bends alone, pixels;
            more is another rail that was mistaken for it.
        bend_vacant: A sample with something else like a rail beside it counts all the same where
            the smooth track's own place holds less than this share of the rails' probability.
        bend_slope: Both rails may bend by this much more per metre along the track, metres: more
            is a jump to or from another track's rail.
        switch_agreement: Where another track's rail lies beside ours both rails must deviate alike,
            the weaker by at least this share of the stronger. One rail alone says nothing there.
        ripple_rows: Rows over which the rails' common swing is averaged.
        ripple_share: Root mean square of that swing as a share of the least deviation.
        ripple_doubt: Largest share of doubtful samples in it.
        ripple_beside_px: A doubtful sample farther off than this, pixels, takes part only where no
            rail lies on the smooth track.
        gap_m: Least length of a hole in both rails that counts as an interruption, metres.
        gap_px: Least height of such a hole, pixels.
        gap_spacing_px: Rails must be this far apart at the hole, pixels: far away holes are the
            segmentation's own.
        gap_contrast: Least rail probability just before and just after the hole.
        seen_again: Least probability of anything at a finding's place, by close-ups of it;
        seen_perhaps: a finding below that is doubtful from this on, and nothing below this.
        seen_named: share of anything they show that makes a single picture's finding of one type
            one of another.
        watch_from_m: Nearest and
        watch_to_m: farthest range of the few places close-ups are taken of in every frame of a
            recording, metres.
        searches: Whether close-ups are taken all along the track instead, which a recording has no
            time for. Then they also find
        seen_both: what the masks show by :meth:`weaker` thresholds, from this probability on,
        seen_alone: and what they do not show at all, at two places side by side;
        seen_bent: the same of distortions, which the masks may hide by following them, where a
            metre across the track takes up
        bent_metre_px: this many pixels of the picture, whatever its width: an eighth of a metre
            is then 1.5 of them.
    """

    clearance_m: float = 1.5
    core_m: float = 0.85
    along_m: float = 4.0
    foot_m: float = -0.15
    person_clearance_m: float = 2.0
    reach_share: float = 1.03
    foreign: tuple[int, ...] = (
        CONSTRUCTION,
        FENCE,
        POLE,
        TRAFFIC_LIGHT,
        TRAFFIC_SIGN,
        CAR,
        TRUCK,
        ON_RAILS,
    )
    least_width_m: float = 0.20
    least_height_m: float = 0.25
    vehicle_m: float = 0.7
    person_height_m: float = 0.60
    least_area_px: float = 14.0
    least_confidence: float = 0.65
    person_confidence: float = 0.65
    least_doubt: float = 0.5
    least_spacing_px: float = 5.0
    far_spacing_px: float = 9.0
    far_centre_m: float = 0.3
    crest_m: float = 4.0
    crest_spacing_px: float = 14.0
    least_foot_px: float = 2.0
    deep_m: float = 0.25
    deep_px: float = 1.5
    level_m: float = 0.25
    stride_m: float = 1.6
    overhang_m: float = 3.0
    overhang_width_m: float = 1.2
    inside_share: float = 0.5
    wide_m: float = 0.8
    bend_px: float = 1.25
    bend_m: float = 0.03
    bend_noise: float = 3.0
    bend_rows: int = 3
    bend_sure_rows: int = 4
    bend_length_m: float = 0.8
    bend_one_rail: float = 1.8
    bend_spacing_px: float = 6.0
    bend_join_m: float = 5.0
    bend_step_px: float = 1.2
    bend_vacant: float = 0.5
    bend_slope: float = 0.2
    switch_agreement: float = 0.7
    ripple_rows: int = 7
    ripple_share: float = 0.75
    ripple_doubt: float = 0.5
    ripple_beside_px: float = 1.5
    gap_m: float = 1.0
    gap_px: float = 8.0
    gap_spacing_px: float = 16.0
    gap_contrast: float = 0.6
    seen_again: float = 0.4
    seen_perhaps: float = 0.2
    seen_named: float = 0.8
    watch_from_m: float = 18.0
    watch_to_m: float = 60.0
    searches: bool = False
    seen_both: float = 0.8
    seen_alone: float = 0.98
    seen_bent: float = 0.98
    bent_metre_px: float = 12.0

    def weaker(self) -> Thresholds:
        """What is worth a second look: too unsure or too small to be a finding by itself."""
        return replace(
            self,
            least_confidence=0.5 * self.least_confidence,
            person_confidence=0.5 * self.person_confidence,
            least_doubt=0.4 * self.least_doubt,
            bend_px=0.7 * self.bend_px,
            bend_noise=0.7 * self.bend_noise,
            bend_one_rail=0.7 * self.bend_one_rail,
        )

    def still(self) -> Thresholds:
        """For a single picture: no second one can make sure, so what is doubtful is a finding.

        People are taken for such at less: the network sees few where there are none. A rail that
        bends alone has to bend more: a drop of water on the lens does that to one, and no frame
        after it shows that it stays on the lens. And close-ups are taken all along the track, and
        believed from less on, of what is bent above all.
        """
        return replace(
            self,
            searches=True,
            seen_alone=min(self.seen_alone, 0.9),
            seen_bent=min(self.seen_bent, 0.4),
            least_confidence=min(self.least_confidence, self.least_doubt),
            person_confidence=min(self.person_confidence, 0.43),
            bend_one_rail=max(self.bend_one_rail, 3.0),
        )
