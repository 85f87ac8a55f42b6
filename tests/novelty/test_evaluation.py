import math
import pickle

import numpy as np
import pytest
import scipy.stats
import sklearn.metrics
from hypothesis import example, given
from hypothesis import strategies as st

from novelty import InputError
from novelty.evaluation import METRICS, Agreement, ContingencyTable, Scores, evaluate, evaluate_labels
from novelty.evaluation.metrics import log_p_value

SMALL = st.integers(0, 40)
ANY_SIZE = st.one_of(SMALL, st.integers(0, 10**12))
# Each row and each column holds at least one point, so that everything is defined.
FULL_TABLES = st.tuples(ANY_SIZE, ANY_SIZE, ANY_SIZE, ANY_SIZE).filter(
    lambda t: (t[0] + t[1]) * (t[2] + t[3]) * (t[0] + t[2]) * (t[1] + t[3]) > 0
)
SMALL_TABLES = st.tuples(SMALL, SMALL, SMALL, SMALL).filter(
    lambda t: (t[0] + t[1]) * (t[2] + t[3]) * (t[0] + t[2]) * (t[1] + t[3]) > 0
)


def scores_of(counts):
    return Scores.from_table(ContingencyTable(*counts))


def labels_of(counts):
    truth = np.repeat([True, True, False, False], counts)
    predicted = np.repeat([True, False, True, False], counts)
    return truth, predicted


def naive_entropy(labels):
    shares = np.unique(labels, return_counts=True, axis=0)[1] / len(labels)
    return -sum(share * math.log(share) for share in shares)


@given(SMALL_TABLES)
def test_scores_agree_with_scikit_learn_scipy_and_naive_entropies(counts):
    truth, predicted = labels_of(counts)
    scores = evaluate(truth, predicted)
    expected = scipy.stats.chi2_contingency(np.reshape(counts, (2, 2)), correction=False)
    entropies = naive_entropy(truth) + naive_entropy(predicted)
    shared = entropies - naive_entropy(np.stack([truth, predicted], axis=1))
    assert scores.kappa == pytest.approx(sklearn.metrics.cohen_kappa_score(truth, predicted), abs=1e-12)
    assert scores.mcc == pytest.approx(sklearn.metrics.matthews_corrcoef(truth, predicted), abs=1e-12)
    assert scores.precision == pytest.approx(sklearn.metrics.precision_score(truth, predicted), abs=1e-12)
    assert scores.recall == pytest.approx(sklearn.metrics.recall_score(truth, predicted), abs=1e-12)
    assert scores.f1 == pytest.approx(sklearn.metrics.f1_score(truth, predicted), abs=1e-12)
    assert scores.iou == pytest.approx(sklearn.metrics.jaccard_score(truth, predicted), abs=1e-12)
    assert scores.chi2 == pytest.approx(expected.statistic, rel=1e-9, abs=1e-12)
    assert scores.p_value == pytest.approx(expected.pvalue, rel=1e-9)
    assert scores.cramers_v == pytest.approx(math.sqrt(expected.statistic / len(truth)), abs=1e-12)
    assert scores.uncertainty == pytest.approx(2 * shared / entropies, abs=1e-12)


@given(FULL_TABLES)
@example((10**12, 1, 1, 10**12))
@example((1, 10**12, 10**12, 10**12))
def test_kappa_and_uncertainty_never_exceed_cramers_v(counts):
    scores = scores_of(counts)
    assert abs(scores.kappa) <= scores.cramers_v + 1e-9
    assert scores.uncertainty <= scores.cramers_v + 1e-9
    assert scores.cramers_v <= 1 + 1e-12
    assert scores.uncertainty >= 0
    assert scores.cramers_v == pytest.approx(abs(scores.mcc), abs=1e-12)


@given(FULL_TABLES)
def test_exchanging_truth_and_answer_leaves_the_symmetric_scores(counts):
    there, back = scores_of(counts), scores_of((counts[0], counts[2], counts[1], counts[3]))
    for name in ("kappa", "cramers_v", "uncertainty", "f1", "iou", "mcc"):
        assert getattr(there, name) == pytest.approx(getattr(back, name), abs=1e-12)
    assert there.precision == back.recall


@given(st.integers(1, 10**12), st.integers(1, 10**12))
def test_a_perfect_answer_scores_one(novel, not_novel):
    scores = scores_of((novel, 0, 0, not_novel))
    for name in ("kappa", "cramers_v", "uncertainty", "precision", "recall", "f1", "iou", "mcc"):
        assert getattr(scores, name) == pytest.approx(1, abs=1e-12)
    assert scores.chi2 == pytest.approx(novel + not_novel)
    assert scores.level is Agreement.ALMOST_COMPLETE
    assert not scores.reasons


@given(*[st.integers(1, 10**5)] * 4)
def test_an_independent_answer_scores_zero(a, b, c, d):
    scores = scores_of((a * c, a * d, b * c, b * d))
    for name in ("kappa", "cramers_v", "uncertainty", "chi2", "mcc"):
        assert getattr(scores, name) == 0
    assert scores.p_value == pytest.approx(1)
    assert scores.level is Agreement.NO


def test_an_opposite_answer_disagrees_completely():
    scores = scores_of((0, 5, 5, 0))
    assert (scores.kappa, scores.mcc, scores.cramers_v) == (-1, -1, 1)
    assert scores.uncertainty == pytest.approx(1)


def test_the_probability_of_chance_survives_underflow():
    table = ContingencyTable(500_000, 100, 100, 500_000)
    assert Scores.from_table(table).p_value == 0
    assert log_p_value(table) == pytest.approx(-Scores.from_table(table).chi2 / 2, rel=1e-3)
    moderate = ContingencyTable(30, 10, 12, 40)
    assert math.exp(log_p_value(moderate)) == pytest.approx(
        scipy.stats.chi2.sf(Scores.from_table(moderate).chi2, 1), rel=1e-10
    )


@pytest.mark.parametrize(
    ("counts", "undefined", "reason"),
    [
        ((0, 0, 3, 4), {"kappa", "cramers_v", "uncertainty", "recall", "f1", "iou", "mcc", "chi2", "p_value"},
         "no point is novel in the ground truth"),
        ((3, 4, 0, 0), {"kappa", "cramers_v", "uncertainty", "mcc", "chi2", "p_value"},
         "every point is novel in the ground truth"),
        ((0, 3, 0, 4), {"cramers_v", "mcc", "chi2", "p_value", "precision"}, "no point was called novel"),
        ((3, 0, 4, 0), {"cramers_v", "mcc", "chi2", "p_value"}, "every point was called novel"),
        ((0, 0, 0, 0), {metric.name for metric in METRICS}, "no point is scored"),
    ],
)  # fmt: skip
def test_an_empty_class_gives_nan_and_says_why(counts, undefined, reason):
    scores = scores_of(counts)
    assert {metric.name for metric in METRICS if math.isnan(getattr(scores, metric.name))} == undefined
    assert scores.reasons == dict.fromkeys(undefined, reason)
    assert (scores.level is Agreement.UNDEFINED) == ("kappa" in undefined)


def test_finding_nothing_where_there_is_something_scores_zero_not_nan():
    scores = scores_of((0, 30, 0, 400))
    assert (scores.kappa, scores.uncertainty, scores.recall, scores.f1, scores.iou) == (0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("kappa", "level"),
    [(-1, "no"), (0.1, "no"), (0.11, "weak"), (0.4, "weak"), (0.6, "clear"), (0.61, "strong"),
     (0.8, "strong"), (0.81, "almost complete"), (1, "almost complete"), (math.nan, "undefined")],
)  # fmt: skip
def test_levels_of_agreement_are_those_of_table_1(kappa, level):
    assert Agreement.of(kappa) == level


def test_ignored_points_do_not_count(rng):
    truth, predicted, ignore = rng.random((3, 500)) < 0.4
    assert evaluate(truth, predicted, ignore) == evaluate(truth[~ignore], predicted[~ignore])
    assert evaluate(truth, predicted, ignore) != evaluate(truth, predicted)


def test_every_metric_is_a_field_described_once():
    scores = scores_of((5, 4, 3, 2))
    assert len({metric.name for metric in METRICS}) == len(METRICS)
    for metric in METRICS:
        assert getattr(scores, metric.name) == metric.function(scores.table)
        assert metric.description
    row = scores.to_dict()
    assert row["true_positives"] == 5
    assert row["level"] == str(scores.level)
    assert pickle.loads(pickle.dumps(scores)) == scores


def test_labels_score_changed_against_unchanged_and_report_the_rest_apart():
    labels = np.array([0, 0, 0, 1, 1, 2, 2, 2, 255])
    predicted = np.array([0, 0, 1, 1, 0, 1, 0, 0, 1], bool)
    result = evaluate_labels(labels, predicted)
    assert result.scores.table == ContingencyTable(1, 1, 1, 2)
    assert result.seen_once_called_novel == pytest.approx(1 / 3)
    assert (result.num_seen_once, result.num_ambiguous) == (3, 1)
    assert math.isnan(evaluate_labels([0, 1], [False, True]).seen_once_called_novel)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: evaluate([True, False], [True]), r"predicted must have shape \(2,\); got \(1,\)"),
        (lambda: evaluate([True], [True], [True, False]), r"ignore must have shape \(1,\)"),
        (lambda: evaluate([[True]], [True]), r"truth must have shape \(N,\)"),
        (lambda: evaluate([0, 1, 2], [0, 1, 1]), "evaluate_labels"),
        (lambda: evaluate_labels([0, 7], [0, 1]), r"found \[0, 7\]"),
    ],
)
def test_what_is_not_a_pair_of_label_arrays_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
