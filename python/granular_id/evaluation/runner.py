"""``evaluate``: how well are materials told apart, measured so that it can be believed."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from typing import Any

import joblib
import numpy as np
import scipy
import sklearn
from sklearn.base import BaseEstimator

from granular_id import _core
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.describe import describe_data, describe_estimator, is_synthetic, warnings_in
from granular_id.evaluation.one_space import run_space
from granular_id.evaluation.partitions import Partition
from granular_id.evaluation.plan import Space, plan_partitions, plan_protocols, plan_seed, plan_spaces
from granular_id.evaluation.result import EvaluationResult, SpaceSummary
from granular_id.recording import Dataset
from granular_id.spaces import FeatureSpace

__all__ = ["evaluate"]


def evaluate(
    data: Dataset,
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] = "paper",
    protocol: str | Sequence[str] = "paper",
    *,
    n_partitions: int = 20,
    train_per_class: int = 50,
    test_per_class: int = 12,
    classifier: BaseEstimator | None = None,
    n_jobs: int | None = None,
    random_state: int | None = 0,
    progress: bool | ProgressCallback = True,
) -> EvaluationResult:
    """Train and test on many partitions of a data set, in one or more feature spaces.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    spaces : str, sequence of str or mapping
        ``"paper"``: all spaces of the paper that exist here; names such as ``["raw", "raw+hfmh"]``; or
        ``{name: transformer}`` for other settings (see `feature_spaces`) or one's own. A transformer that
        learns from data is fitted on the training rows of each partition.
    protocol : str or sequence of str
        ``"paper"`` (random partitions), ``"chronological"`` (first half of each class trains, second half is
        tested, and the reverse) or both; with both, the gap between them is shown.
    n_partitions, train_per_class, test_per_class : int
        Of ``"paper"``. Defaults: 20 partitions with 50 and 12 recordings of each class, as in the paper.
    classifier : estimator, optional
        Any scikit-learn classifier; default `ECOCClassifier`, the paper's.
    n_jobs : int, optional
        Threads over partitions, as in joblib: None is 1, -1 all cores. The numbers do not depend on it.
    random_state : int or None
        Seed of the partitions and of every ``random_state`` left None in transformers and classifier. None
        draws a fresh seed; either way the result records it.
    progress : bool or callable
        True draws a bar on a terminal (with rich installed) and is silent elsewhere; a callable is called as
        ``progress(done, total, what)``.

    Returns
    -------
    EvaluationResult
        ``print(result)`` shows the table.

    Raises
    ------
    TypeError
        `data` is not a `Dataset`, or an argument has the wrong type.
    ValueError
        Lengths or rates differ, a recording has no label, there is one class only, a class has too few
        recordings, no order in time exists, a name is unknown, or a transformer is for another rate.

    Notes
    -----
    Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606. Accuracy per partition is the share of tested recordings
    that were named rightly; the table gives its mean and sample standard deviation over partitions.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording import Dataset, Recording
    >>> rng = np.random.default_rng(0)
    >>> level = {"oat": 1.0, "rice": 2.0}
    >>> data = Dataset(
    ...     [
    ...         Recording(level[m] + rng.normal(size=(40, 6)), rate_hz=500, label=m, name=f"{m}{k}")
    ...         for m in level
    ...         for k in range(6)
    ...     ]
    ... )
    >>> result = evaluate(data, "raw", n_partitions=2, train_per_class=4, test_per_class=2)
    >>> result.mean_accuracy("raw")
    1.0
    """
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    if not (isinstance(progress, bool) or callable(progress)):
        raise TypeError(f"progress must be True, False or callable, got {type(progress).__name__}")
    seed = plan_seed(random_state)
    X = data.X  # before the counts: resampling and cropping come first, and may change them
    protocols, notes = plan_protocols(protocol, data)
    planned = plan_spaces(spaces, data.rate_hz)
    partitions: dict[str, tuple[Partition, ...]] = {}
    for name in protocols:
        made, note = plan_partitions(
            data,
            name,
            n_partitions=n_partitions,
            train_per_class=train_per_class,
            test_per_class=test_per_class,
            seed=seed,
        )
        partitions[name] = tuple(made)
        notes.append(note)
    chosen = ECOCClassifier() if classifier is None else classifier
    labels, codes = np.unique(data.y, return_inverse=True)

    every = [partition for drawn in partitions.values() for partition in drawn]
    predicted = {}
    summaries = []
    with showing(progress) as callback:
        ticker = Ticker(len(planned) * (len(every) + 1), callback)
        for space in planned:
            run = run_space(space, X, data.y, every, chosen, seed=seed, n_jobs=n_jobs, ticker=ticker)
            answers = iter(run.predicted)
            for name, drawn in partitions.items():
                predicted[name, space.name] = tuple(next(answers) for _ in drawn)
            summaries.append(_summary(space, run.n_features, run.seconds))
    settings = {
        "spaces": [space.name for space in planned],
        "protocol": protocols,
        "n_partitions": n_partitions,
        "train_per_class": train_per_class,
        "test_per_class": test_per_class,
        "classifier": describe_estimator(chosen),
        "seed": seed,
    }
    return EvaluationResult(
        spaces=tuple(summaries),
        partitions=partitions,
        predicted=predicted,
        labels=tuple(labels.tolist()),
        truth=codes.astype(np.intp),
        names=tuple(data.names),
        sessions=tuple(session or "" for session in data.sessions),
        settings=settings,
        data=describe_data(data),
        versions=versions(),
        notes=(*notes, *warnings_in(data)),
        synthetic=is_synthetic(data),
        command=_call(settings),
    )


def versions() -> dict[str, str]:
    """Versions of everything that has a say in the numbers."""
    return {
        "granular_id": _core.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "scikit-learn": sklearn.__version__,
        "joblib": joblib.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
    }


def _summary(space: Space, n_features: int, seconds: Mapping[str, float]) -> SpaceSummary:
    settings = describe_estimator(space.transformer)
    return SpaceSummary(space.name, space.paper_accuracy, space.learns, n_features, seconds, settings)


def _call(settings: Mapping[str, Any]) -> str:
    return (
        f"granular_id.evaluate(data, spaces={settings['spaces']!r}, protocol={settings['protocol']!r}, "
        f"n_partitions={settings['n_partitions']}, train_per_class={settings['train_per_class']}, "
        f"test_per_class={settings['test_per_class']}, random_state={settings['seed']})"
    )
