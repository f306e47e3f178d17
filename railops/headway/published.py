"""The two characteristics printed in the paper (tables 1 and 2), dwell 20 s.

Baranov, Loginova, Ermakova, Zhang, "System for automatic construction of regulating
characteristics …", Transport Automation Research 10(3), 2024, 246–253.
"""

from __future__ import annotations

from railops.headway.characteristic import Characteristic

PUBLISHED_DWELL_S = 20.0

# Interval by run time of the second train, one group per run time of the train in front, all in s.
_MOSCOW = {
    159: {159: 84, 156: 85, 153: 87, 150: 90, 148: 91},
    156: {156: 82, 153: 83, 150: 87, 148: 88},
    153: {153: 81, 150: 84, 148: 85},
    150: {150: 81, 148: 82},
    148: {148: 80},
}
_ZHENGZHOU = {
    130: {130: 94, 125: 95, 120: 111, 115: 112, 110: 113, 105: 114, 100: 116, 95: 128},
    125: {125: 90, 120: 106, 115: 107, 110: 108, 105: 110, 100: 111, 95: 124},
    120: {120: 101, 115: 103, 110: 104, 105: 105, 100: 106, 95: 119},
    115: {115: 98, 110: 99, 105: 100, 100: 101, 95: 114},
    110: {110: 94, 105: 95, 100: 96, 95: 109},
    105: {105: 90, 100: 91, 95: 103},
    100: {100: 86, 95: 99},
    95: {95: 94},
}


def _table(groups: dict[int, dict[int, int]], name: str) -> Characteristic:
    rows = [
        (float(run), float(front), float(interval))
        for front, group in groups.items()
        for run, interval in group.items()
    ]
    return Characteristic.published(rows, PUBLISHED_DWELL_S, name)


MOSCOW = _table(_MOSCOW, "Moscow metro (paper, table 1)")
ZHENGZHOU = _table(_ZHENGZHOU, "Zhengzhou metro (paper, table 2)")
PUBLISHED = {"published-moscow": MOSCOW, "published-zhengzhou": ZHENGZHOU}
