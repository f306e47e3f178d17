"""Files spoilt in every way a hand or a program can: read, or refused in one sentence, no crash."""

import copy
import itertools
import json
import math
import random

import pytest
import yaml

from railops import cli
from railops.braking import Policy, Train
from railops.errors import FileError
from railops.headway import load_section
from railops.headway.interchange import osrd_section, railtoolkit_path, railtoolkit_train
from railops.headway.lines import load_line
from railops.pilot.commands import read_route
from tests.railops.test_headway_files import GOOD, PATH, TRAIN
from tests.railops.test_pilot_commands import SHORT

INFRASTRUCTURE = {
    "track_sections": [
        {"id": "t0", "length": 1000.0, "curves": [],
         "slopes": [{"begin": 200, "end": 600, "gradient": -10}]},
        {"id": "t1", "length": 1500.0, "slopes": [],
         "curves": [{"begin": 0, "end": 500, "radius": -400}]},
    ],
    "speed_sections": [{"id": "v", "speed_limit": 15.0, "track_ranges": [
        {"track": "t1", "begin": 0, "end": 1500, "applicable_directions": "BOTH"}]}],
    "detectors": [{"id": "d", "track": "t0", "position": 250.0}],
}  # fmt: skip
SIMPLE = {
    "trains": [
        {"id": "a", "simplified_characteristics": {
            "length": 100, "acceleration": 0.9, "deceleration": -0.8, "coasting": -0.02,
            "speed_limit": 80}},
    ],
}  # fmt: skip
LINE = {
    "sections": ["published-zhengzhou"],
    "trains": [
        {"name": "1", "depart_s": 0, "run_s": [120], "dwell_s": [20]},
        {"depart_s": 95, "run_s": [120], "dwell_s": [20], "late_s": 5, "dwell_delay_s": [3]},
    ],
}


def read_osrd(path):
    return osrd_section(path, ["t0", "-t1"], 100.0, 1600.0)


READERS = {
    "section": (yaml.safe_load(GOOD), load_section),
    "line": (LINE, load_line),
    "railtoolkit path": (yaml.safe_load(PATH), railtoolkit_path),
    "railtoolkit train": (yaml.safe_load(TRAIN), railtoolkit_train),
    "railtoolkit simple train": (SIMPLE, railtoolkit_train),
    "OSRD": (INFRASTRUCTURE, read_osrd),
    "route": (yaml.safe_load(SHORT), read_route),
}
ODD = [
    None,
    "x",
    "",
    -1,
    0,
    math.nan,
    math.inf,
    [],
    {},
    [[]],
    [None],
    1e300,
    True,
    {"a": 1},
    10**400,
]


def places(node, place=()):
    yield place
    items = node.items() if isinstance(node, dict) else enumerate(node)
    for key, value in items:
        if isinstance(value, (dict, list)):
            yield from places(value, (*place, key))
        else:
            yield (*place, key)


def spoil(document, rng):
    """One value replaced, scaled, renamed, doubled or left out."""
    document = copy.deepcopy(document)
    *way, last = rng.choice([place for place in places(document) if place])
    node = document
    for key in way:
        node = node[key]
    draw = rng.random()
    if draw < 0.6:
        node[last] = copy.deepcopy(rng.choice(ODD))
    elif draw < 0.75:
        del node[last]
    elif draw < 0.9 and isinstance(node[last], (int, float)):
        node[last] *= rng.choice([-1, 1e-6, 1e6, 0.5, 2])
    elif isinstance(node, dict):
        node[rng.choice(["unheard of", 3])] = node.pop(last)
    else:
        node.append(copy.deepcopy(node[last]))
    return document


@pytest.mark.parametrize("name", READERS)
def test_a_spoilt_file_is_read_or_refused_in_one_sentence(name, tmp_path):
    document, read = READERS[name]
    path = tmp_path / "input.yaml"
    rng, refusals = random.Random(name), []
    for _ in range(60):
        spoilt = spoil(document, rng)
        # JSON is YAML too, but for its names of what is no number.
        text = json.dumps(spoilt) if name == "OSRD" else yaml.safe_dump(spoilt)
        path.write_text(text, encoding="utf-8")
        try:
            read(path)
        except FileError as error:
            refusals.append(str(error))
    assert len(refusals) > 20
    assert all("\n" not in words and "input.yaml" in words for words in refusals)


def read_train(path):
    return Train.load(path, 20.0)


SETTINGS = {
    "section": load_section,
    "line": load_line,
    "railtoolkit path": railtoolkit_path,
    "route": read_route,
    "train": read_train,
    "policy": Policy.load,
}
ALIASES = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n"
    for old, new in itertools.pairwise("abcdefghij")
)
HOSTILE = {
    "nothing": "",
    "a list": "[1, 2]",
    "no text": "\0",
    "a billion values": ALIASES,
    "a list within itself": "a: &a [*a]",
    "a deep nest": "a: " + "[" * 20_000,
    "no date": "a: 2001-99-99",
    "no truth": "a: !!bool x",
    "no time": "a: !!timestamp x",
    "no number": "a: !!int x",
    "a number of 5000 digits": "a: " + "1" * 5000,
    "a program": "a: !!python/object/apply:os.system ['true']",
}


@pytest.mark.parametrize("kind", SETTINGS)
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_text_is_refused_in_one_sentence(name, kind, tmp_path):
    path = tmp_path / "input.yaml"
    path.write_text(HOSTILE[name], encoding="utf-8")
    with pytest.raises(FileError, match=r"input\.yaml") as caught:
        SETTINGS[kind](path)
    assert "\n" not in str(caught.value)


def test_a_value_of_any_size_in_a_train_file_is_refused(tmp_path):
    path = tmp_path / "input.yaml"
    path.write_text("mass_t: 0x" + "f" * 5000, encoding="utf-8")
    with pytest.raises(FileError, match=r"input\.yaml"):
        read_train(path)
    path.write_text("length_m: 0x" + "f" * 5000, encoding="utf-8")
    with pytest.raises(FileError, match=r"incomplete or mistyped"):
        read_train(path)


def test_a_complaint_is_one_line_of_a_readable_length(tmp_path, capsys):
    path = tmp_path / "line.yaml"
    path.write_text("sections: [moscow]\ntrains: [" + "x" * 5000 + "]", encoding="utf-8")
    assert cli.main(["headway", "line", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) <= 401
    assert "expected a mapping" in said
