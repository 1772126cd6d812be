"""Features of whole archives: extracted into files, and read as arrays for scikit-learn."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import FloatArray, WayOutError, argument_error
from granular_id._core import AXES, FeatureSpec, GranularIdError, MultiBandExtractor
from granular_id._progress import ProgressCallback
from granular_id._text import counted, typed
from granular_id.archive.partitions import ABOUT, Extraction, Outputs, one_of_each, pa, pq, run
from granular_id.features import extract_features
from granular_id.identifier import Identifier
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.recording import setup_mismatch

COLUMN = "features"

_SPACES = ("hfmh", "raw+hfmh", "raw")


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
    space : {"hfmh", "raw+hfmh", "raw"} or FeatureSpec, default "hfmh"
        Name of a feature space of the paper that the core extracts, at the rate of the archive; or what
        `granular_id.extract_features` takes. The default is the smallest: 600 counts.
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
        The space is none of these, or does not suit lengths, rate or axes of the recordings; `out` holds other work.
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
    if model is not None and space is not None:
        raise argument_error(GranularIdError, "space", "is that of the model: give one of both")
    if space is not None and not isinstance(space, FeatureSpec) and space not in _SPACES:
        how = "train a model on some, as in Identifier.fit(data, 'multiband'), and give model= (--model FILE)"
        known = ", ".join(map(repr, _SPACES))
        problem = f"={space!r} is none of {known}; for what a space learns from recordings, {how}"
        raise argument_error(GranularIdError, "space", problem)
    opened = archive if isinstance(archive, Archive) else Archive(archive)
    spec = _spec_of_space(opened, space or "hfmh") if model is None else _spec_of_model(opened, model, accept)
    spec.check(opened)
    return run(opened, spec, out, n_jobs=n_jobs, scheduler=scheduler, progress=progress)


@dataclass(frozen=True)
class FeaturesSpec:
    """Features of recordings of one kind."""

    title: str  # of the space, for messages
    extractor: FeatureSpec | MultiBandExtractor
    axes: tuple[str, ...]
    rate_hz: float
    n_samples: int | None  # None: any number

    def describe(self) -> dict[str, Any]:
        """Return what decides about the features."""
        size = {"rate_hz": self.rate_hz, "n_samples": self.n_samples, "axes": self.axes}
        positional, by_name = self.extractor.__getnewargs_ex__()
        plain = {name: np.asarray(value).tolist() for name, value in by_name.items()}
        kind = type(self.extractor).__name__
        # the first that differs is what a refusal names
        space = "+".join(name for name in ("raw", "hfmh") if plain.pop(name, False)) or kind
        own = {"space": space, "class": kind, "arguments": list(positional), **plain}
        return {Features.holds: {**own, **size}}

    def check(self, archive: Archive) -> None:
        """Refuse other rates and lengths."""
        resample = (
            f"call .resample({self.rate_hz:g}) ",
            typed(resample_hz=self.rate_hz),
            " on the recordings",
        )
        duration_s = (self.n_samples or 1) / self.rate_hz
        align = (
            "call .align on the recordings ",
            typed(duration_s=duration_s),
            ", or take space='hfmh' (--space hfmh), whose counts need no one length",
        )
        for column, unit, of_each, wanted, way_out in (
            ("rate_hz", "Hz", "Hz", self.rate_hz, resample),
            ("n_samples", "samples", "of each", self.n_samples, align),
        ):
            values = np.asarray(archive.index[column].to_numpy(), np.float64)  # NaN where there is no rate
            other = ~np.isclose(values, values if wanted is None else wanted, rtol=1e-6, atol=0)
            if other.any():
                row = int(other.argmax())
                came = "is sampled irregularly" if np.isnan(values[row]) else f"has {values[row]:g} {unit}"
                name = archive.index["name"][row].as_py()
                wants = f"{self.title} want {wanted:g} {of_each}"
                raise WayOutError(f"recording {name!r} {came}, {wants}: ", *way_out)

    def names(self) -> list[str]:
        """Names of the features, in order."""
        if isinstance(self.extractor, FeatureSpec):
            plain = self.extractor.feature_names(self.n_samples or 1, len(self.axes))
        else:
            plain = self.extractor.names
        if self.axes == AXES:
            return list(plain)
        from granular_id.spaces import renamed  # brings in scikit-learn

        return renamed(plain, self.axes)

    def table(self, archive: Archive, groups: Sequence[RowGroup]) -> Any:
        """One column, a list of fixed size, with its names; samples of one row group at a time are in memory."""
        names, first = self.names(), groups[0].start
        lengths = archive.index["n_samples"].slice(first, groups[-1].stop - first).to_numpy()
        out = np.empty((len(lengths), len(names)))
        buffer = np.empty((max(group.n_samples for group in groups), len(archive.axes)))
        for group in groups:
            samples, done = buffer[: group.n_samples], 0
            archive.decode(group, samples)
            start, stop = group.start - first, group.stop - first
            changes = np.flatnonzero(np.diff(lengths[start:stop])) + 1 + start
            for begin, end in pairwise([start, *changes.tolist(), stop]):  # runs of one length
                rows = samples[done : done + int(lengths[begin:end].sum())]
                done += len(rows)
                out[begin:end] = self._extract(rows.reshape(end - begin, -1, len(archive.axes)))
        kind = pa.list_(pa.field("element", pa.float64(), nullable=False), len(names))
        column = pa.FixedSizeListArray.from_arrays(pa.array(out.reshape(-1)), type=kind)
        about = {"names": json.dumps(names, ensure_ascii=False)}
        return pa.table([column], pa.schema([pa.field(COLUMN, kind, nullable=False, metadata=about)]))

    def _extract(self, recordings: FloatArray) -> FloatArray:
        """Return the features (n, D) of recordings (n, T, C) of one length."""
        if isinstance(self.extractor, FeatureSpec):
            return extract_features(recordings, spec=self.extractor, threads=1)
        return self.extractor.extract(recordings, 1)


def _spec_of_model(
    archive: Archive, model: Identifier | str | os.PathLike[str], accept: str | Sequence[str]
) -> FeaturesSpec:
    known = model if isinstance(model, Identifier) else Identifier.load(model)
    differences = known.requirements.check(one_of_each(archive, known.rate_hz), accept)
    if differences:
        warnings.warn(setup_mismatch(*differences), stacklevel=3)
    title = f"the {known.space} features of the model"
    return FeaturesSpec(title, known.spec, known.axes, known.rate_hz, known.n_samples)


def _spec_of_space(archive: Archive, space: str | FeatureSpec) -> FeaturesSpec:
    """Return the features of a space at the rate and length of the first recording."""
    first, title = archive.index.slice(0, 1).to_pylist()[0], "features of this spec"
    if not isinstance(space, FeatureSpec):
        title = f"{space!r} features"
        raw, hfmh = (block in space.split("+") for block in ("raw", "hfmh"))
        # one sampled irregularly is refused by `check`
        rate_hz = first["rate_hz"] or FeatureSpec().rate_hz
        space = FeatureSpec(raw=raw, hfmh=hfmh, rate_hz=rate_hz)
    n_samples = first["n_samples"] if space.raw else None
    return FeaturesSpec(title, space, archive.axes, space.rate_hz, n_samples)


class Features(Outputs):
    """Features that `extract` wrote, as scikit-learn wants them.

    Parameters
    ----------
    folder : path
        The `out` of `extract`.
    partial : bool, default False
        Take what there is of an extraction that was stopped, or of which partitions failed; refused by default.

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

    @cached_property
    def X(self) -> FloatArray:  # noqa: N802 (as scikit-learn names it)
        """Features (n, D), in the order of the archive."""
        X = np.empty((self.n_recordings, len(self.names)))
        done = 0
        for table in self.tables(COLUMN):
            values = table[COLUMN].combine_chunks().flatten().to_numpy()
            X[done : done + len(table)] = values.reshape(len(table), -1)
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
        field = pq.read_schema(self.folder / self._files[0]).field(COLUMN)
        return tuple(json.loads(field.metadata[b"names"]))

    @cached_property
    def recordings(self) -> Any:
        """What the archive says of each recording, a pyarrow.Table: name, label, session, start_time, digest."""
        return self.joined(*ABOUT.names)
