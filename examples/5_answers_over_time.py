"""
Answers while samples arrive
============================

A trained model has an answer at any moment of a push, and a rule that says when it is sure enough
to stop. Over a long recording, the same features name the material in one window after the other.

The recordings are SYNTHETIC: they show that the program works, not how soon real materials are
known.
"""

import matplotlib.pyplot as plt
import numpy as np

import granular_id as gid
from granular_id.plotting import plot_answers, plot_over_time

data = gid.synthesize(["rice", "fine sugar", "macaroni", "oat flakes"], n_per_class=20, seed=1)

# %%
# What is waiting worth?
# ----------------------
#
# Held-out recordings are answered every 20 ms. The line is the share of these provisional answers
# that are right. An early answer is given as soon as it is far enough ahead of the next; how far is
# chosen so that at most 5 % are wrong.

model = gid.Identifier.fit(data, "multiband", target_error=0.05)
print(model.over_time_)
plot_over_time(model.over_time_)

# %%
# One push, sample by sample
# --------------------------
#
# Rows go in as they come, here ten at a time. ``sure`` is the rule for early answers, ``final``
# says that the whole push was seen: then the answer is that of the whole recording, bit for bit.
# ``reset`` makes the stream ready for the next push.

stream = gid.StreamingIdentifier(model)
push = gid.synthesize(["macaroni"], n_per_class=1, seed=3)[0]

decisions = []
for rows in np.array_split(push.wrench, 160):
    stream.push(rows)
    decisions.append(stream.decision())
sure = next(decision for decision in decisions if decision.sure or decision.final)
print(sure)
print(decisions[-1])

# %%
# The material with the smallest loss is the answer.

seconds = [decision.seconds for decision in decisions]
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.5), sharex=True, layout="constrained")
above.plot(push.times(), push.wrench[:, 0], linewidth=0.8)
above.set(title=f"a push through {push.label}", ylabel="$F_x$, N")
for material in model.classes:
    below.plot(seconds, [dict(decision.ranking)[material] for decision in decisions], label=material)
below.axvline(sure.seconds, color="black", linestyle=":", label="sure")
below.set(xlabel="time, s", ylabel="loss")
figure.legend(loc="outside lower center", frameon=False, ncols=5)

# %%
# A long recording
# ----------------
#
# Four pushes, one after the other, without a mark where one begins. The model is trained on windows
# of 0.8 s, and answers every 0.1 s about the window before. Wheat flour was not in the training. A
# light bar is a material that it may be as well.

windows = gid.Identifier.fit(data.windows(0.8), "multiband", target_error=None)
pushes = gid.synthesize(["rice", "wheat flour", "fine sugar", "macaroni"], n_per_class=1, seed=7)
long = gid.Recording(np.concatenate(pushes.X), rate_hz=500, name="four pushes", meta=pushes[0].meta)

answers = windows.predict_over(long, hop_s=0.1)
print(answers)
plot_answers(answers, long)
