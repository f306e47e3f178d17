"""The decision: golden situations, monotonicity over 10 000 random ones, doubt, bad input."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from railops.braking import Advice, Brake, Policy, RangeMeasurement, Train, decide
from railops.braking.decision import SEVERITY
from railops.errors import CannotStopError, DomainError, MeasurementError, RailOpsError
from railops.traction import Adhesion, Davis, Line


def seen(range_m, std_m=1.0, time_s=0.0, channel="onboard", half=2.0):
    return RangeMeasurement(time_s, range_m, std_m, (range_m - half, range_m + half), channel)


PLAIN = Train(
    20.0,
    davis=Davis(0.0, 0.0, 0.0),
    speed_error_rel=0.0,
    service=Brake(0.5, 1.0, 0.0),
    emergency=Brake(1.0, 0.0, 0.0),
)
BARE = Policy(
    range_sigmas=0.0,
    measurements=1,
    stop_error_m=0.0,
    stop_error_rel=0.0,
    stand_off_m=0.0,
    reaction_s=0.0,
    warn_s=5.0,
)


def test_limits_worked_by_hand():
    # 20²/(2·1) = 200 m; 20·1 + 20²/(2·0.5) = 420 m; 420 + 5·20 = 520 m.
    advice = decide([seen(500.0, half=0.0)], PLAIN, BARE)
    assert advice.emergency_at_m == pytest.approx(200.0, abs=1e-6)
    assert advice.service_at_m == pytest.approx(420.0, abs=1e-6)
    assert advice.warn_at_m == pytest.approx(520.0, abs=1e-6)
    assert advice.margin_m == pytest.approx(80.0, abs=1e-6)
    assert advice.margin_s == pytest.approx(4.0, abs=1e-6)


@pytest.mark.parametrize(
    ("range_m", "action"), [(521, "none"), (519, "warn"), (419, "service"), (199, "emergency")]
)
def test_actions_at_their_limits(range_m, action):
    assert decide([seen(range_m, half=0.0)], PLAIN, BARE).action == action


def test_protective_section_of_the_paper():
    # Eq. 6 with ΔS_max = 3 m, ΔL_max = 20 % of 2 km: available 1600 m, required 423 m.
    policy = replace(BARE, stop_error_m=3.0, range_error_rel=0.2)
    advice = decide([seen(2000.0)], PLAIN, policy)
    assert advice.available_m == pytest.approx(1600.0)
    assert advice.required_m == pytest.approx(423.0, abs=1e-6)
    assert (advice.stop_error_m, advice.range_error_m) == pytest.approx((3.0, 400.0), abs=1e-6)


def test_advice_says_its_protective_section_and_what_that_achieves():
    # S = 420 m: ΔS_max = 0.05·420 + 3 m. The first range is 0.2 s old, 4 m run: ΔL_max = 3·2 + 4.
    policy = replace(BARE, stop_error_m=3.0, stop_error_rel=0.05, stand_off_m=5.0, reaction_s=0.5)
    policy = replace(policy, range_sigmas=3.0, stop_exceedance=1e-9, exceedance=1e-4)
    ranges = [seen(600.0, std_m=2.0), seen(600.0, std_m=2.0, time_s=0.2)]
    advice = decide(ranges, PLAIN, policy)
    assert advice.required_m == pytest.approx(420.0 + 24.0 + 5.0 + 10.0, abs=1e-6)
    assert (advice.stop_error_m, advice.range_error_m) == pytest.approx((24.0, 10.0), abs=1e-6)
    assert advice.exceedance == pytest.approx(1e-8)
    assert advice.collision_bound == pytest.approx(1.1e-8)
    blind = decide([], PLAIN, policy, perception_unknown=True)
    assert (blind.range_error_m, blind.collision_bound) == (None, 1.0)


def test_smallest_measurement_governs_and_is_carried_forward():
    ranges = [seen(500.0, time_s=0.0), seen(495.0, time_s=0.5), seen(503.0, time_s=0.9)]
    advice = decide(ranges, PLAIN, BARE, time_s=1.0)
    assert advice.available_m == pytest.approx(500.0 - 2.0 - 20.0)
    assert advice.governed_by == ranges[0]
    assert advice.used == 3
    assert advice.exceedance == pytest.approx(1e-6)


def test_unknown_perception_takes_the_cautious_branch():
    advice = decide([], PLAIN, BARE, perception_unknown=True)
    assert (advice.action, advice.available_m, advice.margin_s) == ("service", None, None)
    near = decide([seen(50.0)], PLAIN, BARE, perception_unknown=True)
    assert near.action == "emergency"
    assert "unknown" in near.reason


def test_doubt_raises_a_warning_to_the_cautious_branch():
    assert decide([seen(480.0)], PLAIN, BARE).action == "warn"
    assert decide([seen(480.0)], PLAIN, BARE, perception_unknown=True).action == "service"


def test_invalid_and_stale_measurements_are_doubt():
    nothing = RangeMeasurement(0.0, math.nan, math.nan, (math.nan, math.nan), valid=False)
    assert decide([nothing], PLAIN, BARE).action == "service"
    stale = decide([seen(5000.0)], PLAIN, BARE, time_s=3.0)
    assert (stale.action, stale.used) == ("service", 0)
    near_and_stale = decide([seen(250.0)], PLAIN, BARE, time_s=3.0)
    assert near_and_stale.action == "emergency"


def test_too_few_measurements_warn():
    policy = replace(BARE, measurements=4)
    advice = decide([seen(5000.0)], PLAIN, policy)
    assert advice.action == "warn"
    assert "1 of 4" in advice.reason


def test_contradicting_channels_are_reported_and_the_near_one_wins():
    advice = decide([seen(900.0), seen(400.0, channel="wayside")], PLAIN, BARE)
    assert advice.action == "service"
    assert advice.governed_by.channel == "wayside"
    assert advice.contradictions == ("onboard says 898.0–902.0 m, wayside says 398.0–402.0 m",)
    assert decide([seen(400.0), seen(401.0, channel="wayside")], PLAIN, BARE).contradictions == ()


def test_milder_braking_on_a_curve_only_if_asked_for():
    train = replace(PLAIN, line=Line.uniform(radius_m=400.0))
    assert decide([seen(50.0)], train, BARE).action == "emergency"
    mild = decide([seen(50.0)], train, replace(BARE, mild_on_curves=True))
    assert mild.action == "service"
    assert "curve" in mild.reason


def test_a_standing_train_needs_no_brake():
    advice = decide([seen(3.0)], replace(PLAIN, speed_mps=0.0), BARE)
    assert (advice.action, advice.margin_s) == ("none", math.inf)


def test_json_has_no_infinities():
    advice = decide([seen(3.0)], replace(PLAIN, speed_mps=0.0), BARE)
    document = json.loads(json.dumps(advice.as_dict(), allow_nan=False))
    assert document["governed_by"]["range_m"] == 3.0
    assert document["margin_s"] is None


def test_json_from_numpy_numbers_and_an_open_interval():
    number = np.float32(80.0)
    measured = RangeMeasurement(np.float32(1.0), number, number, (number, np.inf))
    document = json.loads(json.dumps(decide([measured], PLAIN, BARE).as_dict(), allow_nan=False))
    assert document["governed_by"]["interval_m"] == [80.0, None]


def test_runaway_raises_and_still_advises():
    train = replace(PLAIN, line=Line.uniform(-0.15))
    with pytest.raises(CannotStopError, match=r"cannot stop: the gradient pulls .* runs away") as e:
        decide([seen(500.0)], train, BARE)
    assert e.value.advice.action == "emergency"
    assert isinstance(e.value, ValueError)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: decide([], PLAIN), r"ranges is empty; expected at least one"),
        (lambda: decide([seen(9, time_s=1.0), seen(9, time_s=0.5)], PLAIN), r"rising order, in s"),
        (
            lambda: decide([seen(9, time_s=1.0)], PLAIN, time_s=0.5),
            r"time_s is 0.5 s; expected not",
        ),
        (lambda: decide([seen(9)], PLAIN, time_s=math.nan), r"time_s is nan s"),
        (lambda: seen(math.nan), r"range_m is nan m; expected a number in \[0, 100000\] m"),
        (lambda: seen(-1.0), r"range_m is -1.0 m"),
        (lambda: RangeMeasurement(0.0, 5.0, 1.0, (6.0, 7.0)), r"interval_m is \(6.0, 7.0\)"),
        (lambda: Policy(when_unknown="brake"), r"when_unknown is brake; expected one of"),
        (lambda: Policy(warn_s=-1.0), r"warn_s is -1.0 s; expected a number in \[0, 3600\] s"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(DomainError, match=message):
        call()


def test_error_tree():
    assert issubclass(MeasurementError, DomainError)
    assert issubclass(DomainError, ValueError)
    assert issubclass(CannotStopError, RailOpsError)


def situation(rng):
    """A random train, policy and measurements over the whole useful range."""
    gradient = rng.uniform(-0.03, 0.03, 3)
    curves = ((0.0, math.inf), (rng.uniform(1, 900), rng.uniform(200, 2000)))
    line = Line(((0.0, gradient[0]), (300.0, gradient[1]), (700.0, gradient[2])), curves)
    service = rng.uniform(0.45, 1.0)
    train = Train(
        rng.uniform(0.0, 60.0) if rng.random() > 0.02 else 0.0,
        position_m=rng.uniform(0.0, 500.0),
        line=line,
        length_m=rng.uniform(10.0, 400.0),
        adhesion=Adhesion(rng.uniform(0.4, 1.0)),
        service=Brake(service, rng.uniform(0, 2), rng.uniform(0, 4)),
        emergency=Brake(service * rng.uniform(1.0, 1.8), rng.uniform(0, 2), rng.uniform(0, 3)),
        speed_error_rel=rng.uniform(0.0, 0.1),
    )
    ranges = []
    for time_s in np.sort(rng.uniform(0.0, 2.0, rng.integers(1, 6))):
        std = rng.uniform(0.1, 20.0)
        range_m = rng.uniform(0.0, 2500.0)
        ranges.append(
            RangeMeasurement(
                float(time_s),
                range_m,
                std,
                (range_m - 2 * std, range_m + 2 * std),
                str(rng.choice(["onboard", "wayside"])),
                bool(rng.random() > 0.05),
            )
        )
    policy = Policy(
        range_error_rel=rng.uniform(0, 0.3),
        range_sigmas=rng.uniform(0, 4),
        measurements=int(rng.integers(1, 5)),
        mild_on_curves=bool(rng.random() < 0.3),
    )
    return ranges, train, policy


def worse(rng, ranges, train, policy):
    """The same situation with one argument made worse; which one, and the new situation."""
    which = str(rng.choice(["nearer", "faster", "brake", "delay", "adhesion", "interval", "std"]))
    size = rng.uniform(0.0, 1.0) ** 2
    chosen = int(rng.integers(len(ranges)))
    m = ranges[chosen]
    if which == "nearer":
        m = replace(m, range_m=m.range_m * (1 - size), interval_m=(-1e9, m.interval_m[1]))
        m = replace(m, interval_m=(min(m.range_m, ranges[chosen].interval_m[0]), m.interval_m[1]))
    elif which == "interval":
        low, high = m.interval_m
        m = replace(m, interval_m=(low - 100 * size, high + 100 * size))
    elif which == "std":
        m = replace(m, std_m=m.std_m + 50 * size)
    elif which == "faster":
        train = replace(train, speed_mps=train.speed_mps + 20 * size)
    elif which == "adhesion":
        train = replace(train, adhesion=Adhesion(train.adhesion.factor * (1 - 0.2 * size)))
    else:
        name = str(rng.choice(["service", "emergency"]))
        brake = getattr(train, name)
        if which == "brake":
            brake = brake.scaled(1 - 0.1 * size)
        else:
            brake = replace(brake, delay_s=brake.delay_s + size, build_up_s=brake.build_up_s + size)
        train = replace(train, **{name: brake})
    ranges = [*ranges[:chosen], m, *ranges[chosen + 1 :]]
    return which, ranges, train, policy


def advise(ranges, train, policy) -> Advice:
    try:
        return decide(ranges, train, policy)
    except CannotStopError as error:
        return error.advice


def test_never_milder_for_a_worse_situation_in_10000_random_ones():
    rng = np.random.default_rng(20211227)
    seen_actions = dict.fromkeys(SEVERITY, 0)
    changed = 0
    for _ in range(10_000):
        before = situation(rng)
        which, *after = worse(rng, *before)
        mild, strict = advise(*before), advise(*after)
        seen_actions[mild.action] += 1
        changed += mild.action != strict.action
        context = (which, before, after)
        assert SEVERITY[strict.action] >= SEVERITY[mild.action], context
        if mild.margin_m is not None:
            # A millimetre for the integrator; required is inf where the train cannot stop.
            assert strict.margin_m <= mild.margin_m + 1e-3, context
        for value in (mild.required_m, mild.available_m, mild.margin_m, mild.margin_s):
            assert value is None or not math.isnan(value), context
        for value in (mild.stop_error_m, mild.range_error_m, mild.collision_bound):
            assert value is None or value >= 0.0, context
    # The sample must exercise the decision: every action occurs, and many pairs change it.
    assert min(seen_actions.values()) > 300
    assert changed > 300
