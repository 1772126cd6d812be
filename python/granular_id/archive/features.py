"""Features of whole archives: extracted into files, and read as arrays for scikit-learn."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import argument_error, named
from granular_id._core import AXES, FeatureSpec, MultiBandExtractor
from granular_id._progress import ProgressCallback
from granular_id._text import counted
from granular_id.archive.extraction import Extraction, run
from granular_id.archive.manifest import Partitions
from granular_id.archive.work import INDEX_COLUMNS, buffer, one_of_each, read_samples
from granular_id.io.errors import need
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.recording import Dataset, Recording, setup_mismatch

# Feature spaces and models are imported where they are called for: they bring in scikit-learn.

if TYPE_CHECKING:
    from granular_id.identifier import Identifier

FloatArray = npt.NDArray[np.float64]

COLUMN = "features"

_RATE_TOLERANCE = 1e-6


def extract(
    archive: Archive | str | os.PathLike[str],
    out: str | os.PathLike[str],
    space: Any = None,
    *,
    model: Identifier | str | os.PathLike[str] | None = None,
    accept: str | Sequence[str] = (),
    dtype: str = "float64",
    n_jobs: int | None = None,
    scheduler: Any = None,
    progress: bool | ProgressCallback = True,
) -> Extraction:
    """Extract features of all recordings of an archive into a folder of Parquet files, each exactly once.

    The archive is worked on in partitions of about 2048 recordings. Each becomes a file under a name made of its
    recordings, the feature space and the version of this package; ``_manifest.json`` is written last. What was stopped
    goes on where it was when it is called again, and an archive that has grown has only its new part computed. A
    partition that cannot be read fails alone. Memory: one row group of samples, and its features, for each thread.

    Parameters
    ----------
    archive : Archive or path
        What `granular_id.save` wrote as "parquet", or `append`.
    out : path
        Folder for the features; made where there is none. One folder holds one kind of features of one archive.
    space : str or transformer, default "hfmh"
        Name of a feature space of `granular_id.feature_spaces`, or a transformer, that learns nothing from recordings.
        The default is the smallest of the paper's: 600 counts. A rate that it leaves open is that of the archive.
        A transformer of your own has ``learns = False``, makes of samples (n, T, C) a row of finite features each, and
        names them by ``get_feature_names_out()``. It is known by its class and parameters: after a change of its code
        take another folder.
    model : Identifier or path, optional
        Extract the features of a trained model instead, with all that it has learned: the way to multi-band features.
    accept : str or sequence of str, default ()
        With `model`: what of the recordings' set-up may differ from the training though it is refused otherwise:
        "frame", "transform", "sign", "units".
    dtype : {"float64", "float32"}, default "float64"
        Type of the features; computed is always in float64.
    n_jobs : int, optional
        Threads of this process, as in joblib: None is 1, -1 one for each core.
    scheduler : str or distributed.Client, optional
        Work on a Dask cluster instead: its scheduler, ``tcp://host:8786``, or a client. Its workers see archive and
        `out` under the same paths. Encryption and all else is that of Dask's own configuration.
    progress : bool or callable, default True
        Show recordings done, recordings per second and the time left, or call ``progress(done, total, what)``.

    Returns
    -------
    Extraction

    Raises
    ------
    PartitionError
        Some partitions could not be made. All others are finished, and the manifest names both.
    ValueError
        The space learns, or does not suit lengths, rate or axes of the recordings; `out` holds other work.
    RecordingFileError
        There is no archive, or its index is damaged.
    OSError
        `out` cannot be written: a full disk, for instance. Nothing half-written is left.
    ImportError
        pyarrow, or Dask, is missing.

    See Also
    --------
    Features : Reads what this writes.

    Examples
    --------
    >>> import tempfile
    >>> import granular_id as gid
    >>> from granular_id.archive import Features, extract
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=5, duration_s=0.5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     archive = gid.save(data, folder + "/archive", "parquet")
    ...     done = extract(archive, folder + "/features", "hfmh", progress=False)
    ...     features = Features(folder + "/features")
    ...     classifier = gid.ECOCClassifier().fit(features.X, features.y)
    >>> done.n_recordings, features.X.shape, features.names[0]
    (10, (10, 600), 'hfmh_fx_00')
    >>> bool((features.X == gid.HFMH().fit_transform(data)).all())
    True
    """
    opened = archive if isinstance(archive, Archive) else Archive(archive)
    work = FeatureWork.of(opened, space, model=model, accept=accept, dtype=dtype)
    return run(opened, work, out, n_jobs=n_jobs, scheduler=scheduler, progress=progress)


@dataclass(frozen=True)
class FeatureWork:
    """Features of one kind of recordings; made by `of`."""

    title: str
    extractor: Any  # FeatureSpec, MultiBandExtractor, or a fitted transformer
    axes: tuple[str, ...]
    rate_hz: float
    n_samples: int | None  # None: any number
    n_features: int
    dtype: str

    @classmethod
    def of(
        cls,
        archive: Archive,
        space: Any = None,
        *,
        model: Identifier | str | os.PathLike[str] | None = None,
        accept: str | Sequence[str] = (),
        dtype: str = "float64",
    ) -> FeatureWork:
        """Settle what is extracted from the recordings of an archive: rate, axes and length are known from here on."""
        if dtype not in ("float64", "float32"):
            try:
                dtype = np.dtype(dtype).name
            except TypeError:
                dtype = repr(dtype)
        if dtype not in ("float64", "float32"):
            raise argument_error(ValueError, "dtype", f"must be 'float64' or 'float32', got {dtype}")
        if model is None:
            if accept:
                raise argument_error(
                    ValueError, "accept", f"={accept!r} is about the set-up of a model: give model="
                )
            return cls._of_space(archive, space, dtype)
        if space is not None:
            raise argument_error(ValueError, "space", "is that of the model: give one of both")
        return cls._of_model(archive, model, accept, dtype)

    @classmethod
    def _of_model(
        cls,
        archive: Archive,
        model: Identifier | str | os.PathLike[str],
        accept: str | Sequence[str],
        dtype: str,
    ) -> FeatureWork:
        from granular_id.identifier import Identifier

        known = model if isinstance(model, Identifier) else Identifier.load(model)
        differences = known.requirements.check(one_of_each(archive, known.rate_hz), accept)
        if differences:
            warnings.warn(setup_mismatch(*differences), stacklevel=4)
        spec, n_samples = known.spec, known.n_samples
        if isinstance(spec, MultiBandExtractor):
            n_features = spec.n_features
        else:
            n_features = spec.n_features(n_samples, len(known.axes))
        title = f"the {known.space} features of the model"
        return cls(title, spec, known.axes, known.rate_hz, n_samples, n_features, dtype)

    @classmethod
    def _of_space(cls, archive: Archive, space: Any, dtype: str) -> FeatureWork:
        from granular_id.spaces import HFMH, RawHFMH, RawSignal

        title, transformer = _transformer(space)
        first = archive.index.slice(0, 1).to_pylist()[0]
        n_samples, rate_hz = int(first["n_samples"]), first["rate_hz"]
        if rate_hz is None:
            raise ValueError(
                f"recording {first['name']!r} is sampled irregularly: call .resample on it first"
            )
        samples = np.zeros((n_samples, len(archive.axes)))
        blank = Recording(samples, rate_hz=rate_hz, axes=archive.axes, name="blank")
        fitted = _fitted(title, transformer, Dataset([blank]))
        n_features = len(fitted.get_feature_names_out())
        extractor: Any = fitted
        if type(fitted) in (RawSignal, HFMH) or (type(fitted) is RawHFMH and fitted.block_weights is None):
            extractor = fitted.spec_  # what the core does alone
        any_length = isinstance(extractor, FeatureSpec) and not extractor.raw
        return cls(
            title, extractor, archive.axes, rate_hz, None if any_length else n_samples, n_features, dtype
        )

    def about(self) -> dict[str, Any]:
        """Return what decides about the features."""
        size = {"rate_hz": self.rate_hz, "n_samples": self.n_samples, "dtype": self.dtype}
        return {"features": {"extractor": _described(self.extractor), **size}}

    def check(self, archive: Archive) -> None:
        """Refuse other axes, rates and lengths."""
        if archive.axes != self.axes:
            raise ValueError(
                f"{archive.folder} has the axes {' '.join(archive.axes)}, {self.title} those of "
                f"{' '.join(self.axes)}: call .select(axes={list(self.axes)}) on the recordings"
            )
        rates = np.asarray(archive.index["rate_hz"].to_numpy(), np.float64)  # NaN where there is none
        other = ~(np.abs(rates - self.rate_hz) <= _RATE_TOLERANCE * self.rate_hz)
        if other.any():
            row = int(other.argmax())
            came = "is sampled irregularly" if np.isnan(rates[row]) else f"has {rates[row]:g} Hz"
            raise ValueError(
                f"recording {_name(archive, row)} {came}, {self.title} {_want(self.title)} {self.rate_hz:g} Hz: "
                f"call .resample({self.rate_hz:g}) on the recordings; nothing is resampled unasked"
            )
        if self.n_samples is None:
            return
        lengths = archive.index["n_samples"].to_numpy()
        if (lengths != self.n_samples).any():
            row = int((lengths != self.n_samples).argmax())
            raise ValueError(
                f"recording {_name(archive, row)} has {counted(int(lengths[row]), 'sample')}, {self.title} "
                f"{_want(self.title)} {self.n_samples} of each: call .align on the recordings, or take space='hfmh', "
                "whose counts need no one length"
            )

    def fields(self) -> list[Any]:
        """One column, a list of fixed size; names of the features in its metadata."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        names = json.dumps(self.names(), ensure_ascii=False)
        return [arrow.field(COLUMN, self._kind(arrow), nullable=False, metadata={"names": names})]

    def names(self) -> list[str]:
        """Names of the features, in order."""
        if isinstance(self.extractor, FeatureSpec):
            plain = self.extractor.feature_names(self.n_samples or 1, len(self.axes))
        elif isinstance(self.extractor, MultiBandExtractor):
            plain = self.extractor.names
        else:
            return [str(name) for name in self.extractor.get_feature_names_out()]
        if self.axes == AXES:  # as the core names them
            return list(plain)
        from granular_id.spaces import renamed

        return renamed(plain, self.axes)

    def columns(self, archive: Archive, group: RowGroup) -> list[Any]:
        """Features of one row group."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        samples = read_samples(archive, group)
        n = group.stop - group.start
        out = buffer("features", (n, self.n_features), self.dtype)
        if self.n_samples is not None:
            out = self._extract(samples.reshape(n, self.n_samples, len(self.axes)), out)
        else:
            lengths = archive.index["n_samples"].slice(group.start, n).to_numpy()
            changes = np.flatnonzero(np.diff(lengths)) + 1
            at = 0
            for start, stop in pairwise([0, *changes.tolist(), n]):  # runs of one length
                end = at + int(lengths[start:stop].sum())
                shape = (stop - start, int(lengths[start]), len(self.axes))
                self._extract(samples[at:end].reshape(shape), out[start:stop])
                at = end
        return [arrow.FixedSizeListArray.from_arrays(arrow.array(out.reshape(-1)), type=self._kind(arrow))]

    def _extract(self, recordings: FloatArray, out: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Features (n, D) of recordings (n, T, C) of one length: in `out`, or elsewhere."""
        if isinstance(self.extractor, FeatureSpec):
            return _core.extract_features(recordings, self.extractor, 1, out, self.dtype)
        if isinstance(self.extractor, MultiBandExtractor):
            features = self.extractor.extract(recordings, 1)
        else:
            features = self._of_transformer(recordings)
        if self.dtype == "float64":
            return np.ascontiguousarray(features)
        with np.errstate(over="ignore"):
            out[:] = features
        if not np.isfinite(out).all():
            raise ValueError("a feature is beyond float32: take dtype='float64'")
        return out

    def _of_transformer(self, recordings: FloatArray) -> FloatArray:
        features = np.asarray(self.extractor.transform(recordings))
        wanted = (len(recordings), self.n_features)
        if features.shape != wanted or features.dtype.kind not in "fiub" or not np.isfinite(features).all():
            came = f"{features.dtype} of shape {features.shape}"
            raise ValueError(f"{self.title} must make finite real features of shape {wanted}, got {came}")
        return np.asarray(features, np.float64)

    def _kind(self, arrow: Any) -> Any:
        number = arrow.float64() if self.dtype == "float64" else arrow.float32()
        return arrow.list_(arrow.field("element", number, nullable=False), self.n_features)


def _want(title: str) -> str:
    return "want" if title.endswith("model") else "wants"


def _name(archive: Archive, row: int) -> str:
    return repr(archive.index["name"][row].as_py())


def _transformer(space: Any) -> tuple[str, Any]:
    """Return what a caller means by a space: its name for messages, and a transformer that learns nothing."""
    from sklearn.base import clone

    from granular_id.spaces import feature_spaces, learns

    if space is None or isinstance(space, str):
        # The rate is that of the archive.
        known = feature_spaces(threads=1)
        found = named(known, "space", "hfmh" if space is None else space)
        title, transformer = repr(found.name), found.transformer
        rates = [key for key in transformer.get_params() if key.rpartition("__")[2] == "rate_hz"]
        transformer.set_params(**dict.fromkeys(rates))
    else:
        if isinstance(space, type) or not (hasattr(space, "fit") and hasattr(space, "transform")):
            raise argument_error(TypeError, "space", f"must be a name or a transformer, got {space!r:.80}")
        title, transformer = type(space).__name__, clone(space)
        threads = [key for key in transformer.get_params() if key.rpartition("__")[2] == "threads"]
        transformer.set_params(**dict.fromkeys(threads, 1))
    if not any(hasattr(transformer, name) for name in ("learns", "steps", "transformer_list")):
        raise argument_error(
            TypeError, "space", f"={title} must say by learns = False that it learns nothing"
        )
    if learns(transformer):
        raise argument_error(
            ValueError,
            "space",
            f"={title} learns from recordings: train a model on some of them, as in Identifier.fit(data, 'multiband'), "
            "and give model=; a RawHistogram may be told its range instead",
        )
    return title, transformer


def _fitted(title: str, transformer: Any, blank: Dataset) -> Any:
    """Fit what learns nothing but the shape of recordings."""
    from granular_id._estimators import with_rate

    fitted = with_rate(transformer, blank.rate_hz).fit(blank)
    if not hasattr(fitted, "get_feature_names_out"):
        raise argument_error(
            TypeError, "space", f"={title} must name its features by get_feature_names_out()"
        )
    made, names = np.asarray(fitted.transform(blank.X)), list(fitted.get_feature_names_out())
    if made.shape != (1, len(names)) or not names or len(set(names)) < len(names):
        raise argument_error(
            ValueError,
            "space",
            f"={title} must make one row of features of a recording, and name each once: of samples "
            f"{blank.X.shape} came {made.shape} and {counted(len(names), 'name')}",
        )
    return fitted


def _described(extractor: Any) -> dict[str, Any]:
    """Everything that decides about features, as JSON."""
    if isinstance(extractor, (FeatureSpec, MultiBandExtractor)):
        arguments = extractor.__getnewargs_ex__()
        plain = {key: _plain(value) for key, value in arguments[1].items()}
        return {"class": type(extractor).__name__, "arguments": list(arguments[0]), **plain}
    if hasattr(extractor, "steps"):
        steps = [{"name": name, **_described(step)} for name, step in extractor.steps]
        return {"class": type(extractor).__name__, "steps": steps}
    from granular_id._estimators import describe_estimator

    return describe_estimator(extractor)


def _plain(value: Any) -> Any:
    return np.asarray(value).tolist() if isinstance(value, (np.ndarray, tuple)) else value


class Features(Partitions):
    """Features that `extract` wrote, as scikit-learn wants them.

    Parameters
    ----------
    folder : path
        The `out` of `extract`.
    partial : bool, default False
        Take what there is where partitions failed; refused unless asked for.

    Attributes
    ----------
    spec : dict
        What was extracted, and by which version.
    n_recordings : int
    sha256 : str
        Over all partitions, as `Extraction.sha256`.

    Raises
    ------
    FileNotFoundError
        There is no manifest: the extraction is not finished.
    ValueError
        Partitions failed, are gone or are cut off.

    Examples
    --------
    See `extract`; what does not fit in memory is taken partition by partition:

    >>> import tempfile
    >>> import numpy as np
    >>> import granular_id as gid
    >>> from granular_id.archive import Features, extract
    >>> from sklearn.linear_model import SGDClassifier
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=5, duration_s=0.5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = extract(gid.save(data, folder + "/a", "parquet"), folder + "/f", progress=False)
    ...     features = Features(folder + "/f")
    ...     classifier = SGDClassifier(random_state=0)
    ...     for part in features:
    ...         classifier = classifier.partial_fit(part.X, part.y, classes=np.unique(features.y))
    >>> classifier.coef_.shape
    (1, 600)
    """

    holds = "features"
    again = "run the same extraction again, which computes what is missing"

    def __iter__(self) -> Iterator[Features]:
        """Yield the features of one partition after the other, so that no more is in memory."""
        for file in self._files:
            part = object.__new__(type(self))
            part.__dict__.update(folder=self.folder, spec=self.spec, sha256=self.sha256, _files=(file,))
            with self._opened(file) as opened:
                part.n_recordings = opened.metadata.num_rows
            yield part

    def __repr__(self) -> str:
        return f"Features({os.fspath(self.folder)!r}: {counted(len(self))}, {len(self.names)} features)"

    @cached_property
    def X(self) -> npt.NDArray[Any]:  # noqa: N802 (as scikit-learn names it)
        """Features (n, D), in the order of the archive; those of a single row group read-only, without a copy."""
        kind = self._field.type
        n_rows = 0
        X: npt.NDArray[Any] = np.empty((0, kind.list_size), kind.value_type.to_pandas_dtype())
        for file in self._files:
            for rows in self._matrices(file):
                if len(rows) == self.n_recordings:
                    return rows
                if not len(X):
                    X = np.empty((self.n_recordings, kind.list_size), X.dtype)
                X[n_rows : n_rows + len(rows)] = rows
                n_rows += len(rows)
        return X

    def _matrices(self, file: str) -> Iterator[npt.NDArray[Any]]:
        """Yield the features of one row group after the other, read-only."""
        with self._opened(file) as opened:
            for k in range(opened.num_row_groups):
                for chunk in opened.read_row_group(k, [COLUMN])[COLUMN].chunks:
                    yield chunk.flatten().to_numpy().reshape(len(chunk), -1)

    @property
    def y(self) -> npt.NDArray[np.str_]:
        """Labels (n,); ValueError naming the first recording without one."""
        labels = self.recordings["label"].to_pylist()
        if None in labels:
            first = self.recordings["name"][labels.index(None)].as_py()
            raise ValueError(f"{counted(labels.count(None))} without a label, the first is {first!r}")
        return np.array(labels, dtype=np.str_)

    @property
    def sessions(self) -> npt.NDArray[np.object_]:
        """Sessions (n,), dtype object: str, or None where the session is not known."""
        return np.array(self.recordings["session"].to_pylist(), dtype=object)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the D features, in order."""
        return tuple(json.loads((self._field.metadata or {})[b"names"]))

    @cached_property
    def _field(self) -> Any:
        with self._opened(self._files[0]) as opened:
            return opened.schema_arrow.field(COLUMN)

    @cached_property
    def recordings(self) -> Any:
        """What the archive says of each recording, a pyarrow.Table: name, label, session, start_time, digest."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        tables = []
        for file in self._files:
            with self._opened(file) as opened:
                tables.append(opened.read(list(INDEX_COLUMNS)))
        return arrow.concat_tables(tables)
