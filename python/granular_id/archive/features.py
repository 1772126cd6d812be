"""Features of whole archives: extracted into files, and read as arrays for scikit-learn."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import argument_error, named
from granular_id._core import AXES, FeatureSpec, GranularIdError, MultiBandExtractor
from granular_id._progress import ProgressCallback
from granular_id._text import counted
from granular_id.archive.partitions import ABOUT, Extraction, Outputs, one_of_each, run
from granular_id.features import extract_features
from granular_id.io.files import need
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
    space: str | FeatureSpec | None = None,
    *,
    model: Identifier | str | os.PathLike[str] | None = None,
    accept: str | Sequence[str] = (),
    n_jobs: int | None = None,
    scheduler: Any = None,
    progress: bool | ProgressCallback = True,
) -> Extraction:
    """Extract features of all recordings of an archive into a folder of Parquet files, each exactly once.

    The archive is worked on in partitions of at most 1024 recordings. Each becomes a file under a name made of its
    recordings, the feature space and the version of this package. What was stopped goes on where it was when it is
    called again, and an archive that has grown has only its new part computed. A partition that cannot be read fails
    alone. Memory: one row group of samples, and the features of a partition, for each thread.

    Parameters
    ----------
    archive : Archive or path
        What `granular_id.save` wrote as "parquet", or `append`.
    out : path
        Folder for the features; made where there is none. One folder holds one kind of features of one archive.
    space : str or FeatureSpec, default "hfmh"
        Name of a feature space of `granular_id.feature_spaces` that learns nothing from recordings, or what
        `granular_id.extract_features` takes. The default is the smallest of the paper's: 600 counts. Spaces by name
        have the rate of the archive.
    model : Identifier or path, optional
        Extract the features of a trained model instead, with all that it has learned: the way to multi-band features.
    accept : str or sequence of str, default ()
        With `model`: what of the recordings' set-up may differ from the training though it is refused otherwise:
        "frame", "transform", "sign", "units".
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
        Some partitions could not be made; it names them. All others are finished.
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
    if model is None:
        if accept:
            problem = f"={accept!r} is about the set-up of a model: give model="
            raise argument_error(GranularIdError, "accept", problem)
        spec = _spec_of_space(opened, "hfmh" if space is None else space)
    elif space is None:
        spec = _spec_of_model(opened, model, accept)
    else:
        raise argument_error(GranularIdError, "space", "is that of the model: give one of both")
    return run(opened, spec, out, n_jobs=n_jobs, scheduler=scheduler, progress=progress)


@dataclass(frozen=True)
class FeaturesSpec:
    """Features of recordings of one kind."""

    title: str  # of the space, for messages
    extractor: Any  # FeatureSpec, MultiBandExtractor, or a fitted transformer
    axes: tuple[str, ...]
    rate_hz: float
    n_samples: int | None  # None: any number

    def describe(self) -> dict[str, Any]:
        """Return what decides about the features."""
        from granular_id._estimators import describe_estimator

        size = {"rate_hz": self.rate_hz, "n_samples": self.n_samples, "axes": self.axes}
        if not isinstance(self.extractor, (FeatureSpec, MultiBandExtractor)):
            return {Features.holds: {**size, **describe_estimator(self.extractor)}}
        positional, by_name = self.extractor.__getnewargs_ex__()
        plain = {name: np.asarray(value).tolist() for name, value in by_name.items()}
        own = {"class": type(self.extractor).__name__, "arguments": list(positional), **plain}
        return {Features.holds: {**size, **own}}

    def check(self, archive: Archive) -> None:
        """Refuse other rates and lengths."""
        lengths = archive.index["n_samples"].to_numpy()
        rates = np.asarray(archive.index["rate_hz"].to_numpy(), np.float64)  # NaN where there is none
        other_rate = ~(np.abs(rates - self.rate_hz) <= _RATE_TOLERANCE * self.rate_hz)
        other = other_rate | (lengths != (lengths if self.n_samples is None else self.n_samples))
        if not other.any():
            return
        row = int((other_rate if other_rate.any() else other).argmax())
        name, wants = archive.index["name"][row].as_py(), f"{self.title} want"
        if other_rate.any():
            came = "is sampled irregularly" if np.isnan(rates[row]) else f"has {rates[row]:g} Hz"
            raise GranularIdError(
                f"recording {name!r} {came}, {wants} {self.rate_hz:g} Hz: call .resample({self.rate_hz:g}) on the "
                f"recordings (--resample-hz {self.rate_hz:g}); nothing is resampled unasked"
            )
        raise GranularIdError(
            f"recording {name!r} has {counted(int(lengths[row]), 'sample')}, {wants} {self.n_samples} of each: call "
            f".align on the recordings (--duration-s {(self.n_samples or 1) / self.rate_hz:.9g}), or take "
            "space='hfmh' (--space hfmh), whose counts need no one length"
        )

    def names(self) -> list[str]:
        """Names of the features, in order."""
        from granular_id.spaces import renamed

        if isinstance(self.extractor, FeatureSpec):
            plain = self.extractor.feature_names(self.n_samples or 1, len(self.axes))
        elif isinstance(self.extractor, MultiBandExtractor):
            plain = self.extractor.names
        else:
            return [str(name) for name in self.extractor.get_feature_names_out()]
        return list(plain) if self.axes == AXES else renamed(plain, self.axes)

    def table(self, archive: Archive, groups: Sequence[RowGroup]) -> Any:
        """One column, a list of fixed size, with its names; samples of one row group at a time are in memory."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        names, first = self.names(), groups[0].start
        lengths = archive.index["n_samples"].slice(first, groups[-1].stop - first).to_numpy()
        out = np.empty((len(lengths), len(names)))
        buffer = np.empty((max(group.n_samples for group in groups), len(archive.axes)))
        for group in groups:
            samples, done = archive.samples(group, buffer), 0
            start, stop = group.start - first, group.stop - first
            changes = np.flatnonzero(np.diff(lengths[start:stop])) + 1 + start
            for begin, end in pairwise([start, *changes.tolist(), stop]):  # runs of one length
                rows = samples[done : done + int(lengths[begin:end].sum())]
                done += len(rows)
                out[begin:end] = self._extract(rows.reshape(end - begin, -1, len(archive.axes)))
        kind = arrow.list_(arrow.field("element", arrow.float64(), nullable=False), len(names))
        column = arrow.FixedSizeListArray.from_arrays(arrow.array(out.reshape(-1)), type=kind)
        about = {"names": json.dumps(names, ensure_ascii=False)}
        return arrow.table(
            [column], arrow.schema([arrow.field(COLUMN, kind, nullable=False, metadata=about)])
        )

    def _extract(self, recordings: FloatArray) -> Any:
        """Return the features (n, D) of recordings (n, T, C) of one length."""
        if isinstance(self.extractor, FeatureSpec):
            return extract_features(recordings, spec=self.extractor, threads=1)
        if isinstance(self.extractor, MultiBandExtractor):
            return self.extractor.extract(recordings, 1)
        return self.extractor.transform(recordings)


def _spec_of_model(
    archive: Archive, model: Identifier | str | os.PathLike[str], accept: str | Sequence[str]
) -> FeaturesSpec:
    from granular_id.identifier import Identifier

    known = model if isinstance(model, Identifier) else Identifier.load(model)
    differences = known.requirements.check(one_of_each(archive, known.rate_hz), accept)
    if differences:
        warnings.warn(setup_mismatch(*differences), stacklevel=3)
    title = f"the {known.space} features of the model"
    return FeaturesSpec(title, known.spec, known.axes, known.rate_hz, known.n_samples)


def _spec_of_space(archive: Archive, space: str | FeatureSpec) -> FeaturesSpec:
    """Fit a space, which learns nothing but the shape of recordings: that of the first in the archive."""
    from granular_id.spaces import HFMH, RawHFMH, RawSignal, feature_spaces, learns

    first = archive.index.slice(0, 1).to_pylist()[0]
    n_samples, rate_hz = int(first["n_samples"]), first["rate_hz"]
    if rate_hz is None:
        raise GranularIdError(
            f"recording {first['name']!r} is sampled irregularly: call .resample on it first"
        )
    extractor: Any = space
    if not isinstance(space, FeatureSpec):
        transformer = named(feature_spaces(rate_hz=rate_hz, threads=1), "space", space).transformer
        if learns(transformer):
            how = "train a model on some, as in Identifier.fit(data, 'multiband'), and give model= (--model FILE)"
            raise argument_error(GranularIdError, "space", f"={space!r} learns from recordings: {how}")
        blank = np.zeros((n_samples, len(archive.axes)))
        extractor = transformer.fit(Dataset([Recording(blank, rate_hz=rate_hz, axes=archive.axes)]))
        if type(extractor) in (HFMH, RawHFMH, RawSignal):
            extractor = extractor.spec_  # what the core does alone
    any_length = isinstance(extractor, FeatureSpec) and not extractor.raw
    rate_hz = space.rate_hz if isinstance(space, FeatureSpec) else rate_hz
    title = f"{space!r} features" if isinstance(space, str) else "features of this spec"
    return FeaturesSpec(title, extractor, archive.axes, rate_hz, None if any_length else n_samples)


class Features(Outputs):
    """Features that `extract` wrote, as scikit-learn wants them.

    Parameters
    ----------
    folder : path
        The `out` of `extract`.
    partial : bool, default False
        Take what there is of an extraction that was stopped, or of which partitions failed; refused unless asked for.

    Attributes
    ----------
    spec : dict
        What was extracted, and by which version.
    n_recordings, n_synthetic : int
        Recordings, and how many of them were simulated.

    Raises
    ------
    FileNotFoundError
        The extraction is not finished.
    RecordingFileError
        A partition is damaged.

    Examples
    --------
    See `extract`. What does not fit in memory is read by pyarrow.dataset, a batch at a time.
    """

    holds = "features"

    def __repr__(self) -> str:
        return f"Features({os.fspath(self.folder)!r}: {counted(len(self))}, {len(self.names)} features)"

    @cached_property
    def X(self) -> FloatArray:  # noqa: N802 (as scikit-learn names it)
        """Features (n, D), in the order of the archive."""
        X = np.empty((self.n_recordings, len(self.names)))
        done = 0
        for table in self._tables([COLUMN]):
            X[done : done + len(table)] = (
                table[COLUMN].combine_chunks().flatten().to_numpy().reshape(len(table), -1)
            )
            done += len(table)
        return X

    @property
    def y(self) -> npt.NDArray[np.str_]:
        """Labels (n,); ValueError naming the first recording without one."""
        labels = self.recordings["label"].to_pylist()
        if None in labels:
            first = self.recordings["name"][labels.index(None)].as_py()
            raise GranularIdError(f"{counted(labels.count(None))} without a label, the first is {first!r}")
        return np.array(labels, dtype=np.str_)

    @property
    def sessions(self) -> npt.NDArray[np.object_]:
        """Sessions (n,), dtype object: str, or None where the session is not known."""
        return np.array(self.recordings["session"].to_pylist(), dtype=object)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the D features, in order."""
        library = need("pyarrow.parquet", extra="app", why="to work on archives")
        field = library.read_schema(self.folder / self._files[0]).field(COLUMN)
        return tuple(json.loads(field.metadata[b"names"]))

    @cached_property
    def recordings(self) -> Any:
        """What the archive says of each recording, a pyarrow.Table: name, label, session, start_time, digest."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        return arrow.concat_tables(self._tables([*ABOUT]))
