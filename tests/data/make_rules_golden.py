"""Write a trained model with rules, pushes, and what plain numpy says of them by these rules.

    python tests/data/make_rules_golden.py                       # tests/data/rules, small
    python tests/data/make_rules_golden.py FOLDER SECONDS SPACE  # longer pushes, another space

SYNTHETIC pushes: 60 of the six materials of the training, then 20 of two others. ``tests/model.rs`` lets the example
of the Rust crate name them, ``tests/python/identifier/test_confidence_rules.py`` the package. Samples are little-endian
float32, push by push; ``answers.txt`` has a line for each: label, candidates, unknown or not, tabs between. Made with
numpy 2.4.
"""

import sys
from pathlib import Path

import numpy as np
from sklearn.pipeline import make_pipeline

import granular_id as gid
from granular_id.confidence import Novelty
from granular_id.confidence.novelty import scaled
from granular_id.identifier.training import features_of

HERE = Path(__file__).resolve().parent
KNOWN = ("rice", "wheat flour", "oat flakes", "sunflower seeds", "fine sugar", "macaroni")
OTHERS = ("clay granules", "potting gravel")


def main(folder=HERE / "rules", seconds=0.5, space="hfmh"):
    folder.mkdir(parents=True, exist_ok=True)
    of_pushes = {"duration_s": seconds, "rate_hz": 100.0}
    training = gid.synthesize(KNOWN, 12, seed=1, **of_pushes)
    pipeline = make_pipeline(gid.HFMH(n_bins=20), gid.ECOCClassifier()) if space == "hfmh" else space
    model = gid.Identifier.fit(training, pipeline, share_known=0.9, target_error=None)
    model.save(folder / "model.safetensors")
    known, others = (
        gid.synthesize(KNOWN, 10, seed=2, **of_pushes),
        gid.synthesize(OTHERS, 10, seed=2, **of_pushes),
    )
    X = np.concatenate([known.X, others.X]).astype("<f4")
    (folder / "wrench.f32").write_bytes(X.tobytes())
    (candidates, unknown), values = model.confidence_rules(), -model.losses(X)
    scaling, *fitted = model.core.novelty
    known = unknown.knows(Novelty(*fitted).parts(scaled(features_of(model.core, X.astype(float)), scaling)))
    lines = [
        f"{model.classes[row.argmax()]}\t{', '.join(candidates.names(row))}\t{not is_known}\n"
        for row, is_known in zip(values, known, strict=True)
    ]
    (folder / "answers.txt").write_text("".join(lines), encoding="utf-8")
    print(f"{len(lines)} pushes in {folder}, {sum('True' in line for line in lines)} unknown")


if __name__ == "__main__":
    main(*(convert(text) for convert, text in zip((Path, float, str), sys.argv[1:], strict=False)))
