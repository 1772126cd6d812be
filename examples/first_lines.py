"""The first lines: features of simulated pushes, a model, and the name of a push it has not seen."""

from sklearn.pipeline import make_pipeline

import granular_id as gid

data = gid.synthesize(["rice", "fine sugar", "cat litter"], n_per_class=10, seed=1)
features = gid.extract_features(data.X)
print(f"{len(data)} SYNTHETIC pushes, {features.shape[1]} features each")

model = make_pipeline(gid.RawHFMH(), gid.ECOCClassifier()).fit(data.X[1:], data.y[1:])
print(f"a push through {data.y[0]} is named {model.predict(data.X[:1])[0]}")
