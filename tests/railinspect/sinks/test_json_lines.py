from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railinspect.sinks.json_lines import JsonLines, read_json_lines

names = st.text(st.characters(codec="utf-8"), max_size=8)
values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8")),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=4,
)


lines = st.lists(st.dictionaries(names, values, max_size=3), max_size=5)


@settings(max_examples=40)
@given(lines)
def test_what_is_written_is_read(tmp_path_factory, items):
    path = tmp_path_factory.mktemp("lines") / "a.jsonl"
    sink = JsonLines(path)
    for item in items:
        sink.write(item)
    sink.close()
    assert list(read_json_lines(path)) == items


def test_a_line_cut_short_is_left_out(tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text('{"a":1}\n{"a":2}\n{"a":', encoding="utf-8")
    assert list(read_json_lines(path)) == [{"a": 1}, {"a": 2}]


def test_numbers_that_json_lacks_are_refused(tmp_path):
    sink = JsonLines(tmp_path / "a.jsonl")
    with pytest.raises(ValueError, match="not JSON compliant"):
        sink.write({"a": float("nan")})
    sink.close()


def test_text_stays_readable(tmp_path):
    sink = JsonLines(tmp_path / "a.jsonl")
    sink.write({"name": "Zürich – ü"})
    sink.close()
    text = (tmp_path / "a.jsonl").read_text(encoding="utf-8")
    assert "Zürich – ü" in text
    assert json.loads(text)["name"] == "Zürich – ü"
