"""``railops braking …``: each command, its JSON, and one sentence for bad input."""

import json

import pytest

from railops.braking import Train
from railops.cli import Result, json_ready, main


def run(capsys, *arguments):
    status = main(["braking", *arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def document(capsys, *arguments, status=0):
    found, out, err = run(capsys, *arguments, "--json")
    assert (found, err) == (status, "")
    assert out.count("\n") == 1  # exactly one JSON document
    return json.loads(out)


def test_trials(capsys):
    table = document(capsys, "trials")["table"]
    assert [row["trials"] for row in table[:3]] == [230, 459, 688]
    assert document(capsys, "trials", "--p", "1e-8")["trials"] == 230258509
    assert "independent" in run(capsys, "trials", "--p", "1e-4")[1]


def test_bound(capsys, tmp_path):
    assert document(capsys, "bound", "--trials", "459", "--confidence", "0.99")["p_max"] < 1e-2
    errors = tmp_path / "errors.csv"
    errors.write_text("error_m\n" + "\n".join(str(i / 100) for i in range(500)))
    found = document(capsys, "bound", "--errors", str(errors), "--p", "0.01")
    assert found["error_max_m"] == 4.98
    assert found["exceedances"] == 1


PROTECT = "protect --stop-error-m 12 --range-error-m 400 --range-exceedance 1e-2 --speed-mps 20"


def test_protect_and_its_exit_status(capsys):
    good = document(capsys, *PROTECT.split(), "--stop-exceedance", "4e-9", "--measurements", "5")
    assert good["met"]
    assert good["length_m"] == pytest.approx(12 + 400 + 0.5 * 20)
    assert good["product_as_printed"] < good["collision_if_normal"] < good["collision_bound"]
    assert good["measurements_needed"] == 4
    shared = ("--stop-exceedance", "0.6", "--common-cause", "0.5")
    hopeless = document(capsys, *PROTECT.split(), *shared, status=1)
    assert (hopeless["measurements_needed"], hopeless["collision_if_normal"]) == (None, None)
    bad = document(capsys, *PROTECT.split(), "--stop-exceedance", "1e-2", status=1)
    assert not bad["met"]
    assert bad["product_as_printed"] < 1e-9 < bad["collision_bound"]
    two = document(
        capsys,
        *PROTECT.split(),
        "--stop-exceedance",
        "1e-9",
        "--measurements",
        "3",
        "--second",
        "2",
    )
    assert two["range_exceedance"] == pytest.approx(1e-10)
    assert two["collision_if_normal"] < two["collision_bound"]


def test_simulate(capsys):
    found = document(
        capsys,
        "simulate",
        "--speed-mps",
        "20",
        "--stops",
        "20000",
        "--tail",
        "1e-6",
        "--beyond-m",
        "290",
        "--samples",
        "4000",
        "--gradient-permille",
        "-5",
    )
    levels = [q["q"] for q in found["quantiles"]]
    assert levels == [0.5, 0.9, 0.99, 0.999]
    values = [q["value"] for q in found["quantiles"]]
    assert values == sorted(values)
    assert found["tail"]["distance_m"] > values[-1]
    assert found["beyond"]["agrees"]
    assert "cannot certify" in found["fits"]["pearson_moments"]["caution"]
    assert "nominal" in run(capsys, "simulate", "--speed-mps", "20", "--stops", "2000")[1]


def test_curves(capsys):
    found = document(capsys, "curves", "--speed-mps", "30", "--target-m", "2000")
    assert len(found["ebd_m"]) == 11
    assert found["indication_m"][-1] < found["permitted_m"][-1] < found["ebi_m"][-1] < 2000
    assert "permitted_m" in run(capsys, "curves", "--speed-mps", "30", "--target-m", "2000")[1]


def test_decide(capsys, tmp_path):
    near = document(capsys, "decide", "--speed-mps", "20", "--range-m", "200")
    assert near["action"] == "emergency"
    assert near["governed_by"]["range_m"] == 200.0
    ranges = tmp_path / "ranges.csv"
    ranges.write_text(
        "time_s,range_m,std_m,channel,valid\n0,800,2,onboard,1\n0.1,798,2,wayside,1\n"
    )
    policy = tmp_path / "policy.yaml"
    policy.write_text("measurements: 2\nwarn_s: 0.0\n")
    far = document(
        capsys, "decide", "--speed-mps", "20", "--ranges", str(ranges), "--policy", str(policy)
    )
    assert far["action"] == "none"
    assert far["used"] == 2
    blind = document(capsys, "decide", "--speed-mps", "20", "--unknown")
    assert (blind["action"], blind["available_m"]) == ("service", None)


def test_decide_that_cannot_stop_says_so_and_advises(capsys):
    arguments = ("decide", "--speed-mps", "20", "--range-m", "500", "--gradient-permille", "-200")
    found = document(capsys, *arguments, status=1)
    assert found["action"] == "emergency"
    assert "runs away" in found["reason"]
    assert "emergency braking at any distance" in found["would_change"]


def test_target_and_worst(capsys, tmp_path):
    Train(20.0).save(tmp_path / "train.yaml")
    found = document(capsys, "target", "--train", str(tmp_path / "train.yaml"), "--runs", "50")
    assert found["speed"]["lowest_m"] < 0 < found["acceleration"]["highest_m"]
    worst = ("worst", "--speed-mps", "15", "--tolerance-permille", "2", "--mean-permille", "0.5")
    assert document(capsys, *worst)["overrun_m"] > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("decide --range-m 300", "--speed-mps is missing; expected a speed in m/s"),
        ("decide --speed-mps 200 --range-m 300", "speed_mps is 200.0 m/s; expected"),
        ("decide --speed-mps 20", "ranges is empty; expected at least one measurement"),
        ("decide --speed-mps 20 --ranges missing.csv", "cannot read range file missing.csv"),
        ("decide --speed-mps 20 --policy missing.yaml", "cannot read policy file missing.yaml"),
        ("bound", "--trials, --errors is both or neither; expected exactly one"),
        ("bound --trials 5 --p 1e-4", "that needs 23025 trials"),
        ("bound --trials five", "invalid int value: 'five'"),
        ("curves --speed-mps 30 --target-m 900 --gradient-permille -80", "it runs away"),
        ("simulate --speed-mps 20 --stops 0", "stops is 0"),
        ("simulate --speed-mps 20 --threads 0", "threads is 0; expected a number in [1, 1024]"),
        ("target --speed-mps 20 --gradient-permille -200", "the train cannot stop"),
        ("trials --p 0.01 --confidence 1", "confidence is 1.0; expected a number in (0, 1)"),
        (f"{PROTECT} --stop-exceedance 1e-9 --target nan", "target is nan; expected"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(capsys, arguments, message):
    status, out, err = run(capsys, *arguments.split())
    assert (status, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_bad_range_file(capsys, tmp_path):
    path = tmp_path / "ranges.csv"
    path.write_text("time_s,range_m\n0,5\n")
    status, _, err = run(capsys, "decide", "--speed-mps", "20", "--ranges", str(path))
    assert status == 2
    assert "line 2: needs numbers in time_s, range_m, std_m" in err


def test_help_names_units_and_defaults(capsys):
    assert main(["braking", "simulate", "--help"]) == 0
    text = capsys.readouterr().out
    assert "speed, m/s" in text
    assert "(default: 1000000)" in text


def test_json_ready_drops_what_json_lacks():
    assert json_ready({"a": float("inf"), "b": (1, float("nan"))}) == {"a": None, "b": [1, None]}
    assert json_ready(Result({}, "t")) == {"document": {}, "text": "t", "passed": True}
