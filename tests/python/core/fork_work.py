"""What a process does in the tests of processes. Imported by spawned children: it imports little."""

import hashlib
import os

import numpy as np

from granular_id import FeatureSpec, StreamingExtractor
from granular_id._core import Model, MultiBandExtractor, StreamingIdentifier
from granular_id.features import extract_features

SHAPE = (24, 400, 6)


def a_batch(seed=0):
    return np.random.default_rng(seed).standard_normal(SHAPE)


def batch_digest(seed=0, threads=2):
    return hashlib.sha256(extract_features(a_batch(seed), threads=threads).tobytes()).hexdigest()


def digest_and_process():
    """The same batch twice, the second with threads that are there already; and who did it."""
    batch_digest()
    return batch_digest(), os.getpid()


def a_stream(kind):
    """A stream, rows that it takes some milliseconds for, and what it says of those so far, as text."""
    n_samples, n_axes = (1 << 13, 1) if kind.startswith("multi-band") else (1 << 15, 6)
    rows = np.random.default_rng(0).standard_normal((n_samples, n_axes))
    if kind == "extractor":
        stream = StreamingExtractor(FeatureSpec(), n_samples=n_samples, n_axes=n_axes)
        return stream, rows, lambda stream: hashlib.sha256(stream.features().tobytes()).hexdigest()
    spec = MultiBandExtractor(n_samples, n_axes) if kind.startswith("multi-band") else FeatureSpec()
    n_features = spec.n_features if kind.startswith("multi-band") else spec.n_features(n_samples, n_axes)
    coef = np.random.default_rng(1).standard_normal((1, n_features))
    model = Model(spec, coef, [0.0], [[1], [-1]], ["rice", "salt"], n_samples=n_samples, n_axes=n_axes)
    return StreamingIdentifier(model), rows, lambda stream: stream.scores().tobytes().hex()


def send_digest(connection):
    """Work of a child process."""
    connection.send(digest_and_process())
    connection.close()


def send_digest_of_a_child(connection, context, wait_s):
    """Work of a child that has a child."""
    own = batch_digest()
    digest, process = in_child(context, wait_s)
    connection.send((own if own == digest else f"{own} but {digest} in the child", process))
    connection.close()


def in_child(context, wait_s, target=send_digest, arguments=()):
    """What a child process sends; an error, and no child left behind, when it hangs or dies."""
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=target, args=(there, *arguments))
    child.start()
    there.close()
    try:
        if not here.poll(wait_s):
            raise TimeoutError(f"the child {child.pid} hangs: nothing for {wait_s} s")
        return here.recv()
    finally:
        here.close()
        child.join(wait_s / 4)
        if child.is_alive():
            child.kill()
            child.join()
