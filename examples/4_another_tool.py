"""
Another mounting, another tool
==============================

A model is for one set-up. On Tuesday the sensor is mounted turned by 90 degrees and carries a
gripper: that is geometry and weight, and can be computed away. On Wednesday the tool in the
material is a thinner one: the forces themselves are others, and a few recordings adapt the model.

The recordings are SYNTHETIC.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import granular_id as gid
from granular_id.recording import Payload
from granular_id.synthetic import Rig, simulate_rests

materials = ["rice", "fine sugar", "oat flakes", "dry peas", "cat litter", "macaroni"]
monday = gid.synthesize(materials, n_per_class=16, seed=1)
model = gid.Identifier.fit(monday, "multiband", target_error=None)


def accuracy(model, data):
    """Share of recordings that are named rightly; `data.X` leaves the set-up out of account."""
    return (model.predict(data.X) == data.y).mean()


# %%
# Tuesday: the sensor is turned and carries a gripper
# ---------------------------------------------------
#
# The first four statements simulate the day. Metadata of a recording name the frame of its wrench:
# where it is not that of the training, the model refuses to answer.

gripper = Payload(0.306, (0.002, -0.003, 0.05), bias=(5, 12, 3, 0.78, -0.16, 0.11), frame="wrist")
as_monday = gid.synthesize(materials, n_per_class=24, seed=2)
turned = as_monday.transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], frame="wrist")
tuesday = gid.Dataset([replace(push, wrench=push.wrench + gripper.wrench([0, 0, 1])) for push in turned])
try:
    model.predict(tuesday)
except ValueError as error:
    print(error)

# %%
# What the gripper weighs is identified from rests in six orientations. It comes off first, in the
# frame of the sensor; then the wrench is turned. Forces are those of Monday again.

rests = simulate_rests(gripper, [[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, -1], [-1, 0, 0], [0, -1, 0]])
payload = Payload.fit(rests)
print(payload)
lighter = tuesday.compensate(payload, gravity=[0, 0, 1])
brought_back = lighter.transform([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], frame=monday[0].meta["frame"])

figure, panels = plt.subplots(1, 3, figsize=(10, 3), sharey=True, layout="constrained")
named = {"Tuesday": tuesday, "gripper taken off": lighter, "turned back": brought_back}
for panel, (title, data) in zip(panels, named.items(), strict=True):
    panel.plot(data[0].times(), data[0].wrench[:, :3], linewidth=0.8, label=["$F_x$", "$F_y$", "$F_z$"])
    panel.set(title=title, xlabel="time, s")
panels[0].set_ylabel("force, N")
panels[0].legend(frameon=False, ncols=3)

# %%
# Wednesday: a thinner tool, not as deep
# --------------------------------------
#
# Five recordings of each material are made with it. ``adapt`` takes their labels, or
# ``all_materials`` declares that they hold all materials about equally. Tuesday's loss is made good.
# Wednesday is a lucky draw: in the mean adaptation brings about 10 points, and it can harm
# (:doc:`/guide/setups`).

thin = Rig(tool_diameter_m=0.012, depth_m=0.05)
few = gid.synthesize(materials, n_per_class=5, seed=3, rig=thin)
wednesday = gid.synthesize(materials, n_per_class=24, seed=4, rig=thin)
shares = {
    "another Monday": accuracy(model, as_monday),
    "Tuesday": accuracy(model, tuesday),
    "Tuesday, compensated and turned back": accuracy(model, brought_back),
    "Wednesday": accuracy(model, wednesday),
    "Wednesday, adapted by labels": accuracy(model.adapt(few, few.y), wednesday),
    "Wednesday, adapted to all materials": accuracy(model.adapt(few, all_materials=True), wednesday),
}
figure, panel = plt.subplots(figsize=(8, 3.2), layout="constrained")
bars = panel.barh(list(shares), list(shares.values()), color=["C0", "C1", "C1", *["C2"] * 3])
panel.bar_label(bars, [f"{share:.0%}" for share in shares.values()], padding=3)
panel.axvline(1 / len(materials), color="grey", linestyle="--")
panel.set(xlabel="accuracy (dashed: chance)", xlim=(0, 1.1))
panel.invert_yaxis()
