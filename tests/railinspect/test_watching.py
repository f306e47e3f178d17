"""What operators watch a run by says the same as the run, and never half of it."""

from __future__ import annotations

import argparse
import json
import logging
import threading
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from railinspect import metrics as metrics_module
from railinspect import progress_stream
from railinspect.errors import BadInputError, OutputError
from railinspect.logs import log_to, note
from railinspect.metrics import Metrics, MetricsEndpoint, MetricsFile
from railinspect.progress import Progress
from railinspect.progress_stream import ProgressStream
from railinspect.watching import add_watching, watch

HALF = Progress(
    'ride "one"\\\n2',
    frames=250,
    share=0.5,
    unknown_frames=3,
    events=2,
    dropped_frames=7,
    latency_s=0.125,
    inputs=4,
    inputs_done=1,
    inputs_bad=1,
)


def families(text: str) -> dict[str, float]:
    """Values by sample name, as Prometheus' own parser reads them."""
    return {
        sample.name: sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def lines(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    for module in (metrics_module, progress_stream):
        monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def test_prometheus_reads_every_count(clock):
    metrics = Metrics()
    clock[0] += 10
    metrics.show(HALF)
    text = metrics.text()
    seen = families(text)
    assert seen["railinspect_frames_total"] == 250
    assert seen["railinspect_unknown_frames_total"] == 3
    assert seen["railinspect_dropped_frames_total"] == 7
    assert seen["railinspect_events_total"] == 2
    assert seen["railinspect_latency_seconds"] == 0.125
    assert seen["railinspect_inputs_done"] == 1
    assert seen["railinspect_inputs_bad"] == 1
    assert seen["railinspect_frames_per_second"] == pytest.approx(25.0)
    assert seen["railinspect_running"] == 1
    (info,) = [
        sample
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.name == "railinspect_input_info"
    ]
    assert info.labels == {"input": HALF.name}
    metrics.end(complete=False)
    assert families(metrics.text())["railinspect_running"] == 0
    assert families(metrics.text())["railinspect_complete"] == 0


def test_what_is_not_known_is_left_out_not_zero():
    metrics = Metrics()
    metrics.show(Progress("a", 1, None))
    assert "railinspect_latency_seconds" not in families(metrics.text())
    assert "railinspect_progress_ratio" not in families(metrics.text())


def test_a_reader_of_the_metrics_file_never_sees_half_of_it(tmp_path):
    path = tmp_path / "a.prom"
    metrics = Metrics()
    file = MetricsFile(path, metrics, every_s=0.0)
    stop, whole = threading.Event(), []

    def read() -> None:
        while not stop.is_set():
            whole.append(path.read_text(encoding="utf-8").endswith("\n"))

    reader = threading.Thread(target=read)
    reader.start()
    for count in range(300):
        metrics.show(Progress("x" * (count % 50), count, None))
        file.refresh(due=False)
    stop.set()
    reader.join()
    assert all(whole)
    assert families(path.read_text())["railinspect_frames_total"] == 299
    assert [p.name for p in tmp_path.iterdir()] == ["a.prom"]


def test_the_file_is_renewed_only_when_due(tmp_path, clock):
    metrics = Metrics()
    file = MetricsFile(tmp_path / "a.prom", metrics)
    metrics.show(HALF)
    clock[0] += 4
    file.refresh(due=False)
    assert "railinspect_frames_total" not in families((tmp_path / "a.prom").read_text())
    clock[0] += 2
    file.refresh(due=False)
    assert families((tmp_path / "a.prom").read_text())["railinspect_frames_total"] == 250


def test_the_endpoint_serves_metrics_and_nothing_else():
    metrics = Metrics()
    metrics.show(HALF)
    endpoint = MetricsEndpoint("127.0.0.1:0", metrics)
    try:
        root = f"http://127.0.0.1:{endpoint.port}"
        with urllib.request.urlopen(root + "/metrics") as answer:
            assert families(answer.read().decode())["railinspect_frames_total"] == 250
            assert answer.headers["Content-Type"].startswith("text/plain")
        with pytest.raises(urllib.error.HTTPError, match="404") as refused:
            urllib.request.urlopen(root + "/etc/passwd")
        refused.value.close()
        with pytest.raises(BadInputError, match="choose another port"):
            MetricsEndpoint(f"127.0.0.1:{endpoint.port}", metrics)
    finally:
        endpoint.close()


@pytest.mark.parametrize("address", ["9464", "a b:1", "127.0.0.1:99999", "::1:80"])
def test_a_malformed_address_is_one_sentence(address):
    with pytest.raises(BadInputError, match="give HOST:PORT"):
        MetricsEndpoint(address, Metrics())


def test_progress_lines_come_once_a_second_and_say_the_end(tmp_path, clock):
    path = tmp_path / "progress.jsonl"
    stream = ProgressStream(path)
    for _ in range(30):
        clock[0] += 0.1
        stream.show(HALF)
    stream.close(complete=True)
    rows = lines(path)
    assert [row["state"] for row in rows] == ["running"] * 3 + ["done"]
    assert rows[-1]["frames"] == 250
    assert rows[-1]["dropped_frames"] == 7
    assert rows[0]["left_s"] == pytest.approx(rows[0]["elapsed_s"], abs=0.1)  # half is done
    assert rows[-1]["left_s"] is None


def test_a_run_that_fails_says_stopped(tmp_path):
    options = options_for("--progress", tmp_path / "p.jsonl", "--metrics", tmp_path / "m.prom")

    def fail() -> None:
        with watch(options, "inspecting") as report:
            report(HALF)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert lines(tmp_path / "p.jsonl")[-1]["state"] == "stopped"
    assert families((tmp_path / "m.prom").read_text())["railinspect_complete"] == 0
    assert families((tmp_path / "m.prom").read_text())["railinspect_frames_total"] == 250


def options_for(*arguments: object) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_watching(parser)
    return parser.parse_args([str(one) for one in arguments])


def test_quiet_prints_nothing(capsys):
    with watch(options_for("--quiet"), "inspecting") as report:
        report(HALF)
    assert capsys.readouterr() == ("", "")


def test_progress_on_standard_error_replaces_the_line(capsys):
    with watch(options_for("--progress", "-"), "inspecting") as report:
        report(HALF)
    out, err = capsys.readouterr()
    assert out == ""
    assert [json.loads(line)["state"] for line in err.splitlines()] == ["running", "done"]


def test_a_log_line_is_one_line_whatever_a_name_contains(tmp_path):
    path = tmp_path / "log.jsonl"
    with log_to(path):
        note("input ended", input='evil"\n{"level":"error"}\udc80', frames=3, ratio=float("nan"))
        note("input bad", level=logging.ERROR, reason=Path("a"), message="mine")
    note("heard by nobody", frames=1)
    first, second = lines(path)
    assert first["message"] == "input ended"
    assert first["level"] == "info"
    assert first["frames"] == 3
    assert first["ratio"] is None
    assert first["input"].startswith('evil"\n')
    assert second["level"] == "error"
    assert second["message"] == "input bad"  # a field cannot pose as the message
    assert second["reason"] == "a"


@pytest.mark.parametrize("option", ["--progress", "--metrics", "--log"])
def test_a_file_that_cannot_be_written_is_one_sentence(tmp_path, option):
    def enter() -> None:
        with watch(options_for(option, tmp_path / "none" / "a"), "inspecting"):
            pass

    with pytest.raises(OutputError, match="existing folder"):
        enter()
