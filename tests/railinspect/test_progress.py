from __future__ import annotations

import io

import pytest

from railinspect import progress
from railinspect.progress import ProgressLine


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_terminal_gets_one_line_with_rate_and_time_left(clock):
    stream = Terminal()
    line = ProgressLine("inspecting", stream)
    clock[0] += 10
    line.show(250, 0.25)
    text = stream.getvalue()
    assert text.startswith("\rinspecting")
    assert "25%" in text
    assert "25.0 frames/s" in text
    assert "30 s left" in text
    assert "\n" not in text
    line.close()
    assert stream.getvalue().endswith("\r\x1b[K")


def test_a_file_gets_a_plain_line_every_ten_seconds(clock):
    stream = io.StringIO()
    line = ProgressLine("inspecting", stream)
    for second in range(1, 31):
        clock[0] = 100.0 + second
        line.show(second, second / 60)
    line.close()
    assert stream.getvalue().count("\n") == 3
    assert "\r" not in stream.getvalue()


def test_without_a_known_length_there_is_no_guess(clock):
    stream = Terminal()
    line = ProgressLine("inspecting", stream)
    clock[0] += 1
    line.show(20, None)
    assert "left" not in stream.getvalue()


def test_quiet_is_silent(clock):
    stream = Terminal()
    line = ProgressLine("x", stream, quiet=True)
    clock[0] += 100
    line.show(5, 0.5)
    line.close()
    assert stream.getvalue() == ""
