"""
An accuracy that can be believed
================================

``evaluate`` holds out whole sessions, and shows beside them what partitions of the same size, drawn
at random, would have promised: :doc:`/guide/evaluation` says why they flatter.

The recordings are SYNTHETIC. What varies between their sessions is drawn: the mounting of the
sensor, its gain and zero, the filling of the container.
"""

import matplotlib.pyplot as plt
import numpy as np

import granular_id as gid
from granular_id.plotting import plot_gap

materials = ["rice", "fine sugar", "cat litter", "dry peas", "oat flakes", "breadcrumbs"]
data = gid.synthesize(materials, n_per_class=16, sessions=4, seed=1)
print(data.summary())

# %%
# One call
# --------
#
# Two feature spaces: the paper's samples and histograms, and multi-band features. The number to
# count on is the first, *held-out sessions*. Below the table stand the controls: the rest before the
# motion and the time of the recording should be near chance.

result = gid.evaluate(data, ["raw+hfmh", "multiband"], progress=False)
print(result)

# %%
# The gap
# -------
#
# Every dot is one partition, every bar a 95 % interval. The shaded stretch is what a new session
# costs, and what random partitions hide. Intervals are wide, as four sessions are few.

plot_gap(result, "raw+hfmh")

# %%
# Which materials pay for it
# --------------------------
#
# The share of each material that is named rightly, with sessions held out and with partitions at
# random.

spaces = [space.name for space in result.spaces]
figure, panels = plt.subplots(1, len(spaces), figsize=(9, 3), sharey=True, layout="constrained")
rows = np.arange(len(result.labels))
for panel, space in zip(panels, spaces, strict=True):
    at_random = result.recall(space, result.random)
    held_out = result.recall(space, result.strictest)
    panel.hlines(rows, held_out, at_random, color="lightgrey", linewidth=3)
    panel.plot(at_random, rows, "o", label="at random")
    panel.plot(held_out, rows, "s", label="held-out sessions")
    panel.set(title=space, xlabel="recall", xlim=(0, 1.05), yticks=rows, yticklabels=result.labels)
panels[0].legend(frameon=False, loc="lower left")

# %%
# The numbers are there for programs as well. ``result.report("report.html")`` writes all of it as
# one page.

for space in spaces:
    accuracy, gap = result.mean_accuracy(space), result.gap(space)
    print(f"{space}: {accuracy:.1%} with sessions held out, {100 * gap:.1f} points less than at random")
