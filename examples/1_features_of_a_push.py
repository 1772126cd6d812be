"""
The features of a push
======================

The paper describes a push by its samples and, for each axis, by a histogram of what lies above 23
Hz: the high-frequency magnitude histogram (HFMH). Below 23 Hz lies the drag of the whole bed, above
it the events of single grains. Here are the steps for one axis, two materials side by side, and the
call that does it all.

The recordings are SYNTHETIC.
"""

import matplotlib.pyplot as plt
import numpy as np

import granular_id as gid

data = gid.synthesize(["macaroni", "fine sugar"], n_per_class=10, seed=1)
push = data[0]
print(push)

# %%
# One axis of one push
# --------------------
#
# The filter is an 8th-order Butterworth high-pass, causal and at rest before the first sample. What
# remains is counted into 100 equal bins from -1.5 N to 1.5 N; values outside are not counted.

sos = gid.signal.butter(8, 23, "highpass", fs=push.rate_hz)
force = push.wrench[:, 0]
high = gid.signal.sosfilt(sos, force)
counts, edges = gid.signal.histogram(high, bins=100, range=(-1.5, 1.5))

times_s = push.times()
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(10, 3), layout="constrained")
left.plot(times_s, force, linewidth=0.8)
left.set(title="signal", xlabel="time, s", ylabel="$F_x$, N")
middle.plot(times_s, high, linewidth=0.5)
middle.set(title="above 23 Hz", xlabel="time, s", ylabel="N")
right.stairs(counts, edges, fill=True)
right.set(title="histogram (HFMH)", xlabel="N", ylabel="samples", yscale="log")

# %%
# Two materials
# -------------
#
# Pasta lets go in jerks, sugar flows: the tails of the one histogram are much longer than those of
# the other, in every push. Each line on the right is one push.

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
for material, colour in (("fine sugar", "tab:blue"), ("macaroni", "tab:orange")):
    pushes = data.select(labels=material).X
    histograms = gid.extract_features(pushes, raw=False)[:, :100]
    left.plot(times_s, pushes[0, :, 0], color=colour, linewidth=0.9, label=material)
    right.plot(edges[:-1], histograms.T, color=colour, linewidth=0.6, drawstyle="steps-post")
left.set(title="one push of each", xlabel="time, s", ylabel="$F_x$, N")
left.legend(frameon=False)
right.set(title="10 pushes of each", xlabel="$F_x$ above 23 Hz, N", ylabel="samples", yscale="log")

# %%
# All axes in one call
# --------------------
#
# ``extract_features`` takes one recording or a batch. The vector of a push holds the 1,600 samples
# of each of the six axes, then the 100 counts of each.

features = gid.extract_features(data.X)
names = gid.feature_names()
print(features.shape)
print(names[0], "...", names[9599], "|", names[9600], "...", names[-1])
print("the counts above:", np.array_equal(features[0, 9600:9700], counts))
