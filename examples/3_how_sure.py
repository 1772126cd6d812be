"""
How sure is an answer?
======================

A model that is trained on recordings of several sessions holds some of them out, and learns from
those when it may be sure. A decision then names *candidates*, a set of materials that holds the
right one as often as requested, and says when a push is like *none* of the materials that the model
knows.

The recordings are SYNTHETIC, and short (1.2 s), so that some answers are doubtful.
"""

import matplotlib.pyplot as plt
import numpy as np

import granular_id as gid
from granular_id.evaluation import confidence_study
from granular_id.plotting import plot_confidence

known = ["fine sugar", "rice", "oat flakes", "cat litter", "dry peas", "clay granules"]
data = gid.synthesize(known, n_per_class=16, duration_s=1.2, seed=1)
model = gid.Identifier.fit(data, "multiband", coverage=0.9, share_known=0.95, target_error=None)

# %%
# Candidates, and pushes that are like none
# -----------------------------------------
#
# Later pushes, of other sessions. Three of the materials were not in the training.

unknown = ["wheat flour", "breadcrumbs", "macaroni"]
later = gid.synthesize(known + unknown, n_per_class=16, duration_s=1.2, seed=7)
decisions = [model.identify(push) for push in later]
for push, decision in list(zip(later, decisions, strict=True))[::32]:
    print(f"{push.label}: {decision}")

# %%
# A row is what was pushed through, a number the share of its pushes for which a material was among
# the candidates. The last column counts pushes that were refused. Nine sets in ten hold the right
# material, in the mean: of clay granules fewer do, of sugar all. Flour is like none of the six and
# always refused. The forces of macaroni resemble those of dry peas, and most of these pushes are
# named so: no limit on the scores can tell them apart.

columns = [*known, "like none"]
rows = known + unknown
shares = np.zeros((len(rows), len(columns)))
for push, decision in zip(later, decisions, strict=True):
    for name in ["like none"] if decision.unknown else decision.candidates:
        shares[rows.index(push.label), columns.index(name)] += 1 / 16

figure, panel = plt.subplots(figsize=(7, 5), layout="constrained")
panel.imshow(shares, cmap="Blues", vmin=0, vmax=1.3)
panel.set_xticks(range(len(columns)), columns, rotation=30, ha="right")
panel.set_yticks(range(len(rows)), rows)
panel.set(xlabel="candidates", ylabel="pushed through")
panel.axhline(len(known) - 0.5, color="grey", linestyle="--")
for row, column in np.argwhere(shares > 0):
    colour = "white" if shares[row, column] > 0.6 else "black"
    panel.text(column, row, f"{shares[row, column]:.0%}", ha="center", va="center", color=colour)

# %%
# Do these promises hold?
# ------------------------
#
# ``confidence_study`` asks three questions, with recordings of held-out sessions. Do probabilities
# mean what they say? Do sets of materials hold the right one as often as requested? Are materials
# refused that were left out of the training? Each session is judged by what the others say.

found = confidence_study(data, "multiband", levels=[0.5, 0.8, 0.9])
print(found)
plot_confidence(found)
