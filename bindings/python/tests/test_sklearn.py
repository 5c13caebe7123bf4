"""What do scikit-learn's own checks say of the models, and where do they not apply?"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from chronotope import series

sklearn = pytest.importorskip("sklearn")

ITS_COLUMNS = "it makes X one-dimensional, as the tag `one_d_array` asks, and then takes columns of it"
SEVERAL = "it gives several columns, and times are one; refused, in words of our own"
ANY_CLASS = "its classes are not 0 and 1; states are, and others are refused with the row and the remedy"
ONE_D = "it expects that one dimension is refused; times are one"
NAMES = "it expects the argument to be called y; here it is called what it is, states"

#: Checks that cannot pass, each with its reason. Everything else has to.
NOT_APPLICABLE: dict[str, str] = {
    "check_classifier_data_not_an_array": ANY_CLASS,
    "check_classifier_not_supporting_multiclass": ANY_CLASS,
    "check_classifiers_classes": ANY_CLASS,
    "check_classifiers_regression_target": ANY_CLASS,
    "check_classifiers_train": SEVERAL,
    "check_dict_unchanged": ITS_COLUMNS,
    "check_dont_overwrite_parameters": ITS_COLUMNS,
    "check_estimator_sparse_array": ITS_COLUMNS,
    "check_estimators_dtypes": ANY_CLASS,
    "check_estimators_empty_data_messages": SEVERAL,
    "check_estimators_nan_inf": SEVERAL,
    "check_estimators_partial_fit_n_features": SEVERAL,
    "check_f_contiguous_array_estimator": ITS_COLUMNS,
    "check_fit1d": ONE_D,
    "check_fit2d_1feature": ITS_COLUMNS,
    "check_fit2d_1sample": ITS_COLUMNS,
    "check_fit2d_predict1d": ITS_COLUMNS,
    "check_fit_score_takes_y": NAMES,
    "check_methods_sample_order_invariance": ITS_COLUMNS,
    "check_methods_subset_invariance": ITS_COLUMNS,
    "check_n_features_in": ITS_COLUMNS,
    "check_n_features_in_after_fitting": ITS_COLUMNS,
    "check_supervised_y_2d": "it expects a warning for a column of states (n, 1); that is as good as (n,)",
}


def make() -> list[Any]:
    return [series.Fremen(), series.Histogram(), series.Mean()]


def results_of(model: Any) -> dict[str, tuple[str, str]]:
    from sklearn.utils.estimator_checks import check_estimator

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        results = check_estimator(model, on_fail=None, on_skip=None)
    return {it["check_name"]: (it["status"], repr(it["exception"])) for it in results}


@pytest.mark.parametrize("model", make(), ids=repr)
def test_every_check_passes_or_is_listed_with_its_reason(model: Any) -> None:
    results = results_of(model)
    failed = {name: why for name, (status, why) in results.items() if status == "failed"}
    unlisted = {name: why for name, why in failed.items() if name not in NOT_APPLICABLE}
    assert unlisted == {}
    assert sum(status == "passed" for status, _ in results.values()) >= 25


def test_the_list_has_nothing_that_passes() -> None:
    failed = {
        name
        for model in make()
        for name, (status, _) in results_of(model).items()
        if status == "failed"
    }
    assert set(NOT_APPLICABLE) <= failed


def test_models_are_cloned_and_searched() -> None:
    from sklearn.base import clone, is_classifier
    from sklearn.model_selection import GridSearchCV, TimeSeriesSplit, cross_val_score

    hours = np.arange(28 * 24)
    times, states = hours * 3600.0, (hours % 24 >= 6) & (hours % 24 < 18)
    model = clone(series.Persistence(of=series.Histogram(num_bins=12)))
    assert model.of.num_bins == 12
    assert is_classifier(model)
    scores = cross_val_score(series.Fremen(), times[:, None], states.astype(int), cv=TimeSeriesSplit(3))
    assert (scores > 0.9).all()
    search = GridSearchCV(
        series.Histogram(), {"num_bins": [1, 24]}, cv=TimeSeriesSplit(3), scoring="neg_brier_score"
    )
    search.fit(times[:, None], states.astype(int))
    assert search.best_params_ == {"num_bins": 24}
