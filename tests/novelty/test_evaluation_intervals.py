import math

import numpy as np
import pytest
import scipy.stats

from novelty import InputError
from novelty.evaluation import (
    bootstrap_interval,
    mcnemar,
    mcnemar_over_scans,
    proportion_interval,
    t_interval,
)

INTERVALS = (t_interval, bootstrap_interval)


def test_t_interval_equals_scipy(rng):
    values = rng.normal(0.9, 0.05, 12)
    found = t_interval(values, 0.9)
    expected = scipy.stats.t.interval(0.9, 11, values.mean(), scipy.stats.sem(values))
    np.testing.assert_allclose((found.low, found.high), expected, rtol=1e-12)
    assert found.count == 12


def test_bootstrap_interval_agrees_with_scipy(rng):
    values = rng.beta(9, 1, 20)
    found = bootstrap_interval(values, resamples=20_000)
    theirs = scipy.stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=rng)
    expected = theirs.confidence_interval
    np.testing.assert_allclose((found.low, found.high), expected, atol=0.003)


@pytest.mark.parametrize("interval", INTERVALS)
def test_intervals_hold_the_mean_as_often_as_they_say(interval, rng):
    held = 0
    for _ in range(400):
        found = interval(rng.normal(0.8, 0.1, 25), 0.9)
        held += found.low <= 0.8 <= found.high
    assert 0.84 < held / 400 < 0.95


def test_bootstrap_interval_stays_inside_the_range_of_the_values():
    values = [1.0] * 9 + [0.2]
    assert bootstrap_interval(values).high <= 1.0 < t_interval(values).high


def test_bootstrap_interval_is_repeatable(rng):
    values = rng.random(8)
    assert bootstrap_interval(values, seed=3) == bootstrap_interval(values, seed=3)
    assert bootstrap_interval(values, seed=3) != bootstrap_interval(values, seed=4)


@pytest.mark.parametrize("interval", INTERVALS)
def test_undefined_values_are_left_out(interval):
    assert interval([0.5, math.nan, 0.7]) == interval([0.5, 0.7])
    one, none = interval([math.nan, 0.5]), interval([math.nan])
    assert (one.mean, one.count, none.count) == (0.5, 1, 0)
    assert math.isnan(one.low)
    assert math.isnan(none.mean)
    assert str(one) == "0.500"
    assert str(interval([0.5, 0.5])) == "0.500 [0.500, 0.500]"


@pytest.mark.parametrize("interval", INTERVALS)
def test_bad_arguments_are_named(interval):
    with pytest.raises(InputError, match="between 0 and 1; got 95"):
        interval([0.1, 0.2], 95)
    with pytest.raises(InputError, match=r"shape \(R,\); got \(2, 1\)"):
        interval([[0.1], [0.2]])


def test_mcnemar_equals_binomial_test(rng):
    truth = rng.random(300) < 0.3
    first, second = truth ^ (rng.random(300) < 0.1), truth ^ (rng.random(300) < 0.2)
    ignore = rng.random(300) < 0.1
    found = mcnemar(truth, first, second, ignore)
    right = [(labels == truth) & ~ignore for labels in (first, second)]
    assert found.first_only == (right[0] & ~right[1]).sum()
    assert found.second_only == (right[1] & ~right[0]).sum()
    expected = scipy.stats.binomtest(found.first_only, found.first_only + found.second_only).pvalue
    assert found.p_value == pytest.approx(expected, rel=1e-9)
    assert found.p_value < 0.05


def test_mcnemar_of_a_method_with_itself_is_undecided(rng):
    truth, labels = rng.random(50) < 0.5, rng.random(50) < 0.5
    assert mcnemar(truth, labels, labels).p_value == 1.0


def test_mcnemar_is_symmetric_and_survives_whole_scans():
    truth = np.zeros(400_000, bool)
    better, worse = truth.copy(), truth.copy()
    worse[:60_000] = True
    better[60_000:61_000] = True
    there, back = mcnemar(truth, better, worse), mcnemar(truth, worse, better)
    assert (there.first_only, there.second_only) == (back.second_only, back.first_only) == (60_000, 1_000)
    assert there.p_value == back.p_value < 1e-300


def test_mcnemar_checks_its_arrays():
    with pytest.raises(InputError, match="predicted must have shape"):
        mcnemar([True, False], [True, False], [True])


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (3, 10), (10, 10), (1, 1), (57, 60)])
def test_a_proportion_has_the_interval_of_scipy(successes, trials):
    found = proportion_interval([True] * successes + [False] * (trials - successes), 0.9)
    expected = scipy.stats.binomtest(successes, trials).proportion_ci(0.9, method="wilson")
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert (found.mean, found.count) == (successes / trials, trials)


def test_correlated_points_are_no_evidence_but_repeated_scans_are(rng):
    """Both methods are equally good; each scan favours one of them at random, in all of its points at once."""
    rejected = {"points": 0, "scans": 0}
    for _ in range(300):
        tests = []
        for favoured in rng.random(12) < 0.5:
            truth = rng.random(200) < 0.5
            wrong = truth ^ (rng.random(200) < 0.3)
            first, second = (truth, wrong) if favoured else (wrong, truth)
            tests.append(mcnemar(truth, first, second))
        sums = [sum(getattr(test, name) for test in tests) for name in ("first_only", "second_only")]
        rejected["points"] += scipy.stats.binomtest(sums[0], sum(sums)).pvalue < 0.05
        rejected["scans"] += mcnemar_over_scans(tests) < 0.05
    assert rejected["points"] > 150
    assert rejected["scans"] < 30


def test_a_difference_that_every_scan_shows_is_significant_over_scans(rng):
    tests = []
    for _ in range(10):
        truth = rng.random(200) < 0.5
        tests.append(mcnemar(truth, truth ^ (rng.random(200) < 0.1), truth ^ (rng.random(200) < 0.3)))
    assert mcnemar_over_scans(tests) < 0.01
    assert mcnemar_over_scans(tests[:1]) == pytest.approx(0.317, abs=0.001)
    assert mcnemar_over_scans([mcnemar([True], [True], [True])]) == 1
