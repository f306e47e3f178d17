"""Columns of the tables that say what lies on the ground, for those who fill and who read them."""

from __future__ import annotations

# Columns of the zone table: a strip of ground along the track.
ZONE_LOW, ZONE_HIGH, ZONE_R, ZONE_G, ZONE_B, ZONE_GRAIN, ZONE_KIND, ZONE_LABEL, ZONE_MARK = range(9)
# Columns of the crossing table: a road across the track.
CROSS_NEAR, CROSS_FAR, CROSS_R, CROSS_G, CROSS_B, CROSS_MARK = range(6)
# Columns of the per-track table.
(
    TRACK_BED_HALF,
    TRACK_SLEEPER_PITCH,
    TRACK_SLEEPER_WIDTH,
    TRACK_SLEEPER_HALF,
    TRACK_SLEEPER_R,
    TRACK_SLEEPER_G,
    TRACK_SLEEPER_B,
    TRACK_SHINE,
    TRACK_HEAD_R,
    TRACK_HEAD_G,
    TRACK_HEAD_B,
    TRACK_EMBEDDED,
) = range(12)
# Columns of the disturbance table: lateral displacement of the ego rails.
WAVE_START, WAVE_LENGTH, WAVE_AMPLITUDE, WAVE_PERIOD, WAVE_LEFT, WAVE_RIGHT = range(6)
# Entries of the look vector.
(
    LOOK_BED_R,
    LOOK_BED_G,
    LOOK_BED_B,
    LOOK_BED_GRAIN,
    LOOK_RUST_R,
    LOOK_RUST_G,
    LOOK_RUST_B,
    LOOK_SUN_SIDE,
    LOOK_SHADOW,
    LOOK_DAPPLE,
    LOOK_WEEDS,
    LOOK_WET,
    LOOK_OIL,
    LOOK_SHADE_FROM,
    LOOK_SHADE_TO,
    LOOK_SKY,
) = range(16)
