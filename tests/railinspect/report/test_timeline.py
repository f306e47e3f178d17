from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from railinspect.report.summary import InputTimeline
from railinspect.report.timeline import nice_step, timeline_svg


@given(st.floats(1e-3, 1e5), st.integers(2, 12))
def test_steps_are_round_and_few(span, count):
    step = nice_step(span, count)
    assert span / step <= count * 1.0001 or step >= 7200
    assert step > 0


def event(number, first, last, kind="obstruction"):
    return {"id": number, "type": kind, "first_time_s": first, "last_time_s": last}


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.floats(0, 100), st.floats(0, 20)), max_size=30),
    st.floats(0, 50),
    st.floats(0, 200),
)
def test_any_events_can_be_drawn(spans, first_s, span_s):
    timeline = InputTimeline(first_s, first_s + span_s)
    timeline.points = {(index * 7 % 1000, 1): 10.0 + index for index in range(len(spans))}
    timeline.finish()
    events = [event(i + 1, a, a + length) for i, (a, length) in enumerate(spans)]
    svg = timeline_svg(timeline, events, [first_s])
    assert svg.count("<a href=") == len(events)
    assert "nan" not in svg
    assert svg.count("<g") == svg.count("</g>")


def test_types_from_a_file_are_escaped():
    timeline = InputTimeline(0.0, 10.0)
    timeline.finish()
    assert "<b>" not in timeline_svg(timeline, [event(1, 1.0, 2.0, '"><b>')], [])


def test_a_flag_stands_where_each_brake_fell_due():
    timeline = InputTimeline(0.0, 10.0)
    timeline.finish()
    due = event(1, 5.0, 8.0) | {"service_by_time_s": 2.0, "emergency_by_time_s": None}
    svg = timeline_svg(timeline, [due], [])
    assert svg.count('class="m-service"') == 1
    assert 'class="m-emergency"' not in svg
    assert "service braking for event 1 obstruction had to start at 0:02.0" in svg
    assert '<polygon points="246.0,' in svg  # 46 + 1000 · 2 s / 10 s
